"""Read and write places as JSON files. A place is a SceneConfig.

A file names only what differs from the preset that it starts from:

    {"preset": "gale", "size": 40, "rocks": {"k": 0.12}, "look": {"sun_elevation_deg": [20, 25]}}

Its fields are those of SceneConfig, by name, and nested as they are there. `save_place` writes a whole file to start
from; what a dataset's sample.json holds as `scene_config` has the same form. The path of a heightmap is relative to
the folder of the file.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from marssim.base.command.spelling import did_you_mean, nearest
from marssim.base.files.json_file import read_json, write_json
from marssim.scene.presets import PRESETS, preset
from marssim.scene.scene import SceneConfig

FIELD = "`scene`"  # begins each message; a command replaces a name in ` ` by its flag
PLACE_VALUES = "{" + ",".join(PRESETS) + "}|FILE.json"  # values of a flag that takes a place, for the help

Part = TypeVar("Part")


def load_place(name: str | Path) -> SceneConfig:
    """Return the place of that name: a preset, or the content of a JSON file.

    Args:
        name: One of PRESETS, or the path of a file as `save_place` writes it; a path that no preset is called.

    Raises:
        ValueError: There is neither such a preset nor such a file; or the file is no JSON object, or has an unknown
            field or a value out of range. One line that begins with `scene`, of which a command makes the flag, and
            names the file and the field, as rocks.k.
    """
    if str(name) in PRESETS:
        return preset(str(name))
    path = Path(name)
    if path.suffix != ".json" and not os.path.exists(path):  # Path.exists raises for a name that is too long
        similar = did_you_mean(str(name), PRESETS)
        raise ValueError(
            f"{FIELD} {name!s:.100}: no preset ({', '.join(PRESETS)}) and no JSON file of a place{similar}"
        )
    try:
        content = read_json(path)
    except ValueError as error:
        raise ValueError(f"{FIELD} {error}") from None
    try:
        return _merged(_start(content), _with_heightmap(content, path.parent))
    except ValueError as error:
        raise ValueError(f"{FIELD} {path}: {str(error).replace('`', '')}") from None


def save_place(place: SceneConfig, path: Path) -> None:
    """Write a place with all its fields to a JSON file that `load_place` reads.

    Args:
        place: The place, as `preset("gale")`.
        path: The file, which is replaced if it exists. The path of a heightmap is written as an absolute one.
    """
    content = asdict(place)
    if place.relief.heightmap is not None:
        content["relief"]["heightmap"] = str(Path(place.relief.heightmap).absolute())
    write_json(Path(path), content)


def _start(content: dict[str, Any]) -> SceneConfig:
    """Return the preset that a file starts from."""
    name = content.get("preset", PRESETS[0])
    if (
        isinstance(name, str)
        and name not in PRESETS
        and {field.name for field in fields(SceneConfig)} <= content.keys()
    ):
        return replace(preset(PRESETS[0]), preset=name)  # a label: save_place wrote all fields
    if name not in PRESETS:
        raise ValueError(f"preset {name!r} is unknown; {_nearest(str(name), PRESETS)}")
    return preset(name)


def _with_heightmap(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the content of a file in a folder, with the heightmap's path relative to the working directory."""
    relief = content.get("relief")
    if not isinstance(relief, dict) or not isinstance(relief.get("heightmap"), str):
        return content
    return {**content, "relief": {**relief, "heightmap": str(folder / relief["heightmap"])}}


def _merged(config: Part, content: Any, where: str = "") -> Part:
    """Return a config with the fields replaced that a JSON object has.

    Args:
        config: The config.
        content: The JSON object.
        where: Dotted name of the config, with a dot at its end.

    Raises:
        ValueError: A field is unknown or has a bad value. The message names it by its dotted name.
    """
    if not isinstance(content, dict):
        raise ValueError(f"{where.rstrip('.')} must be a JSON object, got {content!r}")
    hints = get_type_hints(type(config))
    changes = {}
    for name, value in content.items():
        if name not in hints:
            raise ValueError(f"unknown field {where}{name}; {_nearest(name, list(hints), where)}")
        present = getattr(config, name)
        if is_dataclass(present):
            changes[name] = _merged(present, value, f"{where}{name}.")
        else:
            changes[name] = _value(value, hints[name], where + name)
    try:
        return replace(config, **changes)  # type: ignore[type-var]
    except ValueError as error:
        raise ValueError(f"{'' if str(error).startswith('`') else where}{error}") from None


def _value(value: Any, hint: Any, where: str) -> Any:
    """Return a JSON value as a field's type has it: float, str, None, or a tuple of floats."""
    numbers = isinstance(value, list) and all(map(_is_number, value))
    for option in get_args(hint) if isinstance(hint, UnionType) else (hint,):
        if option is float and _is_number(value):
            return float(value)
        if numbers and get_origin(option) is tuple and len(value) == len(get_args(option)):
            return tuple(map(float, value))
        if option in (str, NoneType) and isinstance(value, option):
            return value
    raise ValueError(f"{where} must be {_kind(hint)}, got {value!r}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _kind(hint: Any) -> str:
    """Return what a field takes, in words."""
    if isinstance(hint, UnionType):
        return " or ".join(map(_kind, get_args(hint)))
    if get_origin(hint) is tuple:
        return f"a list of {len(get_args(hint))} numbers"
    return {float: "a number", str: "a text", NoneType: "null"}[hint]


def _nearest(name: str, names: Sequence[str], where: str = "") -> str:
    """Return a hint: the most similar known name, or else all known names."""
    near = nearest(name, names)
    return f"did you mean {where}{near}?" if near else f"choose from {', '.join(where + name for name in names)}"
