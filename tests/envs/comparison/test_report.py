import pytest

from envs.comparison.report import compare_methods, comparison_table
from envs.comparison.suite_results import DrivenMethod, in_track


def driven(spls, condition="clear"):
    """A method that drove a condition; 0 for a drive that did not arrive."""
    episodes = {(condition, course): {"success": spl > 0, "spl": spl} for course, spl in enumerate(spls)}
    return DrivenMethod("navigator", "eyes", episodes)


def together(*methods):
    return DrivenMethod("navigator", "eyes", {key: value for m in methods for key, value in m.episodes.items()})


TRUTH = driven([0.9, 0.8, 1.0, 0.0])
EYES = driven([0.7, 0.0, 0.8, 0.0])


def test_the_differences_are_paired_by_course():
    rows = compare_methods({"truth": TRUTH, "eyes": EYES})
    assert [(row["condition"], row["method"]) for row in rows] == [
        ("clear", "truth"), ("clear", "eyes"), ("all", "truth"), ("all", "eyes")
    ]  # fmt: skip
    less = rows[1]["less"]
    assert less["difference"] == pytest.approx(-0.25) and less["spl_difference"] == pytest.approx(-0.3)
    low, high = less["spl_interval"]
    assert low < -0.3 < high <= 0
    assert rows[0]["less"] is None
    assert rows[0]["success_interval"] == pytest.approx([0.30, 0.95], abs=0.01)  # Wilson's
    low, high = rows[2]["success_interval"]  # by the bootstrap over the courses
    assert low == 0.25 and high == 1.0


def test_over_all_conditions_each_episode_counts_alike_and_courses_are_drawn_as_one():
    first = together(driven([1.0, 1.0]), driven([1.0], "storm"))
    other = together(driven([1.0, 0.5]), driven([1.0], "storm"))
    overall = compare_methods({"first": first, "other": other})[-1]
    less = overall["less"]
    assert overall["episodes"] == 3 and overall["spl"] == pytest.approx(2.5 / 3)
    assert less["spl_difference"] == pytest.approx(overall["spl"] - 1)
    assert less["spl_interval"] == pytest.approx([-0.5, 0])  # only course 1, or only course 0, which has two episodes


def test_only_episodes_that_all_have_driven_count():
    part = driven([0.7, 0.0])
    rows = compare_methods({"truth": together(TRUTH, driven([1.0], "storm")), "eyes": part})
    assert {row["condition"] for row in rows} == {"clear", "all"} and {row["episodes"] for row in rows} == {2}
    with pytest.raises(ValueError, match="no episode in common"):
        compare_methods({"truth": TRUTH, "eyes": driven([1.0], "storm")})


def test_a_difference_that_is_the_same_everywhere_has_no_interval():
    table = comparison_table(compare_methods({"first": driven([0.0] * 4), "a|b": driven([0.5] * 4)}))
    assert "| clear | a\\|b | 4 | 100 % (51 to 100) | 0.500 | +100 points | +0.500 |" in table
    assert "The differences are those to first on the same courses" in table


def test_a_track_holds_what_it_fixes():
    assert in_track("eyes", ("navigator", "sgbm")) and not in_track("eyes", ("straight", "sgbm"))
    assert in_track("drivers", ("straight", "ground_truth")) and not in_track("drivers", ("navigator", "sgbm"))
    assert in_track("both", ("straight", "sgbm"))
