"""The library `rosbags`, which is imported only where a bag is written or read."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

EXTRA = 'pip install "mars-m3depth[real]"'


def check_installed(path: Path) -> None:
    """Raise ImportError that names a bag and the extra if `rosbags` is not installed."""
    if find_spec("rosbags") is None:
        raise ImportError(f"{path}: ROS 2 bags need rosbags, which is not installed; {EXTRA}")


@lru_cache(maxsize=1)
def typestore() -> Any:
    """Return the message types of ROS 2 Jazzy; those that are used here are the same since Humble."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@lru_cache(maxsize=256)
def check_definition(kind: str, definition: Any) -> None:
    """Check that a bag defines a type of message as ROS 2 Jazzy does.

    A bag's own definitions are compared only, since the library would make Python code of them and run it.

    Args:
        kind: The type, "sensor_msgs/msg/Image".
        definition: What the bag says about it: rosbags' MessageDefinition.

    Raises:
        ValueError: The type is none of ROS 2 Jazzy, or has other fields there.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_msg

    definitions = typestore().fielddefs
    if kind not in definitions:
        raise ValueError(f"{kind} is no type of ROS 2 Jazzy")
    if definition.format == MessageDefinitionFormat.MSG:
        for name, (_, fields) in get_types_from_msg(definition.data, kind).items():
            if name in definitions and _lowered(fields) != _lowered(definitions[name][1]):
                raise ValueError(f"{name} has other fields than in ROS 2 Jazzy")


def _lowered(fields: Any) -> list[tuple[str, Any]]:
    """Return fields with names in small letters: D of CameraInfo in ROS 1 is d in ROS 2."""
    return [(name.lower(), kind) for name, kind in fields]


def new_message(kind: str, **values: Any) -> Any:
    """Return a message.

    Args:
        kind: Its type, "sensor_msgs/Image".
        **values: All of its fields.
    """
    package, _, name = kind.partition("/")
    return typestore().types[f"{package}/msg/{name}"](**values)
