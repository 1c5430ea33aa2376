"""The library `rosbags`, which is imported only where a bag is written or read."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

EXTRA = "pip install 'mars-m3depth[real]'"


def check_installed(path: Path) -> None:
    """Raise ImportError that names a bag and the extra if `rosbags` is not installed."""
    if find_spec("rosbags") is None:
        raise ImportError(f"{path}: ROS 2 bags need rosbags, which is not installed; {EXTRA}")


@lru_cache(maxsize=1)
def typestore() -> Any:
    """Return the message types of ROS 2 Jazzy; those that are used here are the same since Humble."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def new_message(kind: str, **values: Any) -> Any:
    """Return a message.

    Args:
        kind: Its type, "sensor_msgs/Image".
        **values: All of its fields.
    """
    package, _, name = kind.partition("/")
    return typestore().types[f"{package}/msg/{name}"](**values)
