"""The config of a network in a weights file: its kind, and numbers, switches, texts and tuples of numbers by name.

Importing this module loads no torch.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

LARGEST = 4096  # that a size of a network, or the length of a text, may be


def checked_fields(cls: type, data: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a dataclass's fields that a JSON object gives, lists as tuples.

    Args:
        cls: The dataclass, each of whose fields has a default: an int, a bool, a text or a tuple of ints.
        data: The object; fields may be missing.

    Raises:
        ValueError: A field is unknown or malformed; the message names it.
    """
    defaults: dict[str, Any] = {f.name: f.default for f in fields(cls)}
    values: dict[str, Any] = {}
    for name, value in data.items():
        if name not in defaults:
            raise ValueError(f"network config: unknown field {name!r}")
        size = len(defaults[name]) if isinstance(defaults[name], tuple) else None
        kind = int if size else type(defaults[name])
        parts = value if size and isinstance(value, list | tuple) else [value]
        sizes = [len(part) if isinstance(part, str) else part for part in parts if type(part) is kind]
        if not len(sizes) == len(parts) == (size or 1) or not all(0 <= n <= LARGEST for n in sizes):
            raise ValueError(f"network config: field {name!r} has the value {value!r}")
        values[name] = tuple(parts) if size else value
    return values


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
