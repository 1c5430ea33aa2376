import pytest

from envs.comparison.schema import results_schema
from marssim.base.files.json_schema import first_fault

KNOWN = {
    "$schema",
    "title",
    "description",
    "type",
    "enum",
    "minimum",
    "maximum",
    "required",
    "properties",
    "items",
    "pattern",
    "additionalProperties",
    "propertyNames",
}


def parts(schema):
    yield schema
    inner = [schema.get(name) for name in ("items", "additionalProperties", "propertyNames")]
    for part in [*schema.get("properties", {}).values(), *filter(None, inner)]:
        yield from parts(part)


def test_the_schema_has_only_keywords_that_are_checked_and_describes_every_value():
    for part in parts(results_schema()):
        assert set(part) <= KNOWN
        for name, value in part.get("properties", {}).items():
            assert value.get("description") or value["type"] in ("array", "object"), name
        assert set(part.get("required", ())) <= set(part.get("properties", {}))


@pytest.mark.parametrize("record", [None, "pytorch 2.9.1+cpu cpu fp32", "openvino 1 cpu bf16 + pytorch 2 cpu bf16"])
def test_the_runtime_names_one_program_or_two_or_none(record):
    assert first_fault(record, results_schema()["properties"]["runtime"]) is None


@pytest.mark.parametrize(
    "name", ["x\x9b2J", "a\u2028b", "a\u2029b", "x\u202eb", "a\u2066b", "a\u200fb", "a\u061cb", "a\nb", ""]
)
def test_a_name_holds_nothing_that_moves_what_is_printed(name):
    episode = results_schema()["properties"]["episodes"]["items"]["properties"]
    for schema in (episode["driver"], episode["perception"]):
        assert first_fault(name, schema, "x").startswith("x must be a name in one line, got ")
        assert first_fault("Kästner's 目: C:\\net|<b>.py", schema, "x") is None
    assert "a key must be a name in one line" in first_fault(
        {name: "0" * 64}, results_schema()["properties"]["weights"]
    )
