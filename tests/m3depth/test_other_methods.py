"""The examples of docs/other_methods.md do what the page says."""

import ast
import json

import numpy as np
import pytest

from m3depth.evaluate import main
from m3depth.matching import SGBM
from marssim.camera import PinholeCamera, StereoRig
from marssim.dataset import write_index, write_sample
from marssim.render.stereo import StereoFrame


def test_the_estimator_has_20_lines(other_methods):
    code = [line for line in other_methods("my_stereo.py").splitlines()[1:] if line.strip()]
    assert len(code) <= 20


def test_evaluate_takes_it_by_class_path(tmp_path, my_stereo, monkeypatch):
    monkeypatch.setattr("m3depth.evaluate.load_estimator", _without_network)
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
    asked = ["--estimator", my_stereo, "--baselines", "none"]
    assert main(["--data", str(tmp_path / "set"), "--out", str(out), *asked]) == 0
    found = json.loads((out / "results.json").read_text())["methods"]["Blocks"]
    density = found["depth"]["all"]["pooled"]["density"]
    assert 0.2 < density < 0.6  # StereoBM leaves the left 192 columns empty
    assert found["depth"]["all"]["pooled"]["bad1"] == pytest.approx(1 - density, abs=0.02)
    assert found["sparsification"]["bad1"][-1] < 0.02
    assert found["fitted_normal"]["all"]["pixels"] and not found["normal"]["all"]["pixels"]


def test_the_recipe_is_a_program(other_methods):
    tree = ast.parse(other_methods("run_pandora.py"))
    assert {"json", "subprocess", "sys"} <= {n.names[0].name for n in tree.body if isinstance(n, ast.Import)}


def _without_network(spec, *role):
    from m3depth.estimator import load_estimator

    return SGBM() if spec == "m3depth" else load_estimator(spec, *role)
