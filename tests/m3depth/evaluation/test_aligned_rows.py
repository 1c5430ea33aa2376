"""Scoring of pairs whose rows are aligned first."""

import cv2
import numpy as np
import pytest
from turned_pairs import RIG, H, W, slope, slope_disparity, turned

from m3depth.evaluation.scoring import _infer_aligned, evaluate
from m3depth.stereo.prediction import Prediction
from marssim.base.dataset.sample import StereoSample
from marssim.base.right_image import image_disparity

OFFSET, ROTATION = 1.0, 0.005


class Ideal:
    """Returns the depth of the slope, as a perfect method does for a rectified pair, and keeps the right images."""

    normals_are_fitted = False

    def __init__(self) -> None:
        self.shown: list[np.ndarray] = []

    def infer(self, left, right, rig):
        self.shown.append(right)
        disparity = slope_disparity(rig)
        return Prediction(rig.disparity_to_depth(disparity), disparity, None, np.ones((H, W), np.float32))


@pytest.fixture(scope="module")
def sample() -> StereoSample:
    left, right = slope()
    pitch, _ = cv2.Rodrigues(np.array([-np.arctan(OFFSET / RIG.camera.fy), 0.0, 0.0]))
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, ROTATION]))
    depth = RIG.disparity_to_depth(slope_disparity(RIG))
    shown = image_disparity(RIG, depth, (roll @ pitch).T)
    no = np.zeros((H, W), bool)
    normal = np.zeros((H, W, 3), np.float32)
    return StereoSample(
        left, turned(right, RIG, OFFSET, ROTATION), depth, shown, normal, ~no, no, no.astype(np.int32), RIG, {}
    )  # fmt: skip


def test_disparities_of_an_aligned_pair_are_scored_by_those_of_the_images(sample):
    aligned, given = Ideal(), Ideal()
    figures = [
        evaluate([sample], {"ideal": method}, align_rows=align).pairs[0]["ideal"]
        for method, align in ((aligned, True), (given, False))
    ]
    # the turned camera moves columns by ROTATION (v - cy), a quarter of the height in the mean
    assert figures[1]["epe"] == pytest.approx(ROTATION * H / 4, rel=0.05)
    assert figures[0]["epe"] < 0.03
    assert figures[0]["abs_rel"] == figures[1]["abs_rel"] < 1e-6
    assert np.array_equal(given.shown[0], sample.right)
    straight = slope()[1][8:-8, 8:-8].astype(float)
    errors = [np.abs(method.shown[0][8:-8, 8:-8] - straight).mean() for method in (aligned, given)]
    assert errors[0] < 0.2 * errors[1]


def test_sky_keeps_its_disparity_in_an_aligned_pair(sample):
    """It has no depth from which the columns that it is shown at would follow."""

    class WithSky(Ideal):
        def infer(self, left, right, rig):
            whole = super().infer(left, right, rig)
            whole.depth[:20], whole.disparity[:20] = np.inf, 0
            return whole

    seen = _infer_aligned(WithSky(), sample.left, sample.right, RIG)
    assert (seen.disparity[:20] == 0).all() and np.isinf(seen.depth[:20]).all()
    assert np.abs(seen.disparity[20:] - sample.disparity[20:]).mean() < 0.05
