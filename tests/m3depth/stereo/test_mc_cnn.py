"""MC-CNN with semi-global matching: its costs stand in for those of the package, where that is not installed."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from m3depth.estimator import EstimatorName, load_estimator
from m3depth.evaluate import EvaluateOptions, named_estimators
from m3depth.stereo import mc_cnn
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.command.flags import parse

RIG = StereoRig(PinholeCamera.centred(96, 48, 200.0), baseline=0.25)
SHIFT = 7


def textured() -> tuple[np.ndarray, np.ndarray]:
    right = np.random.default_rng(0).integers(0, 256, (48, 96), dtype=np.uint8)
    return np.roll(right, SHIFT, 1), right


def costs_of_the_package(left: np.ndarray, right: np.ndarray, low: int, high: int, weights: str) -> np.ndarray:
    """(row, column, disparity) from low to high <= 0, cut by its margin; the cost is low where grey levels agree."""
    assert left.dtype == right.dtype == np.float32 and high == 0 and weights == "network.onnx"
    left, right = (x[5:-5, 5:-5] for x in (left, right))
    volume = np.full((*left.shape, high - low + 1), np.nan, np.float32)
    for place, disparity in enumerate(range(low, high + 1)):
        width = left.shape[1] + disparity
        volume[:, -disparity:, place] = np.abs(left[:, -disparity:] - right[:, :width]) / 128 - 1
    return volume


@pytest.fixture
def package(monkeypatch):
    monkeypatch.setitem(sys.modules, "mc_cnn", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "mc_cnn.run", SimpleNamespace(run_mc_cnn_fast=costs_of_the_package))
    monkeypatch.setattr(mc_cnn, "mccnn_weights", lambda: Path("network.onnx"))


def test_costs_become_the_disparity_of_the_left_image(package) -> None:
    estimator = load_estimator("mccnn")
    prediction = estimator.infer(*textured(), RIG)
    matched = prediction.confidence > 0
    np.testing.assert_allclose(prediction.disparity[matched], SHIFT, atol=0.5)
    assert matched[:, SHIFT:].mean() > 0.95 and not matched[:, : SHIFT - 1].any()  # which the right eye does not see
    assert prediction.normal is not None


def test_a_setting_that_cannot_work_is_refused(package) -> None:
    with pytest.raises(ValueError, match="disparities must be a positive multiple of 16, got 20"):
        mc_cnn.McCnn(disparities=20)


def test_without_the_package_one_line_names_the_extra(monkeypatch) -> None:
    monkeypatch.setattr(mc_cnn, "find_spec", lambda name: None)
    with pytest.raises(
        ImportError, match=r'^--baselines: mccnn is not installed; pip install "mars-m3depth\[rivals\]"$'
    ):
        load_estimator("mccnn", "--baselines")
    options = parse(EvaluateOptions, "evaluate", None, ["--data", "data", "--out", "out", "--baselines", "mccnn"])
    assert list(named_estimators(options)) == ["M3Depth", "MCCNN"]
    assert EstimatorName("mccnn").digest() is None and EstimatorName("mccnn").label() == "MCCNN"


def test_the_package_itself_matches_and_its_weights_are_recorded() -> None:
    pytest.importorskip("mc_cnn")
    disparity = mc_cnn.McCnn(disparities=16).infer(*textured(), RIG).disparity
    np.testing.assert_allclose(np.median(disparity), SHIFT, atol=0.2)
    digest = EstimatorName("mccnn").digest()
    assert digest is not None and len(digest) == 64
