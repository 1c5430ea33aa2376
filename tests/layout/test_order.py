"""The lists of files in tests/conftest.py, which choose and order tests, name files that exist."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ["QUICK", "LONGEST"])
def test_the_lists_name_tests(name):
    (names,) = (
        ast.literal_eval(node.value)
        for node in ast.parse((TESTS / "conftest.py").read_text()).body
        if isinstance(node, ast.Assign) and node.targets[0].id == name
    )
    assert names and [entry for entry in names if not (TESTS / entry).exists()] == []
