import pytest

from marssim.base.files.json_schema import first_fault


@pytest.mark.parametrize(
    ("value", "schema", "fault"),
    [
        (3, {"type": "integer"}, None), (True, {"type": "integer"}, "the file must be of type integer, got True"),
        (1, {"type": "boolean"}, "the file must be of type boolean, got 1"), (None, {"type": ["string", "null"]}, None),
        (1, {"type": "number", "minimum": 2}, "the file must be at least 2, got 1"),
        ({"a": [1, "b"]}, {"properties": {"a": {"items": {"type": "number"}}}}, "a[1] must be of type number, got 'b'"),
        ({}, {"required": ["a"]}, "the file has no a"), ("c", {"enum": ["a", "b"]}, "must be one of a, b, got 'c'"),
        (float("nan"), {"type": "number"}, "the file must be a finite number, got nan"),
        ([1, 2], {"minItems": 2}, None),
        (10**400, {}, "must be a finite number, got " + "1" + 39 * "0"), ([1], {"maxItems": 1}, None),
        ({"a": [1]}, {"properties": {"a": {"minItems": 2}}}, "a must have 2 or more items, got 1"),
        ([1, 2], {"maxItems": 1}, "must have 1 or fewer items, got 2"),
        ("a b", {"pattern": "[a-z]+", "description": "letters"}, "the file must be letters, got 'a b'"),
        ("ab", {"pattern": "[a-z]+"}, None),
        ({"a": 1, "b": 2}, {"properties": {"a": {}}, "additionalProperties": False}, "b is unknown"),
        ({"a": "x", "b": "y"}, {"properties": {"a": {}}, "additionalProperties": {"type": "integer"}},
         "b must be of type integer, got 'y'"),
        ({"a": {"B": 1}}, {"properties": {"a": {"propertyNames": {"pattern": "[a-z]", "description": "small"}}}},
         "a: a key must be small, got 'B'"),
        ([1, 2], {"minItems": 3, "maxItems": 3}, "must have 3 items, got 2"),
    ],
)  # fmt: skip
def test_the_first_fault_is_named_with_its_place(value, schema, fault):
    found = first_fault(value, schema)
    assert found is None if fault is None else found is not None and found.endswith(fault)
