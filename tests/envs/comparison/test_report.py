from dataclasses import replace

import numpy as np
import pytest

from envs.comparison.methods import DrivenMethod
from envs.comparison.plots import plot_comparison
from envs.comparison.report import compare_methods, comparison_notes, comparison_table
from envs.drives.metrics import effective_drives, newcombe_interval, spl_interval, wilson_interval


def driven(spls, condition="clear"):
    """A method that drove a condition; 0 for a drive that did not arrive."""
    episodes = {(condition, course): {"success": spl > 0, "spl": spl, "code": "aa"} for course, spl in enumerate(spls)}
    return DrivenMethod("navigator", "eyes", episodes)


def together(*methods):
    return DrivenMethod("navigator", "eyes", {key: value for m in methods for key, value in m.episodes.items()})


TRUTH = driven([0.9, 0.8, 1.0, 0.0])
EYES = driven([0.7, 0.0, 0.8, 0.0])


def test_the_differences_are_paired_by_course():
    rows = compare_methods({"truth": TRUTH, "eyes": EYES})
    assert [(row["condition"], row["method"]) for row in rows] == [
        ("clear", "truth"), ("clear", "eyes")
    ]  # fmt: skip
    less = rows[1]["less"]
    assert less["difference"] == pytest.approx(-0.25) and less["spl_difference"] == pytest.approx(-0.3)
    expected = spl_interval(np.array([-0.2, -0.8, -0.2, 0.0]), range(4), least=-1.0)
    assert less["spl_interval"] == pytest.approx(expected)
    assert rows[0]["less"] is None
    assert rows[0]["success_interval"] == pytest.approx([0.30, 0.95], abs=0.01)  # Wilson's
    assert less["interval"] == list(newcombe_interval(2, 0, 1, 1))
    both = (together(method, driven([1.0, 0.0, 1.0, 0.0], "storm")) for method in (TRUTH, EYES))
    row = compare_methods(dict(zip("ab", both, strict=True)))[-1]
    assert row["success_interval"] == list(wilson_interval(2, 4))  # alike under both conditions, so four drives count
    number = effective_drives(np.array([0.0, -1, 0, 0, 0, 0, 0, 0]), [*range(4), *range(4)])
    assert row["less"]["interval"] == pytest.approx(newcombe_interval(*(number / 8 * n for n in (4, 0, 1, 3))))


def test_over_all_conditions_each_episode_counts_alike_and_courses_are_drawn_as_one():
    first = together(driven([1.0] * 4), driven([1.0], "storm"))
    other = together(driven([1.0, 0.5, 1.0, 1.0]), driven([1.0], "storm"))
    overall = compare_methods({"first": first, "other": other})[-1]
    less = overall["less"]
    assert overall["episodes"] == 5 and overall["spl"] == pytest.approx(4.5 / 5)
    assert less["spl_difference"] == pytest.approx(overall["spl"] - 1)
    expected = spl_interval(np.array([0, -0.5, 0, 0, 0]), [0, 1, 2, 3, 0], least=-1.0)
    assert less["spl_interval"] == pytest.approx(expected)


def test_only_episodes_that_all_have_driven_count():
    part = driven([0.7, 0.0])
    rows = compare_methods({"truth": together(TRUTH, driven([1.0], "storm")), "eyes": part})
    assert {row["condition"] for row in rows} == {"clear"} and {row["episodes"] for row in rows} == {2}
    with pytest.raises(ValueError, match="no episode in common"):
        compare_methods({"truth": TRUTH, "eyes": driven([1.0], "storm")})


def test_a_difference_that_is_the_same_everywhere_has_no_interval_but_that_of_success_has():
    table = comparison_table(compare_methods({"first": driven([0.0] * 4), "a|b": driven([0.5] * 4)}))
    assert "| clear | a\\|b | 4 | 100 % (51 to 100) | 0.50 | +100 points (+31 to +100) | +0.50 |" in table
    assert "The differences are those to first on the same courses" in table
    two = [together(driven([spl] * 4), driven([spl] * 4, "storm")) for spl in (0.0, 0.5)]
    line = "| all | b | 8 on 4 courses | 100 % (51 to 100) | 0.50 | +100 points (+31 to +100) | +0.50 |"
    assert line in comparison_table(compare_methods(dict(zip("ab", two, strict=True))))


@pytest.mark.parametrize("courses", [1, 3, 4])
def test_fewer_than_four_courses_have_no_interval_of_spl(courses):
    spls = np.linspace(0.2, 0.8, courses) if courses > 1 else [0.5]
    few = [together(driven(values), driven([1.0] * courses, "storm")) for values in ([0.0] * courses, spls)]
    table = comparison_table(compare_methods(dict(zip("ab", few, strict=True))))
    (clear,) = [line for line in table.splitlines() if line.startswith("| clear | b |")]
    (overall,) = [line for line in table.splitlines() if line.startswith("| all | b |")]
    assert ("| 0.50 (" in clear) == ("| +0.50 (" in clear) == (courses == 4)
    assert "| 100 % (" in clear and "| +100 points (" in clear  # Wilson's and Newcombe's
    assert f"| {2 * courses} on {courses} courses | 100 % (" in overall
    assert ("| 0.75 (" in overall) == ("| +0.25 (" in overall) == (courses == 4)


def test_episodes_that_a_method_lacks_are_counted():
    methods = {"truth": together(TRUTH, driven([1.0], "storm")), "eyes": driven([0.7, 0.0])}
    first, *_ = comparison_notes(methods)
    assert first == "Compared on 2 episodes that all methods have driven; others left out: 3 (eyes lacks 3)."
    first, *_ = comparison_notes({"truth": TRUTH, "eyes": EYES})
    assert first == "Compared on 4 episodes that all methods have driven; others left out: 0."


def test_conditions_of_unequal_weight_are_reported():
    unequal = {"truth": together(TRUTH, driven([1.0], "storm"))}
    (note,) = [note for note in comparison_notes(unequal) if "weighs" in note]
    assert note.startswith("The conditions have 1 to 4 courses each, and the row all weighs each condition by its")
    equal = {"truth": together(TRUTH, driven([1.0] * 4, "storm"))}
    assert not any("weighs" in note for note in comparison_notes(equal))


def test_what_drove_a_method_is_reported():
    method = DrivenMethod("navigator", "m3depth", TRUTH.episodes, {"m3depth": "e2184584" * 8}, "openvino 2026.4.1")
    assert comparison_notes({"eyes": method})[1] == (
        "eyes: driven by code with SHA-256 aa, in openvino 2026.4.1, m3depth with SHA-256 e2184584e218."
    )
    classical = DrivenMethod("navigator", "my:Net", TRUTH.episodes, {"my:Net": "e2184584" * 8}, "openvino 2026.4.1")
    assert comparison_notes({"eyes": classical})[1] == (
        "eyes: driven by code with SHA-256 aa, my:Net with SHA-256 e2184584e218."
    )
    mixed = {key: {**episode, "code": "bb" if key[1] else ""} for key, episode in TRUTH.episodes.items()}
    assert comparison_notes({"eyes": DrivenMethod("navigator", "eyes", mixed)})[1] == (
        "eyes: driven by different states of the code (3 episodes by bb, 1 episode by an unknown state)."
    )


def test_different_code_is_reported():
    other = {key: {**episode, "code": "bb"} for key, episode in TRUTH.episodes.items()}
    methods = {"truth": TRUTH, "eyes": DrivenMethod("navigator", "eyes", other)}
    assert sum(note.startswith("Different code drove some") for note in comparison_notes(methods)) == 1
    assert not any("Different code" in note for note in comparison_notes({"truth": TRUTH, "eyes": EYES}))


def test_errors_of_the_depth_that_episodes_lack_are_counted():
    whole = {"abs_rel": 0.1, "rocks": 3, "false_obstacles": 0, "looks": 9, "near_ground": 100}
    episodes = {key: {**episode, **whole} for key, episode in EYES.episodes.items()}
    eyes = DrivenMethod("navigator", "eyes", episodes)
    truth = DrivenMethod("navigator", "ground_truth", TRUTH.episodes)
    assert not any("lacks" in note for note in comparison_notes({"truth": truth, "eyes": eyes})[1:])
    for key in list(episodes)[:2]:
        episodes[key] = {**episodes[key], "abs_rel": None}
    episodes[key].pop("near_ground")
    assert comparison_notes({"truth": truth, "eyes": eyes})[-1] == (
        "eyes lacks abs_rel in 2 episodes, near_ground in 1 episode: its figures for the depth rest on the others."
    )


@pytest.mark.parametrize("name", ["m3depth:w$1_$2", "_mine", r"$\frac$:C"])
def test_any_name_of_a_method_can_be_drawn(tmp_path, name, drawn_figures):
    rows = compare_methods({name: TRUTH, "eyes": EYES})
    plot_comparison(tmp_path / "comparison.png", rows)
    shown = [text.get_text() for text in drawn_figures[0].legends[0].get_texts()]
    assert [text.replace("\\$", "$").strip() for text in shown] == [f"{name} (first)", "eyes"]
    assert (tmp_path / "comparison.png").is_file()


def test_intervals_do_not_depend_on_the_order_of_the_episodes():
    rng = np.random.default_rng(0)
    method = driven([*rng.random(9)])
    other = replace(method, episodes=dict(reversed(method.episodes.items())))
    assert compare_methods({"a": method})[0] == compare_methods({"a": other})[0]
