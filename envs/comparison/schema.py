"""The schema of the results of a suite, which envs.compare --check applies."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from marssim.base.files.json_file import read_json

SCHEMA = Path(__file__).with_name("results.schema.json")


@cache
def results_schema() -> dict[str, Any]:
    """Return the schema of the results of a suite."""
    return read_json(SCHEMA)
