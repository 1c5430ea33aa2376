"""What docs/results/methods.md says of the trainings in methods/longer is what their logs and files have."""

import json
import re
from pathlib import Path

import pytest

from m3depth.kinds.config import config_from_dict, preset_config
from m3depth.training.log import LOG, read_log

RESULTS = Path(__file__).parents[2] / "docs/results"
LONGER = sorted((RESULTS / "methods/longer").iterdir())


def test_the_page_has_the_table_of_the_runs(longer_trainings):
    assert longer_trainings.table() in (RESULTS / "methods.md").read_text(encoding="utf-8")
    assert len(longer_trainings.rows()) == len(LONGER) > 0


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
