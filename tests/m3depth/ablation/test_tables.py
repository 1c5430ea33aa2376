"""What is said of figures that are known."""

from dataclasses import replace

import numpy as np
import pytest

from m3depth.ablation.figure import study_figure
from m3depth.ablation.studies import STUDIES
from m3depth.ablation.tables import findings, markdown
from m3depth.evaluation.scoring import evaluate
from m3depth.stereo.prediction import Prediction

ABOUT = {
    "preset": "lite", "steps": 100, "minutes": None, "batch": 4, "crop": [256, 448], "data": ["data/train"],
    "test": "data/train", "limit": None, "seeds": [0, 1], "versions": {"torch": "2"}, "depth_range_m": (0.5, 15.0),
}  # fmt: skip


def score(figures: dict[str, np.ndarray], views: int = 1) -> dict:
    """score.json of a run with these figures, (pairs,) each, so many pairs a scene."""
    count = len(next(iter(figures.values())))
    records = [
        {
            "index": i,
            "pair": f"left/{i}",
            "scene": str(i // views),
            "M3Depth": {name: float(x[i]) for name, x in figures.items()},
        }
        for i in range(count)
    ]
    return {
        "parameters": 1_500_000, "code": "0123456789ab", "device": "cpu", "steps": 100, "minutes": 2.0,
        "per_pair": records, "result": {"seconds": {"median": 0.5}},
    }  # fmt: skip


def levels(changes: list[float | None], noise: float = 0.0) -> dict:
    """Scores of the levels study: Abs Rel of each row is so many times that of hard and easy pairs."""
    rng = np.random.default_rng(0)
    pairs = rng.uniform(0.5, 2, 30)
    scores = {}
    for row, factor in zip(STUDIES["levels"].rows, changes, strict=True):
        known = {}
        for seed in range(2):
            x = pairs * (factor or 0) * np.exp(noise * rng.normal(size=30))
            known[seed] = score({name: x for name in ("abs_rel", "sq_rel", "rmse", "delta1")})
        scores[row.variant.name] = {} if factor is None else known
    return scores


def test_verdicts_follow_the_sign_and_the_interval() -> None:
    found = findings(STUDIES["levels"], levels([1.0, 0.9, 0.8, 0.8004], noise=0.01))
    verdicts = [part["verdict"] for part in found["comparisons"]]
    assert verdicts == ["agrees", "disagrees", "undecided"]  # paper: falls, rises, rises
    first = found["comparisons"][0]
    assert first["paper"] == pytest.approx(0.084 / 0.095 - 1)
    assert first["here"] == pytest.approx(-0.1, abs=0.01)
    assert first["interval"][0] < first["here"] < first["interval"][1] < -0.08
    assert first["sentence"].startswith("3 levels instead of 2. Paper: Abs Rel falls by 11.6 %; here it falls by ")
    assert "the same sign with 2 of 2 seeds" in first["sentence"] and first["sentence"].endswith("**agrees**.")


def test_seeds_that_differ_in_sign_decide_nothing() -> None:
    scores = levels([1.0, 0.5, 0.5, 0.5])
    for record in scores["levels-3"][1]["per_pair"]:
        record["M3Depth"]["abs_rel"] *= 2.2
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["interval"][1] < 0 and part["by_seed"] == pytest.approx([-0.5, 0.1])
    assert part["verdict"] == "undecided" and "the same sign with 1 of 2 seeds" in part["sentence"]


def test_pairs_of_one_difficulty_cancel() -> None:
    """Paired: a ratio that all pairs share is known exactly, however much the pairs differ."""
    found = findings(STUDIES["levels"], levels([1.0, 1.5, 1.5, 3.0]))
    for part, ratio in zip(found["comparisons"], (0.5, 0.0, 1.0), strict=True):
        np.testing.assert_allclose([part["here"], *part["interval"], *part["by_seed"]], ratio, atol=1e-12)
    assert [row["against_reference"]["abs_rel"]["here"] for row in found["rows"]] == pytest.approx([-1 / 3, 0, 0, 1])


def test_views_of_a_scene_are_drawn_together() -> None:
    """Five views each of six scenes, alike in every figure: the interval is that of six, not of thirty."""
    rng = np.random.default_rng(3)
    scenes = {name: np.repeat(rng.uniform(0.5, 2, 6), 5) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    change = np.repeat(np.exp(0.2 * rng.normal(size=6)), 5)
    widths = {}
    for views in (1, 5):
        scores = {row.variant.name: {0: score(scenes, views)} for row in STUDIES["levels"].rows}
        scores["levels-3"] = {0: score({name: x * change for name, x in scenes.items()}, views)}
        found = findings(STUDIES["levels"], scores)
        low, high = found["comparisons"][0]["interval"]
        widths[views], count = high - low, found["all_scenes"]
        assert count == 30 // views
    assert widths[5] / widths[1] == pytest.approx(5**0.5, rel=0.3)


def test_one_scene_gives_no_interval_and_no_verdict(tmp_path) -> None:
    pairs = {name: np.linspace(1, 2, 10) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    scores = {row.variant.name: {0: score(pairs, views=10)} for row in STUDIES["levels"].rows}
    scores["levels-3"] = {0: score({name: 0.9 * x for name, x in pairs.items()}, views=10)}
    found = findings(STUDIES["levels"], scores)
    part = found["comparisons"][0]
    assert (part["interval"], part["verdict"]) == (None, None)
    assert part["sentence"].endswith("here it falls by 10.0 % (no interval).")
    study_figure(found, path := tmp_path / "levels.png")
    assert path.stat().st_size > 10_000


def test_errors_of_nothing_in_most_scenes_give_no_interval_and_no_verdict() -> None:
    """Samples of scenes in which nobody errs have no relative change."""
    pairs = {name: np.array([0.0, 0, 0, 1]) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    scores = {row.variant.name: {0: score(pairs, views=1)} for row in STUDIES["levels"].rows}
    scores["levels-3"] = {0: score({name: 2 * x for name, x in pairs.items()}, views=1)}
    part = findings(STUDIES["levels"], scores)["comparisons"][0]
    assert part["here"] == 1 and (part["interval"], part["verdict"]) == (None, None)


def test_runs_on_other_pairs_are_not_compared() -> None:
    pairs = {name: np.linspace(1, 2, 10) for name in ("abs_rel", "sq_rel", "rmse", "delta1")}
    for change in ("name", "count"):
        scores = {row.variant.name: {0: score(pairs, views=1)} for row in STUDIES["levels"].rows}
        records = scores["levels-3"][0]["per_pair"]
        if change == "name":
            records[3]["pair"] = "another"
        else:
            del records[-1]
        with pytest.raises(ValueError, match=r"levels-3-0 was scored on other pairs than .*delete its score\.json"):
            findings(STUDIES["levels"], scores)


def test_runs_of_several_states_of_the_code_are_told() -> None:
    scores = levels([1.0, 0.9, 0.8, 0.8])
    assert "may not compare" not in markdown(ABOUT, {"levels": findings(STUDIES["levels"], scores)})
    scores["levels-3"][1]["device"] = "cuda"
    text = markdown(ABOUT, {"levels": findings(STUDIES["levels"], scores)})
    assert "**These runs may not compare, of several states of the code or devices: " in text
    assert "0123456789ab on cpu, 0123456789ab on cuda.**" in text


def test_the_order_counts_what_is_turned() -> None:
    order = findings(STUDIES["levels"], levels([1.0, 2.0, 3.0, 4.0]))["order"][0]
    assert order["paper"] == ["3", "4", "5", "2"] and order["here"] == ["2", "3", "4", "5"]
    assert (order["turned"], order["of"]) == (3, 6)  # 2 stands before 3, 4 and 5


def test_what_is_not_measured_yet_is_told() -> None:
    found = findings(STUDIES["levels"], levels([1.0, 0.9, None, None]))
    assert [part["verdict"] for part in found["comparisons"]] == ["agrees", None, None]
    assert "here it is not measured yet" in found["comparisons"][1]["sentence"]
    assert found["rows"][2]["here"]["abs_rel"] is None and found["order"][0]["of"] == 1


def test_seeds_are_compared_with_themselves() -> None:
    """A seed that one of two runs lacks is left out of their comparison."""
    scores = levels([1.0, 0.9, 1.0, 1.0])
    del scores["levels-2"][0]
    assert len(findings(STUDIES["levels"], scores)["comparisons"][0]["by_seed"]) == 1


def test_normals_without_truth_leave_their_columns_empty() -> None:
    figures = {name: np.ones(4) for name in ("abs_rel", "sq_rel", "rmse", "log10", "delta1")}
    scores = {row.variant.name: {0: score(figures)} for row in STUDIES["components"].rows}
    found = findings(STUDIES["components"], scores)
    assert {part["verdict"] for part in found["comparisons"] if part["measure"] == "normal_mean"} == {None}
    assert all(row["here"]["normal_mean"] is None for row in found["rows"])


class Guess:
    """Depths that are too far by a share, a little more from pair to pair."""

    def __init__(self, samples, share: float) -> None:
        self.samples, self.share, self.seen = samples, share, -1  # evaluate shows the first pair twice

    def infer(self, left, right, rig) -> Prediction:
        sample = self.samples[max(self.seen, 0)]
        self.seen += 1
        depth = sample.depth * np.float32(1 + self.share * (2 + self.seen))
        return Prediction(depth, rig.depth_to_disparity(depth), sample.normal, np.ones_like(depth))


def test_a_pair_without_a_scored_pixel_is_left_out_of_every_run(plane_samples) -> None:
    """As evaluate records it: the pair has its seconds and no figure."""
    empty = replace(plane_samples[1], valid=np.zeros_like(plane_samples[1].valid))
    samples = [plane_samples[0], empty, *plane_samples[2:]]
    scores = {}
    for row, share in zip(STUDIES["levels"].rows, (0.02, 0.01, 0.01, 0.01), strict=True):
        done = evaluate(samples, {"M3Depth": Guess(samples, share)})
        assert done.pairs[1]["M3Depth"].keys() == {"seconds"}
        about = {"parameters": 1, "code": "0123456789ab", "device": "cpu", "steps": 1, "minutes": 1.0}
        scores[row.variant.name] = {0: {**about, "result": done.results["M3Depth"], "per_pair": done.pairs}}
    found = findings(STUDIES["levels"], scores)
    assert found["comparisons"][0]["here"] == pytest.approx(-0.5, rel=1e-3)
    pooled = [scores["levels-2"][0]["per_pair"][i]["M3Depth"]["abs_rel"] for i in (0, 2, 3)]
    assert found["rows"][0]["here"]["abs_rel"] == pytest.approx(np.mean(pooled))
    assert found["pairs"]["abs_rel"] == 3 and found["all_pairs"] == 4
    text = markdown({**ABOUT, "depth_range_m": (0.0, np.inf)}, {"levels": found})
    assert "Over 3 of the 4 test pairs" in text and "every pixel of known true depth;" in text


def test_the_report_has_the_papers_figures_beside_ours() -> None:
    text = markdown(ABOUT, {"levels": findings(STUDIES["levels"], levels([1.0, 0.9, 0.8, 0.8]))})
    assert "Every run: 100 steps on split train of `data/train`" in text and "seed 0, 1" in text
    here = f"{0.9 * np.random.default_rng(0).uniform(0.5, 2, 30).mean():.3f}"
    row = next(line for line in text.splitlines() if line.startswith("| 3 | 0.084 |"))
    assert row == f"| 3 | 0.084 | {here} | 0.059 | {here} | 0.308 | {here} | 0.912 | {here} |"
    assert "| 3 | 1.50 | 100 | 2.000 | 0.5000 |" in text
    assert "| Levels of the wavelet transform | 1 | 1 | 1 |" in text
    assert "every pixel of true depth 0.5 to 15 m;" in text and "test pairs:" not in text
    assert "![levels](levels.png)" in text and "With one seed" not in text


@pytest.mark.parametrize(
    ("scenes", "steps", "said"),
    [
        (2, 2, "2 scenes in the test set (under 20, intervals mean nothing) and 2 steps (under 200, a network has"),
        (20, 199, "anything, agreement or not: 199 steps (under 200"),
        (19, 200, "anything, agreement or not: 19 scenes in the test set (under 20, intervals mean nothing).**"),
        (20, 200, None),
    ],
)
def test_too_little_to_tell_is_said_before_the_tables(scenes, steps, said) -> None:
    study = findings(STUDIES["levels"], levels([1.0, 0.9, 0.8, 0.8]))
    study["all_scenes"] = scenes
    for row in study["rows"]:
        for run in row["runs"]:
            run["steps"] = max(run["steps"], 200) if run is not study["rows"][1]["runs"][0] else steps
    text = markdown(ABOUT, {"levels": study})
    assert ("Too little to tell" in text) == (said is not None)
    assert said is None or (said in text and text.index(said) < text.index("| study |"))
