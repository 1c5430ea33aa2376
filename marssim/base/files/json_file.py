"""Read and write JSON files: writing replaces a file in one step, and errors of reading name the file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.files.atomic import write_atomically
from marssim.base.files.whole_file import read_file

MOST_LEVELS = 64  # levels of nesting in a file that is read; files of this project have less than ten
MOST_DIGITS = 300  # of an integer; a float overflows from 309
TOO_DEEP = f"nests lists and objects more than {MOST_LEVELS} levels deep"


class DatasetError(ValueError):
    """A file or a folder of data cannot be read or used; the message names it."""


def json_text(content: Any, *, indent: int | None = None, sort_keys: bool = False, default: Any = None) -> str:
    """Return strict JSON, which knows no NaN and no infinity: a number that is not finite becomes null.

    Args:
        content: Nested mappings, lists and tuples of JSON's values; numbers may be of numpy.
        indent: As json.dumps takes it.
        sort_keys: As json.dumps takes it.
        default: As json.dumps takes it.

    Raises:
        TypeError: A value is of none of JSON's types, and `default` does not convert it.
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
    """Return content as read_json reads it back.

    Tuples become lists, numbers that are not finite become None, and values of other types than JSON's become text.
    """
    return json.loads(json_text(content, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.number | np.bool_):
        return _finite(value.item())
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object from a file.

    Raises:
        DatasetError: The file cannot be read, or holds no JSON object. One line that names the file.
    """
    try:
        data = read_file(path)
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except OSError as error:
        raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    return parse_json(data, path)


def parse_json(data: bytes, name: object) -> dict[str, Any]:
    """Return the JSON object that the content of a file holds.

    Args:
        data: The content, UTF-8.
        name: The file, for messages.

    Raises:
        DatasetError: It holds no JSON object. One line that begins with the name.
    """
    try:
        content = json.loads(data.decode("utf-8-sig"), parse_int=_integer)
    except ValueError as error:  # not UTF-8, or not JSON
        raise DatasetError(f"{name}: is not JSON: {error}") from None
    except RecursionError:
        raise DatasetError(f"{name}: {TOO_DEEP}") from None
    if not isinstance(content, dict):
        raise DatasetError(f"{name}: not a JSON object")
    if is_deeper(content, MOST_LEVELS):
        raise DatasetError(f"{name}: {TOO_DEEP}")
    return content


def _integer(digits: str) -> int:
    """Return an integer that a float can hold, roughly."""
    if len(digits) > MOST_DIGITS:
        raise ValueError(f"an integer of {len(digits)} digits")
    return int(digits)


def is_deeper(content: Any, levels: int) -> bool:
    """Return whether dicts and lists are nested in more levels, with which recursive functions would fail.

    Args:
        content: What json.loads returned.
        levels: The number of levels that may be.
    """
    level: list[Any] = [content] if isinstance(content, dict | list) else []
    for _ in range(levels):
        values = (value for outer in level for value in (outer.values() if isinstance(outer, dict) else outer))
        level = [value for value in values if isinstance(value, dict | list)]
    return bool(level)
