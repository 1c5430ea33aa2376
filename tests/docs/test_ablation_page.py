"""The page of the ablation has the reports of the scores beside it."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest

from m3depth.ablation.config import AblateOptions
from m3depth.ablation.findings import _change, _column, findings
from m3depth.ablation.studies import distinct
from m3depth.ablation.tables import markdown
from m3depth.evaluation.bootstrap import interval, resampled_means

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
    page, level, figures = "ablation.md", "####", "ablation/"
    if file == LITE:
        page, level, figures = "ablation-lite.md", "###", "ablation/lite/"
    report = re.sub(r"!\[\w+\]\(", f"![]({figures}", report)
    assert report.replace("\n## ", f"\n{level} ") in bare_pictures((ROOT / page).read_text())


def bare_pictures(text: str) -> str:
    """Return a page without the words that describe its pictures and without the captions below them."""
    return re.sub(r"!\[[^\]]*\](\([^)]+\))\n\n\*[^*\s][^*]*\*\n", r"![]\1\n", text)


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


def abs_rel_without_rover(run: str) -> np.ndarray:
    """Abs Rel of each test pair, (72,), without the pixels of the rover."""
    rover, score = (json.loads((FOLDER / f"lite/{file}.json").read_text()) for file in ("rover", f"runs/{run}-0/score"))
    figures = {pair["pair"]: pair["M3Depth"]["abs_rel"] for pair in score["per_pair"]}
    return np.array([*(figures | {pair: of["abs_rel"] for pair, of in rover[f"{run}-0"].items()}).values()])


def typical_change(before: str, after: str) -> tuple[float, float, float]:
    """The change of the geometric mean of Abs Rel without the rover, and its interval over scenes [%]."""
    ratios = np.log(abs_rel_without_rover(after) / abs_rel_without_rover(before))
    scenes = [pair["scene"] for pair in json.loads((FOLDER / "lite/runs/base-0/score.json").read_text())["per_pair"]]
    low, high = interval(resampled_means(ratios, scenes), ratios.mean(), len(set(scenes)))
    change, low, high = (100 * np.expm1(value) for value in (ratios.mean(), low, high))
    return change, low, high


@pytest.mark.parametrize(
    ("words", "before", "after"),
    [
        ("The weights of pixels in the loss lower Abs Rel by {}, and its", "loss-plain", "base"),
        ("with the lookup, lower it by {} beside", "no-steps", "base"),
        ("and steps alone by {}.", "no-irm", "steps-alone"),
        ("the convex upsampling together lower it by {}, twice", "no-irm", "no-steps"),
        ("The normals that the disparity implies, in each step, lower it by {}.", "not-implied", "base"),
        ("lookup and the match at half the resolution lower it by {} and", "no-lookup", "base"),
        ("lower it by 13 % (10 to 15 %) and {}.", "no-fine", "base"),
    ],
)  # fmt: skip
def test_the_page_of_lite_gives_the_changes_without_the_rover(words: str, before: str, after: str) -> None:
    text = " ".join((ROOT / "ablation-lite.md").read_text().replace("**", "").split())
    change, low, high = typical_change(before, after)
    assert words.format(f"{-change:.0f} % ({-high:.0f} to {-low:.0f} %)") in text


@pytest.mark.parametrize(
    ("part", "run"),
    [
        ("the residual blocks at 1/4 and 1/8", "plain-blocks"),
        ("channels of their own for the comparison", "plain-match"),
        ("the three dilated convolutions", "plain-slices"), ("the weighted sum of the groups", "wide-scores"),
        ("the convex upsampling", "no-convex"), ("the left features in SNNet", "snnet-blind"),
        ("the heads of the state alone", "heads-see-all"),
    ],
)  # fmt: skip
def test_the_page_of_lite_names_what_is_within_chance(part: str, run: str) -> None:
    text = " ".join((ROOT / "ablation-lite.md").read_text().split())
    assert f"{part} ({typical_change(run, 'base')[0]:+.1f} %)" in text


def test_the_page_of_lite_says_how_much_the_rover_decides() -> None:
    text = " ".join((ROOT / "ablation-lite.md").read_text().split())
    rover = json.loads((FOLDER / "lite/rover.json").read_text())
    shares, errors = [], {}
    for run, pairs in rover.items():
        scored = json.loads((FOLDER / f"lite/runs/{run}/score.json").read_text())["per_pair"]
        figures = {pair["pair"]: pair["M3Depth"]["abs_rel"] for pair in scored}
        shares.append(sum(figures[pair] for pair in pairs) / sum(figures.values()))
        pixels = [of["rover_pixels"] for of in pairs.values()]
        errors[run] = np.average([of["rover_abs_rel"] for of in pairs.values()], weights=pixels)
    scores = [json.loads((FOLDER / f"lite/runs/{run}-0/score.json").read_text()) for run in ("base", "loss-plain")]
    means = [np.mean([pair["M3Depth"]["abs_rel"] for pair in score["per_pair"]]) for score in scores]
    assert f"{means[0]:.3f} for `lite`, and {means[1]:.3f} without the weights of pixels" in text
    plain = errors.pop("loss-plain-0")
    assert f"err by {100 * min(errors.values()):.0f} to {100 * max(errors.values()):.0f} % on them, but by" in text
    assert f"but by {100 * plain:.0f} % without the weights" in text and len(pairs) == 10
    assert f"have {100 * min(shares):.0f} to {100 * max(shares):.0f} % of the sum of Abs Rel in every row" in text
    everything = json.loads((FOLDER / "lite/runs/base-0/score.json").read_text())["result"]["depth"]["all"]["pixels"]
    assert f"leaves the rover out, {100 * sum(pixels) / everything:.1f} % of the scored pixels" in text
    page = " ".join((ROOT / "ablation.md").read_text().split())
    shares = []
    for file in [*(FOLDER / "runs").glob("*/score.json"), *(FOLDER / "levels").glob("*/score.json")]:
        figures = {pair["pair"]: pair["M3Depth"]["abs_rel"] for pair in json.loads(file.read_text())["per_pair"]}
        shares.append(sum(figures[pair] for pair in rover["base-0"]) / sum(figures.values()))
    assert f"have {100 * min(shares):.0f} to {100 * max(shares):.0f} % of the sum in every run" in page


def test_the_page_of_lite_says_what_the_weights_of_pixels_do() -> None:
    text = " ".join((ROOT / "ablation-lite.md").read_text().split())
    with_them, without = abs_rel_without_rover("base").mean(), abs_rel_without_rover("loss-plain").mean()
    assert f"and its mean from {without:.3f} to {with_them:.3f}" in text
    results = [
        json.loads((FOLDER / f"lite/runs/{run}-0/score.json").read_text())["result"] for run in ("base", "loss-plain")
    ]
    rocks = [result["rocks"]["standing_0.2_m_within_8_m"] for result in results]
    found = [each["both_eyes_found"] for each in rocks]
    assert f"Of the {rocks[0]['both_eyes']} rocks of 0.2 m and more within 8 m that both eyes see, {found[0]}" in text
    assert (
        f"found instead of {found[1]}, with {rocks[0]['false']} false obstacles instead of {rocks[1]['false']}" in text
    )
    epe = [result["depth"]["rock"]["pooled"]["epe"] for result in results]
    on_rocks, on_ground = ([result["normal"][on]["pooled"]["mean"] for result in results] for on in ("rock", "ground"))
    assert f"EPE on rocks is {epe[0]:.1f} px instead of {epe[1]:.1f}" in text
    assert f"{on_rocks[0]:.0f}° instead of {on_rocks[1]:.0f}°" in text
    assert f"{on_ground[0]:.1f}° instead of {on_ground[1]:.1f}°" in text


def test_the_page_of_lite_gives_the_largest_changes_of_the_normals() -> None:
    studies = json.loads((FOLDER / LITE).read_text())["studies"]
    changes = [part for study in studies.values() for part in study["comparisons"] if part["measure"] == "normal_mean"]
    by_size = sorted(changes, key=lambda part: -abs(part["typical"]))
    names = ["Recurrent steps, beside the other parts", "The normals that the disparity implies, in each step"]
    assert [part["what"] for part in by_size[:3]] == [*names, "Correlation lookup"]
    figures = ", ".join(f"{100 * part['typical']:.1f}" for part in by_size[:2])
    assert f"{figures} and {100 * by_size[2]['typical']:.1f} %." in " ".join(
        (ROOT / "ablation-lite.md").read_text().split()
    )


def test_the_page_says_how_far_the_rover_moves_changes_of_the_geometric_mean() -> None:
    moved = []
    for run in {path.name for path in (FOLDER / "lite/runs").iterdir()} - {"base-0", "loss-plain-0"}:
        everything = [
            {pair["pair"]: pair["M3Depth"]["abs_rel"] for pair in json.loads(file.read_text())["per_pair"]}
            for file in (FOLDER / f"lite/runs/{name}/score.json" for name in (run, "base-0"))
        ]
        before, after = (np.array([*figures.values()]) for figures in everything)
        with_rover = 100 * np.expm1(np.log(after / before).mean())
        moved.append(abs(with_rover - typical_change(run.removesuffix("-0"), "base")[0]))
    page = " ".join((ROOT / "ablation.md").read_text().split())
    assert f"leaving the rover out moves its changes by up to {max(moved):.1f} points" in page


def test_the_page_of_lite_says_how_much_sky_is_missed() -> None:
    text = " ".join((ROOT / "ablation-lite.md").read_text().split())
    runs = {file.parent.name: json.loads(file.read_text()) for file in (FOLDER / "lite/runs").glob("*/score.json")}
    missed = {run: 100 * score["result"]["sky"]["missed"] for run, score in runs.items()}
    alone, none, others = missed.pop("steps-alone-0"), missed.pop("no-irm-0"), missed.values()
    said = f"recurrent steps alone miss {alone:.0f} % of it, and a network with none of these parts {none:.0f} %;"
    assert f"{said} all others miss {min(others):.0f} to {max(others):.0f} %." in text
    as_sky = {run: 100 * score["result"]["sky"]["near_ground_as_sky"] for run, score in runs.items()}
    assert (
        max(as_sky, key=as_sky.__getitem__) == "no-fine-0" and f"takes for sky is {max(as_sky.values()):.2f} %" in text
    )
