"""The files that episodes' records are kept in: whatever else stands in one is told, not counted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from envs.episodes import EpisodeRecord
from marssim.dataset import DatasetError, read_json

ANEW = "; delete it, and it is driven anew"
SIGNED = ("reward",)  # the only number that may be negative


def read_record(path: Path) -> EpisodeRecord:
    """What envs.evaluate wrote of an episode. Raises DatasetError that names the file and what is wrong with it."""
    try:
        record = EpisodeRecord(**read_json(path))
    except TypeError:
        raise DatasetError(f"{path}: not an episode of this version{ANEW}") from None
    except DatasetError as error:
        raise DatasetError(f"{error}{ANEW}") from None
    for field in fields(record):
        value = getattr(record, field.name)
        kind, fits = KINDS[str(field.type).removesuffix(" | None")]
        if value is None and str(field.type).endswith(" | None"):
            continue
        if not fits(value) or (kind == NUMBER and value < 0 and field.name not in SIGNED):
            raise DatasetError(f"{path}: {field.name} must be {kind}, got {value!r:.40}{ANEW}")
    return record


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _are_numbers(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_number, value))


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and all(map(_are_numbers, value))


NUMBER = "a number of 0 or more"
KINDS: dict[str, tuple[str, Callable[[Any], bool]]] = {  # of an EpisodeRecord's fields, by their annotations
    "str": ("a word", lambda value: isinstance(value, str)),
    "bool": ("true or false", lambda value: isinstance(value, bool)),
    "int": (NUMBER, _is_number),
    "float": (NUMBER, _is_number),
    "list[float]": ("numbers", _are_numbers),
    "list[list[float]]": ("rows of numbers", _is_table),
}
