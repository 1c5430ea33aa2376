import pytest

from envs.comparison.schema import first_fault, results_schema

KNOWN = {"$schema", "title", "description", "type", "enum", "minimum", "maximum", "required", "properties", "items"}


def parts(schema):
    yield schema
    for part in [*schema.get("properties", {}).values(), *filter(None, [schema.get("items")])]:
        yield from parts(part)


def test_the_schema_has_only_keywords_that_are_checked_and_describes_every_value():
    for part in parts(results_schema()):
        assert set(part) <= KNOWN
        for name, value in part.get("properties", {}).items():
            assert value.get("description") or value["type"] in ("array", "object"), name
        assert set(part.get("required", ())) <= set(part.get("properties", {}))


@pytest.mark.parametrize(
    ("value", "schema", "fault"),
    [
        (3, {"type": "integer"}, None), (True, {"type": "integer"}, "the file must be of type integer, got True"),
        (1, {"type": "boolean"}, "the file must be of type boolean, got 1"), (None, {"type": ["string", "null"]}, None),
        (1, {"type": "number", "minimum": 2}, "the file must be at least 2, got 1"),
        ({"a": [1, "b"]}, {"properties": {"a": {"items": {"type": "number"}}}}, "a[1] must be of type number, got 'b'"),
        ({}, {"required": ["a"]}, "the file has no a"), ("c", {"enum": ["a", "b"]}, "must be one of a, b, got 'c'"),
    ],
)  # fmt: skip
def test_the_first_fault_is_named_with_its_place(value, schema, fault):
    found = first_fault(value, schema)
    assert found is None if fault is None else found is not None and found.endswith(fault)
