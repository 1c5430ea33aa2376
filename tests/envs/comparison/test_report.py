import pytest

from envs.comparison.report import compare_methods, comparison_table
from envs.comparison.suite_results import in_track


def scores(values, condition="clear"):
    return {(condition, course): value for course, value in enumerate(values)}


TRUTH = scores([(1.0, 0.9), (1.0, 0.8), (1.0, 1.0), (0.0, 0.0)])
EYES = scores([(1.0, 0.7), (0.0, 0.0), (1.0, 0.8), (0.0, 0.0)])


def test_the_differences_are_paired_by_course():
    rows = compare_methods({"truth": TRUTH, "eyes": EYES})
    assert [(row["condition"], row["method"]) for row in rows] == [
        ("clear", "truth"), ("clear", "eyes"), ("all", "truth"), ("all", "eyes")
    ]  # fmt: skip
    less = rows[1]["less"]
    assert less["difference"] == pytest.approx(-0.25) and less["spl_difference"] == pytest.approx(-0.3)
    low, high = less["spl_interval"]
    assert low < -0.3 < high <= 0
    assert rows[0]["less"] is None and rows[2]["success_interval"] is None


def test_only_episodes_that_all_have_driven_count():
    part = dict(list(EYES.items())[:2])
    rows = compare_methods({"truth": {**TRUTH, **scores([(1.0, 1.0)], "storm")}, "eyes": part})
    assert {row["condition"] for row in rows} == {"clear", "all"} and {row["episodes"] for row in rows} == {2}
    with pytest.raises(ValueError, match="no episode in common"):
        compare_methods({"truth": TRUTH, "eyes": scores([(1.0, 1.0)], "storm")})


def test_a_difference_that_is_the_same_everywhere_has_no_interval():
    better = scores([(1.0, 0.5)] * 4)
    table = comparison_table(compare_methods({"first": scores([(0.0, 0.0)] * 4), "better": better}))
    assert "| clear | better | 4 | 100 % (51 to 100) | 0.500 | +100 points | +0.500 |" in table
    assert "The differences are those to first on the same courses" in table


def test_a_track_holds_what_it_fixes():
    assert in_track("eyes", ("navigator", "sgbm")) and not in_track("eyes", ("straight", "sgbm"))
    assert in_track("drivers", ("straight", "ground_truth")) and not in_track("drivers", ("navigator", "sgbm"))
    assert in_track("both", ("straight", "sgbm"))
