"""Findings from figures that are known."""

import numpy as np
import pytest
from ablation_scores import levels, score
from matplotlib.figure import Figure
from scipy.stats import t as student

from m3depth.ablation.figure import study_figure
from m3depth.ablation.findings import findings
from m3depth.ablation.studies import STUDIES


def marks(figure: Figure, title: str) -> dict[str, float]:
    """Our changes [%] in a panel of a study's figure, by the label of their row."""
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    panel = next(ax for ax in figure.axes if ax.get_title() == title)
    dots = (line for line in panel.lines if line.get_marker() == "o" and len(line.get_xdata()))
    return {labels[round(line.get_ydata()[0])]: float(line.get_xdata()[0]) for line in dots}


def test_verdicts_follow_the_sign_and_the_interval() -> None:
    report = findings(STUDIES["levels"], levels([1.0, 0.9, 0.8, 0.8004], noise=0.01))
    verdicts = [part["verdict"] for part in report["comparisons"]]
    assert verdicts == ["agrees", "disagrees", "undecided"]  # paper: falls, rises, rises
    first = report["comparisons"][0]
    assert first["paper"] == pytest.approx(0.084 / 0.095 - 1)
    assert first["here"] == pytest.approx(-0.1, abs=0.01)
    assert first["interval"][0] < first["here"] < first["interval"][1] < -0.08
    assert first["sentence"].startswith("3 levels instead of 2. Paper: Abs Rel falls by 11.6 %; here it falls by ")
    ends = student.interval(0.95, 1, np.mean(first["by_seed"]), np.std(first["by_seed"], ddof=1) / 2**0.5)
    assert first["seed_interval"] == pytest.approx(ends)
    assert f" % over scenes, {100 * ends[0]:+.1f} to {100 * ends[1]:+.1f} % over seeds; geom" in first["sentence"]
    assert first["sentence"].endswith(" over seeds): **agrees**.")


def test_verdicts_of_one_seed_are_provisional() -> None:
    scores = levels([1.0, 0.9, 0.8, 0.8004], noise=0.01)
    for by_seed in scores.values():
        del by_seed[1]
    report = findings(STUDIES["levels"], scores)
    verdicts = [part["verdict"] for part in report["comparisons"]]
    assert verdicts == ["agrees, provisional", "disagrees, provisional", "undecided"]
    assert report["comparisons"][0]["sentence"].endswith("**agrees, provisional**.")


def test_seeds_that_differ_as_much_as_the_change_decide_nothing() -> None:
    scores = levels([1.0, 0.5, 0.5, 0.5])
    for record in scores["levels-3"][1]["per_pair"]:
        record["M3Depth"]["abs_rel"] *= 2.2
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["interval"][1] < 0 and part["by_seed"] == pytest.approx([-0.5, 0.1])
    assert part["seed_interval"][1] > 0 and part["verdict"] == "undecided"
    assert part["typical_by_seed"] == pytest.approx([-0.5, 0.1])


def test_pairs_of_one_difficulty_cancel() -> None:
    """Paired: a ratio that all pairs share is known exactly, however much the pairs differ."""
    report = findings(STUDIES["levels"], levels([1.0, 1.5, 1.5, 3.0]))
    for part, ratio in zip(report["comparisons"], (0.5, 0.0, 1.0), strict=True):
        np.testing.assert_allclose([part["here"], *part["interval"], *part["by_seed"]], ratio, atol=1e-12)
    assert [row["against_reference"]["abs_rel"]["here"] for row in report["rows"]] == pytest.approx([-1 / 3, 0, 0, 1])


def test_an_interval_that_touches_zero_decides_nothing() -> None:
    part = findings(STUDIES["levels"], levels([1.0, 1.5, 1.5, 3.0]))["comparisons"][1]
    assert tuple(part["interval"]) == (0, 0) and part["verdict"] == "undecided"


def test_views_of_a_scene_are_drawn_together() -> None:
    """Five equal views each of six scenes: the interval is that of six, not of thirty."""
    rng = np.random.default_rng(3)
    scenes = {name: np.repeat(rng.uniform(0.5, 2, 6), 5) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    change = np.repeat(np.exp(0.2 * rng.normal(size=6)), 5)
    widths = {}
    for views in (1, 5):
        scores = {row.variant.name: {0: score(scenes, views)} for row in STUDIES["levels"].rows}
        scores["levels-3"] = {0: score({name: x * change for name, x in scenes.items()}, views)}
        report = findings(STUDIES["levels"], scores)
        low, high = report["comparisons"][0]["interval"]
        widths[views], count = high - low, report["all_scenes"]
        assert count == 30 // views
    assert widths[5] / widths[1] == pytest.approx(5**0.5, rel=0.3)


def test_no_interval_has_an_error_that_falls_by_more_than_all_of_it() -> None:
    names = ("abs_rel", "sq_rel", "rmse", "delta1")
    scores = {row.variant.name: {0: score(dict.fromkeys(names, np.ones(4)))} for row in STUDIES["levels"].rows}
    scores["levels-3"] = {0: score(dict.fromkeys(names, np.array([0.01, 0.01, 0.01, 0.9])))}
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["here"] == pytest.approx(0.93 / 4 - 1) and part["interval"][0] == -1


def test_one_scene_gives_no_interval_and_no_verdict(tmp_path, drawn_figures) -> None:
    pairs = {name: np.linspace(1, 2, 10) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    scores = {row.variant.name: {0: score(pairs, views=10)} for row in STUDIES["levels"].rows}
    scores["levels-3"] = {0: score({name: 0.9 * x for name, x in pairs.items()}, views=10)}
    report = findings(STUDIES["levels"], scores)
    part = report["comparisons"][0]
    assert (part["interval"], part["verdict"]) == (None, None)
    assert part["sentence"].endswith("here it falls by 10.0 % (no interval).")
    study_figure(report, tmp_path / "levels.png")
    ours = marks(drawn_figures[0], "Abs Rel")
    assert ours == pytest.approx({"2": 100 / 9, "3": 0, "4": 100 / 9, "5": 100 / 9})  # the row of 3 is the reference


def test_one_image_with_a_large_error_does_not_decide_the_geometric_mean() -> None:
    scores = levels([1.0, 0.9, 0.9, 0.9])
    for by_seed in scores["levels-3"].values():
        by_seed["per_pair"][0]["M3Depth"]["abs_rel"] *= 10
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    pairs = len(scores["levels-3"][0]["per_pair"])
    assert part["here"] > 0 and part["typical"] == pytest.approx(0.9 * 10 ** (1 / pairs) - 1)
    low, high = part["typical_interval"]
    assert low < -0.1 < part["typical"] < high
    assert "; geometric mean -" in part["sentence"]


def test_a_mean_that_a_few_images_decide_gives_no_verdict() -> None:
    """Its interval may lie beyond zero, but that of the geometric mean does not."""
    images = np.full(40, 0.05)
    images[:5] = 3.0
    names = ("abs_rel", "sq_rel", "rmse", "delta1")
    better = images * np.where(images > 1, 0.8, np.exp(0.2 * np.random.default_rng(0).normal(size=40)))
    scores = {row.variant.name: {0: score(dict.fromkeys(names, images))} for row in STUDIES["levels"].rows}
    scores["levels-3"] = {0: score(dict.fromkeys(names, better))}
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["interval"][1] < 0 < part["typical_interval"][1]
    assert part["verdict"] == "undecided"


def test_errors_of_zero_in_most_scenes_give_no_interval_and_no_verdict() -> None:
    """Samples of scenes without errors have no relative change."""
    pairs = {name: np.array([0.0, 0, 0, 1]) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    scores = {row.variant.name: {0: score(pairs, views=1)} for row in STUDIES["levels"].rows}
    scores["levels-3"] = {0: score({name: 2 * x for name, x in pairs.items()}, views=1)}
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["here"] == 1 and (part["interval"], part["verdict"]) == (None, None)
    assert (part["typical"], part["typical_interval"]) == (None, None)


def test_runs_on_other_pairs_are_not_compared() -> None:
    pairs = {name: np.linspace(1, 2, 10) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    for change in ("name", "count"):
        scores = {row.variant.name: {0: score(pairs, views=1)} for row in STUDIES["levels"].rows}
        records = scores["levels-3"][0]["per_pair"]
        if change == "name":
            records[3]["pair"] = "another"
        else:
            del records[-1]
        with pytest.raises(
            ValueError, match=r"levels-3-0 was scored on other pairs than .*delete runs/levels-3-0/score\.json"
        ):
            findings(STUDIES["levels"], scores)


def test_pairs_of_rows_in_the_opposite_order_are_counted() -> None:
    order = findings(STUDIES["levels"], levels([1.0, 2.0, 3.0, 4.0]))["order"][0]
    assert order["paper"] == ["3", "4", "5", "2"] and order["here"] == ["2", "3", "4", "5"]
    assert (order["turned"], order["of"]) == (3, 6)  # 2 stands before 3, 4 and 5


def test_missing_figures_are_reported_as_not_measured_yet() -> None:
    report = findings(STUDIES["levels"], levels([1.0, 0.9, None, None]))
    assert [part["verdict"] for part in report["comparisons"]] == ["agrees", None, None]
    assert "here it is not measured yet" in report["comparisons"][1]["sentence"]
    assert report["rows"][2]["here"]["abs_rel"] is None and report["order"][0]["of"] == 1


def test_seeds_are_compared_with_themselves() -> None:
    """A seed that one of two runs lacks is left out of their comparison."""
    scores = levels([1.0, 0.9, 1.0, 1.0])
    for name, factor in (("levels-2", 2.0), ("levels-3", 2.4 / 0.9)):
        for record in scores[name][1]["per_pair"]:
            record["M3Depth"]["abs_rel"] *= factor
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["here"] == pytest.approx((0.9 + 2.4) / (1.0 + 2.0) - 1) and part["by_seed"] == pytest.approx(
        [-0.1, 0.2]
    )
    del scores["levels-2"][0]
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["here"] == pytest.approx(0.2) and part["by_seed"] == pytest.approx([0.2])


def test_the_rows_of_a_table_are_means_over_the_same_seeds() -> None:
    """One row lacks the second seed, which has twice the errors, so the table and the sentences leave it out."""
    scores = levels([1.0, 0.9, 1.0, None])
    alone = findings(STUDIES["levels"], {name: {0: runs[0]} if runs else {} for name, runs in scores.items()})
    for runs in scores.values():
        for record in runs[1]["per_pair"] if runs else ():
            record["M3Depth"] = {name: 2 * figure for name, figure in record["M3Depth"].items()}
    del scores["levels-2"][1]
    report = findings(STUDIES["levels"], scores)
    assert [row["here"] for row in report["rows"]] == [row["here"] for row in alone["rows"]]
    assert all(set(row["by_seed"]) == {"0"} for row in report["rows"][:3])
    assert [part["sentence"] for part in report["comparisons"]] == [part["sentence"] for part in alone["comparisons"]]


def test_normals_without_truth_leave_their_columns_empty() -> None:
    figures = {name: np.ones(4) for name in ("abs_rel", "sq_rel", "rmse", "log10", "delta1")}
    scores = {row.variant.name: {0: score(figures)} for row in STUDIES["components"].rows}
    report = findings(STUDIES["components"], scores)
    assert {part["verdict"] for part in report["comparisons"] if part["measure"] == "normal_mean"} == {None}
    assert all(row["here"]["normal_mean"] is None for row in report["rows"])


def test_rows_without_figures_of_the_paper_have_no_order() -> None:
    """The paper has no normals beside the weights of the loss."""
    study = STUDIES["consistency"]
    scores = {row.variant.name: {0: score({name: [1.0, 2.0] for name in study.columns})} for row in study.rows}
    (order,) = findings(study, scores)["order"]
    assert order["measure"] == "abs_rel" and order["of"] == 1
    assert findings(STUDIES["parts"], {row.variant.name: {} for row in STUDIES["parts"].rows})["order"] == []
