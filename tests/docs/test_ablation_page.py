"""The page of the ablation has the reports of the scores beside it."""

import itertools
import json
import re
from pathlib import Path

import pytest

from m3depth.ablation.config import AblateOptions
from m3depth.ablation.findings import _change, _column, findings
from m3depth.ablation.studies import distinct
from m3depth.ablation.tables import markdown

ROOT = Path(__file__).parents[2] / "docs/results"
FOLDER = ROOT / "ablation"
LITE = "lite/results.json"


@pytest.mark.parametrize(
    ("file", "folder"),
    [("three_seeds.json", "runs"), ("one_seed.json", "runs"), ("levels.json", "levels"), (LITE, "lite/runs")],
)
def test_the_tables_are_those_of_the_scores(file: str, folder: str) -> None:
    results = json.loads((FOLDER / file).read_text())
    studies, preset = results.pop("studies"), results["preset"]
    options = AblateOptions(
        data=tuple(map(Path, results["data"])), out=FOLDER, studies=tuple(studies), steps=results["steps"],
        preset=preset, seeds=tuple(results["seeds"]),
    )  # fmt: skip
    chosen = options.chosen()
    files = {
        name: {seed: FOLDER / folder / f"{run.name}-{seed}" / "score.json" for seed in options.seeds}
        for name, run in distinct(chosen.values(), preset).items()
    }
    scores = {name: {s: json.loads(file.read_text()) for s, file in of_run.items()} for name, of_run in files.items()}
    assert {name: findings(study, scores) for name, study in chosen.items()} == studies
    _, report = markdown(results, studies).split("\n", 1)
    page, level, figures, beside = "ablation.md", "####", "ablation/", "paper"
    if file == LITE:
        page, level, figures, beside = "ablation-lite.md", "###", "ablation/lite/", "unchanged network"
    report = re.sub(r"!\[(\w+)\]\(", rf"![\1: the rows beside the {beside}]({figures}", report)
    assert report.replace("\n## ", f"\n{level} ") in (ROOT / page).read_text()


def test_every_run_says_which_network_it_is() -> None:
    runs = [run for folder in ("runs", "levels", "lite/runs") for run in (FOLDER / folder).iterdir()]
    assert len(runs) > 35 and all((run / "network.json").is_file() for run in runs)


def test_two_trainings_of_one_network_often_differ_beyond_the_interval_over_scenes() -> None:
    """As the page says: the interval does not include chance in training."""
    excluded = dict.fromkeys(("abs_rel", "normal_mean"), 0)
    networks = ("base", "no-wefe", "no-irm", "no-wefe-no-irm", "loss-2-1-0")
    for network, name in itertools.product(networks, excluded):
        files = [FOLDER / "runs" / f"{network}-{seed}" / "score.json" for seed in range(3)]
        runs = {str(seed): {0: json.loads(file.read_text())} for seed, file in enumerate(files)}
        column = _column(runs, name)
        for before, after in itertools.combinations(runs, 2):
            low, high = _change(column, before, after)["interval"]
            excluded[name] += not low <= 0 <= high
    text = " ".join((ROOT / "ablation.md").read_text().split())
    said = re.search(r"in (\d+) of 15 such comparisons for Abs Rel and in (\d+) for the mean error of the norm", text)
    assert said is not None and list(map(int, said.groups())) == list(excluded.values())


def test_the_page_of_lite_says_what_the_scores_without_weights_of_pixels_are() -> None:
    text = " ".join((ROOT / "ablation-lite.md").read_text().split())
    scores = [json.loads((FOLDER / f"lite/runs/{run}-0/score.json").read_text()) for run in ("base", "loss-plain")]
    results = [score["result"] for score in scores]
    near, far = ([mean_abs_rel(result, side) for result in results] for side in (True, False))
    assert f"an Abs Rel of {near[0]:.3f} with them and {near[1]:.3f} without" in text
    assert f"From 2 m on, it is {far[0]:.3f} with them and {far[1]:.3f} without" in text
    errors = [[pair["M3Depth"]["abs_rel"] for pair in score["per_pair"]] for score in scores]
    better = sum(one < other for one, other in zip(*errors, strict=True))
    assert f"{better} of the {len(errors[0])} images are more accurate with them" in text
    rocks = [result["rocks"]["standing_0.2_m_within_8_m"] for result in results]
    found = [each["both_eyes_found"] for each in rocks]
    assert f"of the {rocks[0]['both_eyes']} rocks of 0.2 m and more within 8 m that both eyes see, {found[0]}" in text
    assert (
        f"found instead of {found[1]}, with {rocks[0]['false']} false obstacles instead of {rocks[1]['false']}" in text
    )
    epe = [result["depth"]["rock"]["pooled"]["epe"] for result in results]
    on_rocks, on_ground = ([result["normal"][on]["pooled"]["mean"] for result in results] for on in ("rock", "ground"))
    assert f"EPE is {epe[0]:.1f} px instead of {epe[1]:.1f}" in text
    assert f"{on_rocks[0]:.0f}° instead of {on_rocks[1]:.0f}°" in text
    assert f"{on_ground[0]:.1f}° instead of {on_ground[1]:.1f}°" in text
    methods = json.loads((ROOT / "methods/methods.json").read_text())["sets"]["clean"]["intervals"]
    given = ("geo-net", "fusion", "fusion-true-depth", "lite, depth alone")  # which get the depth
    near_errors = {name: of["intervals"][1]["pooled"]["mae"] for name, of in methods.items() if name not in given}
    assert near_errors["lite"] == min(near_errors.values()) and f", {near_errors['lite']:.4f} m on clean pairs" in text


def mean_abs_rel(result: dict, near: bool) -> float:
    """Abs Rel over all pixels nearer than 2 m, or over the others."""
    intervals = [each for each in result["intervals"] if each["pixels"] and (each["to_m"] <= 2) == near]
    pixels = sum(each["pixels"] for each in intervals)
    return sum(each["pixels"] * each["pooled"]["abs_rel"] for each in intervals) / pixels


def test_the_page_of_lite_gives_the_changes_of_its_tables() -> None:
    """The changes of the geometric mean, in bullets, beside those of the report below them."""
    page = (ROOT / "ablation-lite.md").read_text()
    said, report = (" ".join(part.split()) for part in page.split("## Tables"))
    given = {
        "-3.3 %, -12.6 to +8.4 %",
        "(-6.0 %)",
        "(-3.2 %)",
        "(-2.9 %)",
        "(-2.0 %)",
        "(-0.9 %)",
        "(-0.5 %)",
        "(+0.1 %)",
    }
    for figure in given:
        assert figure in said and f"geometric mean {figure.strip('()')}" in report, figure
    for rounded, exact in (
        ("27 % (21 to 32 %)", "-26.6 %, -31.8 to -21.1 %"), ("15 % (12 to 18 %)", "-14.8 %, -18.2 to -11.6 %"),
        ("20 % (15 to 25 %)", "-19.9 %, -25.1 to -14.9 %"), ("12 % (9 to 15 %)", "-11.9 %, -14.8 to -8.6 %"),
        ("11 % (8 to 15 %)", "-11.1 %, -14.8 to -7.8 %"),
    ):  # fmt: skip
        assert rounded in said and f"geometric mean {exact}" in report, rounded
