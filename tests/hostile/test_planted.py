"""The defects that are planted to try the campaign are changes that the present sources take."""

import pytest
from planted import DEFECTS, ROOT


@pytest.mark.parametrize("name", DEFECTS)
def test_a_planted_defect_changes_the_sources_at_one_place_each(name):
    for file, text, instead in DEFECTS[name].changes:
        assert (ROOT / file).read_text(encoding="utf-8").count(text) == 1, f"{file}: {text!r}"
        assert text != instead
    assert (ROOT / "tests/hostile" / DEFECTS[name].test.split()[0]).exists()
