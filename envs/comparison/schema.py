"""Checks a value against a JSON schema, with the keywords that results.schema.json uses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from marssim.base.files.json_file import read_json

SCHEMA = Path(__file__).with_name("results.schema.json")
TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "integer": (int,), "number": (int, float),
    "boolean": (bool,), "null": (type(None),),
}  # fmt: skip


@cache
def results_schema() -> dict[str, Any]:
    """Return the schema of the results of a suite."""
    return read_json(SCHEMA)


def first_fault(value: Any, schema: Mapping[str, Any], where: str = "") -> str | None:
    """Return what is wrong with a value, beginning with its place, as "episodes[3].spl must be ..."; None if nothing.

    Args:
        value: A value of JSON.
        schema: Its schema. Known keywords: type, enum, minimum, maximum, required, properties, items.
        where: Place of the value in the file.
    """
    name = where or "the file"
    kinds = schema.get("type")
    if kinds is not None:
        kinds = [kinds] if isinstance(kinds, str) else kinds
        if not any(_is(value, kind) for kind in kinds):
            return f"{name} must be of type {' or '.join(kinds)}, got {value!r:.40}"
    if "enum" in schema and value not in schema["enum"]:
        return f"{name} must be one of {', '.join(map(str, schema['enum']))}, got {value!r:.40}"
    if isinstance(value, int | float) and not isinstance(value, bool):
        if value < schema.get("minimum", value):
            return f"{name} must be at least {schema['minimum']:g}, got {value!r}"
        if value > schema.get("maximum", value):
            return f"{name} must be at most {schema['maximum']:g}, got {value!r}"
    if isinstance(value, dict):
        for key in schema.get("required", ()):
            if key not in value:
                return f"{name} has no {key}"
        for key, part in schema.get("properties", {}).items():
            if key in value and (fault := first_fault(value[key], part, f"{where}.{key}".lstrip("."))):
                return fault
    if isinstance(value, list) and "items" in schema:
        for n, item in enumerate(value):
            if fault := first_fault(item, schema["items"], f"{where}[{n}]"):
                return fault
    return None


def _is(value: Any, kind: str) -> bool:
    return isinstance(value, TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))
