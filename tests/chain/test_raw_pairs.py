"""The way of a raw pair: rendered through lenses, rectified with every calibration, and compared with the truth."""

import json

import numpy as np
import pytest

from m3depth.rectification.pair import fitting, rectify_pair
from m3depth.rectification.raw_image import read_raw_pair
from m3depth.rectification.row_errors import fit_rows
from marssim import generate
from marssim.base.calibration.calibration_files import FORMS
from marssim.base.calibration.read_pair import read_raw_calibration
from marssim.base.dataset.sample import RAW
from marssim.dataset import StereoDataset

RIG = {
    "width": 288, "height": 240, "fx": 310.0, "fy": 311.0, "cx": 141.0, "cy": 123.0, "baseline": 0.2,
    "distortion_model": "plumb_bob", "distortion_coefficients": [-0.24, 0.07, 0, 0],
    "right": {"fx": 305.0, "fy": 305.5, "cx": 146.0, "cy": 117.0, "distortion_model": "plumb_bob",
              "distortion_coefficients": [-0.22, 0.06, 0, 0]},
    "vergence_deg": 1.5, "rotation_deg": [0.6, 0.2, -0.8],
}  # fmt: skip
FLAGS = ["--pairs", "1", "--scene", "gravel", "--size", "12", "--horizon", "16", "--renderer", "scan", "--raw"]
EXACT = ["--sensor.vertical-offset", "0", "0", "--sensor.rotation-deg", "0", "0", "--sensor.read-noise", "0", "0"]
EXACT += ["--sensor.full-well", "1e7", "1e7"]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("raw")
    (folder / "rig.json").write_text(json.dumps(RIG))
    flags = [*FLAGS, *EXACT, "--rig-file", str(folder / "rig.json")]
    assert generate.main(["--out", str(folder / "data"), *flags]) == 0
    return folder / "data"


@pytest.mark.parametrize("form", FORMS)
def test_rows_and_depth_of_a_raw_pair_that_is_rectified_are_those_of_the_truth(data, form):
    sample = StereoDataset(data)[0]
    images = read_raw_pair(*(data / "scenes/00000/00" / name for name in RAW))
    cameras = fitting(read_raw_calibration([data / "calibration" / name for name in FORMS[form]]), *images)
    pair = rectify_pair(*images, cameras, shift=0.0)
    c, due = pair.view.left, sample.rig.camera
    assert [c.fx, c.fy, c.cx, c.cy] == pytest.approx([due.fx, due.fy, due.cx, due.cy], abs=1e-6)
    matches = pair.matches
    assert matches.after.points > 200 and matches.before.median > 0.7
    assert fit_rows(matches.left, matches.right, (288, 240), 6)[0].size < 0.05
    assert pair.removed is None and abs(matches.after.offset) < 0.05
    at = matches.left.round().astype(int)
    depth = c.fx * pair.view.baseline / matches.disparity
    error = depth / sample.depth[at[:, 1], at[:, 0]] - 1
    assert abs(np.median(error)) < 0.005 and np.median(np.abs(error)) < 0.02
    grey = [image.astype(float).mean(axis=-1)[20:-20, 20:-20] for image in (pair.left, sample.left)]
    assert np.corrcoef(grey[0].ravel(), grey[1].ravel())[0, 1] > 0.95
