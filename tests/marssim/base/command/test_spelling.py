import pytest

from marssim.base.command.spelling import did_you_mean


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("galle", " (did you mean gale?)"),
        ("gael", " (did you mean gale?)"),  # two letters are swapped; gravel has all four in this order
        ("agle", " (did you mean gale?)"),
        ("gravle", " (did you mean gravel?)"),
        ("UTOPIA", " (did you mean utopia?)"),
        ("xyz", ""),
        ("jezro", " (did you mean jezero?)"),
    ],
)
def test_a_similar_word_is_suggested(word, hint):
    assert did_you_mean(word, ["utopia", "gale", "gravel", "jezero"]) == hint
