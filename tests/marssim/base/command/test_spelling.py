import pytest

from marssim.base.command.spelling import did_you_mean


@pytest.mark.parametrize(
    ("word", "hint"),
    [("galle", " (did you mean gale?)"), ("UTOPIA", ""), ("xyz", ""), ("jezro", " (did you mean jezero?)")],
)
def test_a_similar_word_is_suggested(word, hint):
    assert did_you_mean(word, ["utopia", "gale", "jezero"]) == hint
