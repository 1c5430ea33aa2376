from envs.comparison.schema import results_schema

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
}


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
