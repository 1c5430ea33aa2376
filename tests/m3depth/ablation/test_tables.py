"""The report of figures that are known."""

from dataclasses import replace

import numpy as np
import pytest
from ablation_scores import ABOUT, levels, score

from m3depth.ablation.figure import study_figure
from m3depth.ablation.findings import findings
from m3depth.ablation.studies import STUDIES
from m3depth.ablation.tables import markdown
from m3depth.evaluation.scoring import evaluate
from m3depth.stereo.prediction import Prediction


def test_runs_of_several_states_of_the_code_give_a_warning() -> None:
    scores = levels([1.0, 0.9, 0.8, 0.8])
    assert "may not compare" not in markdown(ABOUT, {"levels": findings(STUDIES["levels"], scores)})
    scores["levels-3"][1]["device"] = "cuda"
    text = markdown(ABOUT, {"levels": findings(STUDIES["levels"], scores)})
    assert "**These runs may not compare: they are of several states of the code, devices or runtimes (" in text
    assert "0123456789ab on cpu, 0123456789ab on cuda).**" in text
    for of_row in scores.values():
        for number, run in of_row.items():
            run["device"], run["runtime"] = "cpu", f"pytorch 2.13.0 cpu {'bf16' if number else 'fp32'}"
    text = markdown(ABOUT, {"levels": findings(STUDIES["levels"], scores)})
    assert "0123456789ab on pytorch 2.13.0 cpu bf16, 0123456789ab on pytorch 2.13.0 cpu fp32).**" in text


class Guess:
    """Depths that are too far by a share, a little more from pair to pair."""

    def __init__(self, samples, share: float) -> None:
        self.samples, self.share, self.calls = samples, share, -1  # evaluate shows the first pair twice

    def infer(self, left, right, rig) -> Prediction:
        sample = self.samples[max(self.calls, 0)]
        self.calls += 1
        depth = sample.depth * np.float32(1 + self.share * (2 + self.calls))
        return Prediction(depth, rig.depth_to_disparity(depth), sample.normal, np.ones_like(depth))


def test_a_pair_without_a_scored_pixel_is_left_out_of_every_run(plane_samples) -> None:
    """The record of such a pair has its seconds and no figures."""
    empty = replace(plane_samples[1], valid=np.zeros_like(plane_samples[1].valid))
    samples = [plane_samples[0], empty, *plane_samples[2:]]
    scores = {}
    for row, share in zip(STUDIES["levels"].rows, (0.02, 0.01, 0.01, 0.01), strict=True):
        done = evaluate(samples, {"M3Depth": Guess(samples, share)})
        assert done.pairs[1]["M3Depth"].keys() == {"seconds", "kinds", "counts"}
        about = {"parameters": 1, "code": "0123456789ab", "device": "cpu", "steps": 1, "minutes": 1.0}
        scores[row.variant.name] = {0: {**about, "result": done.results["M3Depth"], "per_pair": done.pairs}}
    report = findings(STUDIES["levels"], scores)
    assert report["comparisons"][0]["here"] == pytest.approx(-0.5, rel=1e-3)
    pooled = [scores["levels-2"][0]["per_pair"][i]["M3Depth"]["abs_rel"] for i in (0, 2, 3)]
    assert report["rows"][0]["here"]["abs_rel"] == pytest.approx(np.mean(pooled))
    assert report["pairs"]["abs_rel"] == 3 and report["all_pairs"] == 4
    text = markdown({**ABOUT, "depth_range_m": (0.0, np.inf)}, {"levels": report})
    assert "Over 3 of the 4 test pairs" in text and "every pixel of known true depth." in text


def test_the_report_has_the_papers_figures_beside_ours() -> None:
    text = markdown(ABOUT, {"levels": findings(STUDIES["levels"], levels([1.0, 0.9, 0.8, 0.8]))})
    assert "Every run: 100 steps on split train of `data/train`" in text and "seed 0, 1" in text
    here = f"{0.9 * np.random.default_rng(0).uniform(0.5, 2, 30).mean():.3f}"
    row = next(line for line in text.splitlines() if line.startswith("| 3 | 0.084 |"))
    assert row == f"| 3 | 0.084 | {here} | 0.059 | {here} | 0.308 | {here} | 0.912 | {here} |"
    assert "| 3 | 1.50 | 100 | 2.000 | 0.5000 | 0.02 | - |" in text
    assert "| Levels of the wavelet transform | 1 | 1 | 1 |" in text and "Provisional" not in text
    assert "every pixel of true depth 0.5 to 15 m." in text and "test pairs:" not in text
    assert "![levels](levels.png)" in text and "of one seed" not in text


def test_verdicts_of_one_seed_are_counted_as_provisional() -> None:
    scores = levels([1.0, 0.9, 0.8, 0.8004], noise=0.01)
    for by_seed in scores.values():
        del by_seed[1]
    text = markdown({**ABOUT, "seeds": [0]}, {"levels": findings(STUDIES["levels"], scores)})
    assert "| Levels of the wavelet transform | 1, provisional | 1, provisional | 1 |" in text
    assert "without chance in training. Geometric mean: " in text and text.count("Provisional: of one seed, so ") == 1
    scores = levels([1.0, 0.9, 0.8, 1.0])
    del scores["levels-5"][1]
    text = markdown({**ABOUT, "failed": ["levels-5-1"]}, {"levels": findings(STUDIES["levels"], scores)})
    assert "| Levels of the wavelet transform | 2, provisional | 1, provisional | 0 |" in text
    assert "\nMeans over seed 0 only: the other seeds are not scored for every row.\n" in text
    assert "**Left out, since their loss was not finite: levels-5-1.**" in text
    del scores["levels-2"][0]
    text = markdown(ABOUT, {"levels": findings(STUDIES["levels"], scores)})
    assert "\nNo seed is scored for every row yet, so this table has no figures.\n" in text


@pytest.mark.parametrize(
    ("scenes", "steps", "warning"),
    [
        (2, 2, "2 scenes in the test set (under 20, intervals mean nothing) and 2 steps (under 200, a network has"),
        (20, 199, "for any conclusion: 199 steps (under 200"),
        (19, 200, "for any conclusion: 19 scenes in the test set (under 20, intervals mean nothing).**"),
        (20, 200, None),
    ],
)
def test_too_small_a_test_set_or_budget_is_warned_of_before_the_tables(scenes, steps, warning) -> None:
    study = findings(STUDIES["levels"], levels([1.0, 0.9, 0.8, 0.8]))
    study["all_scenes"] = scenes
    for row in study["rows"]:
        for run in row["runs"]:
            run["steps"] = max(run["steps"], 200) if run is not study["rows"][1]["runs"][0] else steps
    text = markdown(ABOUT, {"levels": study})
    assert ("Too small for any conclusion" in text) == (warning is not None)
    assert warning is None or (warning in text and text.index(warning) < text.index("| study |"))


def test_a_study_that_the_paper_lacks_shows_our_figures_alone(tmp_path, drawn_figures) -> None:
    study = STUDIES["parts"]
    names = study.columns
    scores = {row.variant.name: {0: score({name: np.full(4, 0.5) for name in names})} for row in study.rows}
    scores["no-convex"] = {0: score({name: np.full(4, 0.8) for name in names})}
    scores["no-steps"] = {}
    report = findings(study, scores)
    assert report["order"] == [] and {part["verdict"] for part in report["comparisons"]} == {None}
    text = markdown(ABOUT, {"parts": report})
    assert "The paper has no such table." in text and "Paper: " not in text
    assert "| Parts beside the recurrent steps | - | - | - | - |" in text
    assert "| no convex upsampling | 0.8000 | 0.8000 | 0.8000 | 0.8000 |\n" in text
    falls = "Abs Rel falls by 37.5 % (95 % interval -37.5 to -37.5 %; geometric mean -37.5 %, -37.5 to -37.5 %)."
    assert f"- Convex upsampling. Here {falls}" in text
    assert "- Recurrent steps, beside the other parts. Here it is not measured yet." in text
    study_figure(report, tmp_path / "parts.png")
    labels = [label.get_text() for label in drawn_figures[0].axes[0].get_yticklabels()]
    bars = {
        labels[round(y[0])]: x for x, y in (line.get_data() for line in drawn_figures[0].axes[0].lines) if len(x) == 2
    }
    assert bars["no convex upsampling"] == pytest.approx([60, 60])
    assert "no recurrent steps" in labels and "no recurrent steps" not in bars
