"""Settings and examples for all tests."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# Times on shared machines mean nothing: no deadlines. Few examples, the same ones each time: the suite stays fast.
settings.register_profile("suite", deadline=None, max_examples=50, derandomize=True)
settings.load_profile("suite")


@pytest.fixture(scope="session")
def other_methods() -> Callable[[str], str]:
    """The program of docs/other_methods.md whose first line is a file's name."""
    page = (Path(__file__).parents[1] / "docs" / "other_methods.md").read_text()
    return lambda name: re.search(rf"```python\n(# {re.escape(name)}\n.*?)```", page, re.DOTALL)[1]


@pytest.fixture
def my_stereo(tmp_path, monkeypatch, other_methods) -> str:
    """Class path of that page's estimator, which can be imported."""
    (tmp_path / "my_stereo.py").write_text(other_methods("my_stereo.py"))
    monkeypatch.syspath_prepend(str(tmp_path))
    return "my_stereo:Blocks"
