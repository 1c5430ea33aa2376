"""What docs/results/methods.md says of the trainings in methods/longer is what their logs and files have."""

import json
import re
import sys
from pathlib import Path

import pytest

from m3depth.kinds.config import config_from_dict, preset_config
from m3depth.training.log import LOG, read_log

RESULTS = Path(__file__).parents[2] / "docs/results"
LONGER = sorted((RESULTS / "methods/longer").iterdir())


def test_the_page_has_the_table_of_the_runs(longer_trainings):
    assert longer_trainings.table() in (RESULTS / "methods.md").read_text(encoding="utf-8")
    assert len(longer_trainings.rows()) == len(LONGER) > 0


def test_the_page_has_the_table_of_the_scores(longer_trainings):
    assert longer_trainings.scores_table() in (RESULTS / "methods.md").read_text(encoding="utf-8")


def test_scores_of_both_trainings_are_compared_pair_by_pair(longer_trainings, tmp_path):
    (tmp_path / "longer/lite-150-min").mkdir(parents=True)
    records = tmp_path / "records"
    records.mkdir()
    for scenes, interval in ((40, r", 0\.[45]\d to 0\.5\d"), (2, "")):
        for name, shares in (("lite", (1, 1)), ("lite-150-min", (0.4, 0.6))):
            errors = [shares[scene % 2] for scene in range(scenes)]
            place = {
                "figures": dict.fromkeys(sys.modules["method_records"].COLUMNS, errors),
                "scenes": [f"{scene:05d}" for scene in range(scenes)],
            }
            record = {"name": name, "size": 512, "run": None, "sets": {"clean": {"places": {"gale": place}}}}
            (records / f"{name}.json").write_text(json.dumps(record))
        (row,) = longer_trainings.scores_table(tmp_path / "longer", records).splitlines()[2:]
        assert re.fullmatch(r"\| lite, clean \|" + rf" 0\.5000 \(0\.50 times{interval}\) \|" * 3, row), row


@pytest.mark.parametrize("run", LONGER, ids=lambda run: run.name)
def test_a_run_was_made_as_the_page_says(run, longer_trainings):
    preset = run.name.removesuffix(longer_trainings.ENDING)
    lines = [line for _, line in read_log(run / LOG)]
    stop = [line for line in lines if line["kind"] == "stop"][-1]
    assert [line for line in lines if line["kind"] == "val"][-1]["step"] == stop["step"]
    assert 149 < stop["minutes"] < 152
    last = [line for line in lines if line["kind"] == "start"][-1]
    assert re.search(rf"--out runs/{run.name} .*--preset {preset} .*--batch 2 --max-minutes 150", last["command"])
    assert last["processes"] == longer_trainings.CORES
    assert config_from_dict(json.loads((run / "weights.json").read_text())) == preset_config(preset)
