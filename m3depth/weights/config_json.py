"""The config of a network in a weights file: its kind, and numbers, switches, texts and tuples of numbers by name.

Importing this module loads no torch.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

LARGEST = 4096  # that a size of a network, or the length of a text, may be


def checked_fields(cls: type, data: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a dataclass's fields that a JSON object gives, lists as tuples.

    Args:
        cls: The dataclass, each of whose fields has a default: a number, a bool, a text or a tuple of one of these.
        data: The object; fields may be missing.

    Raises:
        ValueError: A field is unknown or malformed; the message names it.
    """
    declared = {f.name: f for f in fields(cls)}
    values: dict[str, Any] = {}
    for name, value in data.items():
        if name not in declared:
            raise ValueError(f"network config: unknown field {name!r}")
        default: Any = declared[name].default
        is_tuple = isinstance(default, tuple)
        parts = value if is_tuple and isinstance(value, list | tuple) else [value]
        kind = type(default[0] if is_tuple else default)
        fits = len(parts) == (len(default) if is_tuple else 1) or (is_tuple and "..." in str(declared[name].type))
        if not fits or not all(_is_of(part, kind) for part in parts):
            raise ValueError(f"network config: field {name!r} has the value {value!r}")
        read = [float(part) if kind is float else part for part in parts]
        values[name] = tuple(read) if is_tuple else read[0]
    return values


def _is_of(value: Any, kind: type) -> bool:
    """Return whether a value is of a kind, and of a size that a network may have. A whole number is a float too."""
    if kind is float:
        return type(value) in (int, float) and math.isfinite(value)
    size: int = len(value) if isinstance(value, str) else value
    return type(value) is kind and 0 <= size <= LARGEST


def kind_of(config: dict[str, Any]) -> str:
    """Return the kind of network that a config in JSON describes: "m3depth", or the name of another method.

    Args:
        config: The object; M3Depth's files name no kind.
    """
    return str(config.get("kind", "m3depth"))


def kind_in_file(path: Path) -> str | None:
    """Return the kind of network whose weights a file holds; None where the file cannot be read.

    Args:
        path: A .safetensors file that m3depth.train wrote, of which the header alone is read.
    """
    try:
        with safe_open(str(path), framework="numpy") as file:
            config = json.loads((file.metadata() or {})["m3depth_config"])
    except (SafetensorError, OSError, KeyError, ValueError, RecursionError):
        return None
    return kind_of(config) if isinstance(config, dict) else None
