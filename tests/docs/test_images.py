"""Pictures of the guides are made by the commands beside them."""

import importlib.util
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def commands():
    """Command lines of docs/make_images.py by the file that each leaves."""
    spec = importlib.util.spec_from_file_location("make_images", DOCS / "make_images.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.COMMANDS


def test_the_picture_of_the_own_driver_is_that_of_the_printed_command(commands):
    page = (DOCS / "guides" / "own-driver.md").read_text(encoding="utf-8").replace("\\\n", " ")
    (printed,) = re.findall(r"^    python -m (envs\.evaluate .*)$", page, re.MULTILINE)
    assert printed.split() == commands["out/wary/results.json"].split()
