"""The files that episodes' records are kept in: whatever else stands in one is told, not counted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from envs.drives.episodes import EpisodeRecord
from marssim.base.files.json_file import DatasetError, read_json

DELETE_TO_REPEAT = "; delete it, and it is driven anew"
NUMBER = "a number of 0 or more"
LARGEST = 1e300
WIDTHS = {"track": 2, "shortest_path": 2, "obstacles": 3}


def read_record(path: Path) -> EpisodeRecord:
    """What envs.evaluate wrote of an episode. Raises DatasetError that names the file and what is wrong with it."""
    try:
        record = EpisodeRecord(**read_json(path))
    except TypeError:
        raise DatasetError(f"{path}: not an episode of this version{DELETE_TO_REPEAT}") from None
    except DatasetError as error:
        raise DatasetError(f"{error}{DELETE_TO_REPEAT}") from None
    for field in fields(record):
        value = getattr(record, field.name)
        kind, fits = _kind(field.name, str(field.type).removesuffix(" | None"))
        if not fits(value) and not (value is None and str(field.type).endswith(" | None")):
            raise DatasetError(f"{path}: {field.name} must be {kind}, got {value!r:.40}{DELETE_TO_REPEAT}")
    return record


def is_number(value: Any) -> bool:
    """Whether it is a finite number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -LARGEST < value < LARGEST


def _kind(name: str, annotation: str) -> tuple[str, Callable[[Any], bool]]:
    """What a field must be, in words and as a question."""
    if annotation == "str":
        return "a word", lambda value: isinstance(value, str)
    if annotation == "bool":
        return "true or false", lambda value: isinstance(value, bool)
    if annotation in ("int", "float"):
        if name == "reward":
            return "a number", is_number
        if name == "shortest":
            return "a number over 0", lambda value: is_number(value) and value > 0
        return NUMBER, lambda value: is_number(value) and value >= 0
    if annotation == "list[float]":
        if name == "goal":
            return "two numbers", lambda value: _are_numbers(value, 2)
        return "numbers", lambda value: isinstance(value, list) and _are_numbers(value, len(value))
    assert annotation == "list[list[float]]", annotation
    width = WIDTHS.get(name)
    told = "rows of as many numbers" if width is None else f"rows of {width} numbers"
    least = name == "track"  # which has the start
    return (f"{told}, one or more" if least else told), lambda value: _are_rows(value, width) and len(value) >= least


def _are_numbers(value: Any, width: int) -> bool:
    return isinstance(value, list) and len(value) == width and all(map(is_number, value))


def _are_rows(value: Any, width: int | None) -> bool:
    """width: numbers in each row, those of the first if None."""
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        return False
    return all(_are_numbers(row, len(value[0]) if width is None else width) for row in value)
