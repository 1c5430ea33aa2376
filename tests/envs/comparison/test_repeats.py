import pytest

from envs.comparison.methods import DrivenMethod
from envs.comparison.repeats import repeat_in_words, repeats_of

DRIVE = {"outcome": "goal", "spl": 0.5, "step_seconds": 0.1, "perception_seconds": 0.2, "code": "aa", "cause": None}


def driven(perception="sgbm", courses=range(4), **changes):
    """A method's drives over courses, each with these changes."""
    return DrivenMethod("navigator", perception, {("clear", course): {**DRIVE, **changes} for course in courses})


@pytest.mark.parametrize(
    ("changes", "equal"),
    [
        ({"step_seconds": 9.0, "perception_seconds": 8.0, "code": "bb"}, True), ({"cause": "detour"}, True),
        ({"near_ground": 7}, True), ({"spl": 0.5 + 4e-15}, True), ({"spl": 0.5000001}, False),
        ({"outcome": "time"}, False),
    ],
)  # fmt: skip
def test_times_and_code_and_what_one_file_alone_records_do_not_count(changes, equal):
    (row,) = repeats_of({"a": driven(), "b": driven(**changes)})
    assert row["equal"] == (4 if equal else 0) and row["shared"] == 4


def test_causes_that_both_files_record_count():
    (row,) = repeats_of({"a": driven(cause="detour"), "b": driven(cause="no progress")})
    assert row["equal"] == 0


def test_only_one_method_under_two_labels_is_compared_on_what_both_drove():
    other, alone, part = driven("eyes"), driven(courses=(9,)), driven(courses=(1, 2, 7))
    part.episodes["clear", 2]["spl"] = 0.4
    rows = repeats_of({"ours": driven(), "eyes": other, "alone": alone, "again": part})
    assert rows == [
        {
            "driver": "navigator", "perception": "sgbm", "labels": ["ours", "again"], "shared": 2, "equal": 1,
            "differing": [{"condition": "clear", "course": 2}],
        }
    ]  # fmt: skip
    assert repeat_in_words(rows[0]) == (
        "ours, and again: 1 of 2 shared episodes are equal but for times; differing: clear 2."
    )


def test_a_sentence_names_the_first_of_many_that_differ():
    (row,) = repeats_of({"a": driven(courses=range(20)), "b": driven(courses=range(20), spl=0.1)})
    assert repeat_in_words(row).endswith("clear 10, clear 11, and 8 more.")
    (row,) = repeats_of({"a": driven(courses=(3,)), "b": driven(courses=(3,))})
    assert repeat_in_words(row) == "a, and b: 1 of 1 shared episode is equal but for times."
