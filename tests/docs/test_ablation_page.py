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


@pytest.mark.parametrize(
    ("file", "folder"), [("three_seeds.json", "runs"), ("one_seed.json", "runs"), ("levels.json", "levels")]
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
    report = re.sub(r"!\[(\w+)\]\(", r"![\1: the rows beside the paper](ablation/", report.replace("\n## ", "\n#### "))
    assert report in (ROOT / "ablation.md").read_text()


def test_every_run_says_which_network_it_is() -> None:
    runs = [*(FOLDER / "runs").iterdir(), *(FOLDER / "levels").iterdir()]
    assert len(runs) > 20 and all((run / "network.json").is_file() for run in runs)


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
