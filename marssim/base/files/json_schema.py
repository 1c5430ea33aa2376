"""Checks a value against a JSON schema, with the keywords that this project's schemas use."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

LARGEST = 1e300  # numbers beyond count as infinite
TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "integer": (int,), "number": (int, float),
    "boolean": (bool,), "null": (type(None),),
}  # fmt: skip


def first_fault(value: Any, schema: Mapping[str, Any], where: str = "") -> str | None:
    """Return what is wrong with a value, beginning with its place, as "episodes[3].spl must be ..."; None if nothing.

    Args:
        value: A value of JSON.
        schema: Its schema. Known keywords: type, enum, pattern, minimum, maximum, required, properties,
            additionalProperties, propertyNames, items, minItems, maxItems. A pattern must fit the whole text.
        where: Place of the value in the file.
    """
    name = where or "the file"
    kinds = schema.get("type")
    if kinds is not None:
        kinds = [kinds] if isinstance(kinds, str) else kinds
        if not any(_is(value, kind) for kind in kinds):
            return f"{name} must be of type {' or '.join(kinds)}, got {value!r:.40}"
    if "enum" in schema and value not in schema["enum"]:
        options = ", ".join("null" if option is None else str(option) for option in schema["enum"])
        return f"{name} must be one of {options}, got {value!r:.40}"
    if isinstance(value, str) and "pattern" in schema and not re.fullmatch(schema["pattern"], value):
        return f"{name} must be {schema.get('description', 'a text of another form')}, got {value!r:.40}"
    if isinstance(value, int | float) and not isinstance(value, bool):
        if not -LARGEST < value < LARGEST:
            return f"{name} must be a finite number, got {value!r:.40}"
        if value < schema.get("minimum", value):
            return f"{name} must be at least {schema['minimum']:g}, got {value!r}"
        if value > schema.get("maximum", value):
            return f"{name} must be at most {schema['maximum']:g}, got {value!r}"
    if isinstance(value, dict):
        for key in schema.get("required", ()):
            if key not in value:
                return f"{name} has no {key}"
        parts, others = schema.get("properties", {}), schema.get("additionalProperties", True)
        for key, item in value.items():
            inside = f"{where}.{key:.40}".lstrip(".")
            part = parts.get(key, others)
            if part is False:
                return f"{inside} is unknown"
            if "propertyNames" in schema and (fault := first_fault(key, schema["propertyNames"], f"{name}: a key")):
                return fault
            if part is not True and (fault := first_fault(item, part, inside)):
                return fault
    if isinstance(value, list):
        low, high = schema.get("minItems", 0), schema.get("maxItems", len(value))
        if not low <= len(value) <= high:
            wanted = f"{low}" if low == high else f"{low} or more" if len(value) < low else f"{high} or fewer"
            return f"{name} must have {wanted} items, got {len(value)}"
    if isinstance(value, list) and "items" in schema:
        for n, item in enumerate(value):
            if fault := first_fault(item, schema["items"], f"{where}[{n}]"):
                return fault
    return None


def _is(value: Any, kind: str) -> bool:
    return isinstance(value, TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))
