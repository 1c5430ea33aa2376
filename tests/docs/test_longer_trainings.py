"""What docs/results/methods.md says of the trainings in methods/longer is what their logs and files have."""

import hashlib
import json
import re
from pathlib import Path

import pytest

from m3depth.kinds.config import config_from_dict, preset_config
from m3depth.training.log import LOG, read_log

RESULTS = Path(__file__).parents[2] / "docs/results"
LONGER = sorted((RESULTS / "methods/longer").iterdir())
PAGE = " ".join((RESULTS / "methods.md").read_text(encoding="utf-8").split())


@pytest.mark.parametrize("run", LONGER, ids=lambda run: run.name)
def test_the_page_has_the_figures_of_the_log(run):
    lines = [line for _, line in read_log(run / LOG)]
    stop = [line for line in lines if line["kind"] == "stop"][-1]
    last = [line for line in lines if line["kind"] == "val"][-1]
    preset = run.name.removesuffix("-150-min")
    record = json.loads((RESULTS / f"methods/records/{preset}.json").read_text())
    first = record["run"]["training"]["validations"][-1]
    assert last["step"] == stop["step"] and 149 < stop["minutes"] < 152
    assert f"It took {stop['step']} steps, {stop['step'] / record['run']['training']['steps']:.1f} times" in PAGE
    assert f"EPE fell from {first['epe']:.2f} to {last['epe']:.2f} px" in PAGE
    assert f"normals from {first['normal']:.1f}° to {last['normal']:.1f}°" in PAGE
    command = [line for line in lines if line["kind"] == "start"][-1]["command"]
    assert re.search(rf"--out runs/{run.name} .*--preset {preset} .*--batch 2 --max-minutes 150", command)


@pytest.mark.parametrize("run", LONGER, ids=lambda run: run.name)
def test_the_weights_are_those_that_the_page_names(run):
    assert hashlib.sha256((run / "weights.safetensors").read_bytes()).hexdigest() in PAGE
    network = config_from_dict(json.loads((run / "weights.json").read_text()))
    assert network == preset_config(run.name.removesuffix("-150-min"))
