"""The programs of docs/guides/own-estimator.md do what the page says."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from m3depth.evaluate import main
from m3depth.stereo.classical import SGBM
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.dataset import write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import write_sample
from marssim.export import ExportConfig, export

pytestmark = pytest.mark.usefixtures("undrawn_figures")


def test_the_estimator_has_20_lines(guide_program):
    code = [line for line in guide_program("my_stereo.py").splitlines()[1:] if line.strip()]
    assert len(code) <= 20


def test_evaluate_takes_the_estimator_by_class_path(tmp_path, my_stereo, monkeypatch):
    monkeypatch.setattr("m3depth.evaluation.command.methods.load_estimator", _without_network)
    rig = StereoRig(PinholeCamera.centred(320, 96, 200.0), 0.25)
    wall = np.random.default_rng(0).integers(0, 255, (96, 340, 1), dtype=np.uint8).repeat(3, axis=2)
    depth, disparity = np.full((96, 320), 2.5, np.float32), np.full((96, 320), 20, np.float32)
    nothing = np.zeros((96, 320), bool)
    frame = StereoFrame(
        wall[:, :320], wall[:, 20:], depth, disparity, np.broadcast_to(np.float32([0, 0, -1]), (96, 320, 3)),
        nothing.astype(np.int32), nothing, rig, np.eye(4),
    )  # fmt: skip
    write_sample(tmp_path / "set/scenes/00001/00", frame, {})
    write_index(tmp_path / "set", {}, ["00001/00"])
    out = tmp_path / "out"
    arguments = ["--estimator", my_stereo, "--baselines", "none"]
    assert main(["--data", str(tmp_path / "set"), "--out", str(out), *arguments]) == 0
    results = json.loads((out / "results.json").read_text())["methods"]["Blocks"]
    pooled = results["depth"]["all"]["pooled"]
    assert pooled["density"] == 1  # StereoBM leaves the left 192 columns empty, and the class fills them
    assert pooled["bad1"] < 0.02 and pooled["abs_rel"] < 0.02
    assert results["fitted_normal"]["all"]["pixels"] and not results["normal"]["all"]["pixels"]
    assert "\n| Blocks, fitted to its depth | " in (out / "results.md").read_text()


STAND_IN = """#!{python}
# What Pandora is asked for and answers: negative disparities as a TIFF, NaN where there is none.
import json, sys
from pathlib import Path

import cv2
import numpy as np

config, folder = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
eyes = [cv2.imread(config["input"][eye]["img"], cv2.IMREAD_UNCHANGED) for eye in ("left", "right")]
assert config["input"]["left"]["disp"] == [-192, 0] and all(eye.ndim == 2 for eye in eyes)
data = (Path({truth!r}) / folder.name / "disp0GT.pfm").read_bytes()
disparity = np.frombuffer(data[len(data) - 4 * eyes[0].size :], "<f4").reshape(eyes[0].shape)[::-1]
found = np.where(np.isfinite(disparity), -disparity, np.nan).astype(np.float32)
found[:, :8] = np.nan
cv2.imwrite(str(folder / "left_disparity.tif"), found)
"""


def test_the_recipe_makes_a_round_trip(tmp_path, plane_set, guide_program, monkeypatch):
    """As on the page, except for the program in the middle, which a stub with the truth replaces."""
    export(ExportConfig(plane_set, "eth3d", tmp_path / "eth3d", split=("test",)))
    (tmp_path / "run_pandora.py").write_text(guide_program("run_pandora.py"))
    tree = tmp_path / "eth3d" / "test"
    pandora = tmp_path / "bin" / "pandora"
    pandora.parent.mkdir()
    pandora.write_text(STAND_IN.format(python=sys.executable, truth=str(tree / "two_view_training_gt")))
    pandora.chmod(0o755)
    environment = {**os.environ, "PATH": f"{pandora.parent}{os.pathsep}{os.environ['PATH']}"}
    command = [sys.executable, "run_pandora.py", str(tree / "two_view_training"), "out"]
    subprocess.run(command, cwd=tmp_path, env=environment, check=True)
    monkeypatch.setattr("m3depth.evaluation.command.methods.load_estimator", _without_network)
    arguments = ["--predictions", f"Pandora={tmp_path / 'out'},scale=-1,fill", "--baselines", "none"]
    assert main(["--data", str(plane_set), "--out", str(tmp_path / "score"), *arguments]) == 0
    results = json.loads((tmp_path / "score" / "results.json").read_text())
    assert results["pairs"] == 2
    scored = results["methods"]["Pandora"]["depth"]["all"]["pooled"]
    assert scored["density"] == 1 and scored["bad1"] < 0.2 and scored["epe"] < 0.5  # the first 8 columns are filled
    whole = 64 * 48 * 2
    assert results["methods"]["Pandora"]["depth"]["all"]["pixels"] > 0.3 * whole


def _without_network(spec, *role, **where):
    from m3depth.estimator import load_estimator

    return SGBM() if spec == "m3depth" else load_estimator(spec, *role)
