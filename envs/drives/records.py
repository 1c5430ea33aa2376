"""The files of episodes' records: a file with anything else is reported, not counted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from envs.drives.episodes import Cause, EpisodeRecord
from marssim.base.files.json_file import DatasetError, as_json, read_json
from marssim.base.files.json_schema import LARGEST

DELETE_TO_REPEAT = "; delete the file to drive this episode again"
TIMES = ("step_seconds", "perception_seconds")  # of a record, which differ from drive to drive
NUMBER = "a number of 0 or more"
WIDTHS = {"track": 2, "shortest_path": 2, "obstacles": 3}  # numbers in a row of these fields


def read_record(path: Path) -> EpisodeRecord:
    """Read the record that envs.evaluate wrote of an episode.

    Raises:
        DatasetError: If the file holds anything else; the message names the file and the field.
    """
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


def holds_drive(path: Path, record: EpisodeRecord) -> bool:
    """Return whether a file holds a record of the same drive: equal but for times, code and cause."""
    apart = {*TIMES, "code", "cause"}
    try:
        earlier = vars(read_record(path))
    except (DatasetError, FileNotFoundError):
        return False
    return all(earlier[name] == value for name, value in as_json(vars(record)).items() if name not in apart)


def is_number(value: Any) -> bool:
    """Return whether a value is a finite number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -LARGEST < value < LARGEST


def _kind(name: str, annotation: str) -> tuple[str, Callable[[Any], bool]]:
    """Return a description of what a field must be, and a function that checks it."""
    if name == "cause":
        return f"one of {', '.join(Cause)}", lambda value: isinstance(value, str) and value in list(Cause)
    if annotation == "str":
        return "a word", lambda value: isinstance(value, str)
    if annotation == "bool":
        return "true or false", lambda value: isinstance(value, bool)
    if annotation in ("int", "float"):
        if name in ("reward", "slip"):
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
    kind = "rows of as many numbers" if width is None else f"rows of {width} numbers"
    least = name == "track"  # it holds at least the start
    return (f"{kind}, one or more" if least else kind), lambda value: _are_rows(value, width) and len(value) >= least


def _are_numbers(value: Any, width: int) -> bool:
    return isinstance(value, list) and len(value) == width and all(map(is_number, value))


def _are_rows(value: Any, width: int | None) -> bool:
    """Return whether a value is rows of `width` numbers each; None: as many as the first row has."""
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        return False
    return all(_are_numbers(row, len(value[0]) if width is None else width) for row in value)
