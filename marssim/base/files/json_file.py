"""JSON files: written in one step, and read with errors that name the file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from marssim.base.files.atomic import write_atomically

MOST_LEVELS = 64  # of nesting in a JSON file; our own have less than ten
TOO_DEEP = f"more than {MOST_LEVELS} lists and objects within each other"


class DatasetError(ValueError):
    """A dataset that cannot be read; the message names the file."""


def json_text(content: Any, *, indent: int | None = None, sort_keys: bool = False, default: Any = None) -> str:
    """Return strict JSON, which knows no NaN and no infinity: a number that is not finite becomes null.

    Args:
        content: Nested mappings, lists and tuples of JSON's values.
        indent, sort_keys, default: As json.dumps takes them.

    Raises:
        TypeError: Something in the content is none of JSON's types.
    """
    return json.dumps(_finite(content), indent=indent, sort_keys=sort_keys, default=default, allow_nan=False)


def write_json(path: Path, content: Mapping[str, Any], *, sort_keys: bool = True) -> None:
    """Replace a JSON file in one step. A number that is not finite becomes null.

    Args:
        path: The file. Its folder is made if need be.
        content: Nested mappings, lists and tuples of JSON's values.
        sort_keys: Sort the keys of objects; otherwise they keep their order.

    Raises:
        OSError: The file cannot be written.
    """
    write_atomically(path, (json_text(content, indent=1, sort_keys=sort_keys) + "\n").encode())


def as_json(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return content as read_json gives it back: tuples become lists, numbers that are not finite null, others text."""
    return json.loads(json_text(content, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object. Raises DatasetError that names the file."""
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except OSError as error:
        raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except ValueError as error:  # bytes that are no text, or no JSON
        raise DatasetError(f"{path}: is not JSON: {error}") from None
    except RecursionError:
        raise DatasetError(f"{path}: {TOO_DEEP}") from None
    if not isinstance(content, dict):
        raise DatasetError(f"{path}: not a JSON object")
    if _deeper(content, MOST_LEVELS):
        raise DatasetError(f"{path}: {TOO_DEEP}")
    return content


def _deeper(content: dict[str, Any], levels: int) -> bool:
    """Are dicts and lists nested in more levels? What compares and writes them again recurs, and would break."""
    level: list[Any] = [content]
    for _ in range(levels):
        inner = (part for whole in level for part in (whole.values() if isinstance(whole, dict) else whole))
        level = [part for part in inner if isinstance(part, dict | list)]
    return bool(level)
