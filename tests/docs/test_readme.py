"""README.md is short, and its tables are rows of the results pages."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MOST_WORDS = 900


def rows(text: str) -> list[str]:
    """The rows of a page's tables, without the lines under their heads."""
    return [" ".join(line.split()) for line in text.splitlines() if line.startswith("|") and set(line) - set("|-: ")]


def results() -> set[str]:
    return {row for page in (ROOT / "docs" / "results").glob("*.md") for row in rows(page.read_text(encoding="utf-8"))}


def test_the_readme_has_at_most_900_words():
    assert len(README.split()) <= MOST_WORDS


def test_every_figure_in_a_table_of_the_readme_is_a_row_of_a_results_page():
    tables = [row for row in rows(README) if re.search(r"\d\.\d|\d of \d", row)]
    assert len(tables) >= 6
    assert [row for row in tables if row not in results()] == []


def test_the_readme_has_no_commit_hashes():
    hashes = re.findall(r"\b(?=[0-9a-f]*\d)(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b", README)
    assert hashes == []


def test_the_two_commands_that_set_everything_up_stand_in_the_readme():
    assert "make demo" in README and "make test" in README


def test_the_snippets_of_the_readme_run_one_after_the_other():
    """The first renders a frame, the second reads its depth, the third drives a step."""
    snippets = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(snippets) == 3
    names: dict[str, object] = {}
    for snippet in snippets:
        exec(compile(snippet, "README.md", "exec"), names)
    assert names["prediction"].depth.shape == names["frame"].depth.shape
    assert names["env"].observation_space.contains(names["observation"])
    names["env"].close()
