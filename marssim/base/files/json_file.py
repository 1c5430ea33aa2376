"""JSON files: written in one step, and read with errors that name the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from marssim.base.files.atomic import write_atomically

MOST_LEVELS = 64  # of nesting in a JSON file; our own have less than ten
TOO_DEEP = f"more than {MOST_LEVELS} lists and objects within each other"


class DatasetError(ValueError):
    """A dataset that cannot be read; the message names the file."""


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Replace a JSON file in one step."""
    write_atomically(path, (json.dumps(content, indent=1, sort_keys=True) + "\n").encode())


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
