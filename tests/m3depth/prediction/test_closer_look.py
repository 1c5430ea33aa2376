"""When an estimator runs a second time on the images of a rig, and for which depth."""

import numpy as np
import pytest

from m3depth.estimator import EstimatorError
from m3depth.prediction.closer_look import closer_look
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig

IMAGE = np.zeros((8, 8), np.uint8)
LONG = StereoRig(PinholeCamera.centred(8, 8, 1200.0), 0.42)  # 600 px at 0.84 m


class Far:
    """Sees a wall, and records the depths that it was asked for."""

    def __init__(self, depth=10.0, confidence=1.0):
        self.depth, self.confidence, self.nearest = depth, confidence, []

    def infer(self, left, right, rig, nearest=None):
        self.nearest.append(nearest)
        depth = np.full(left.shape, self.depth, np.float32)
        return Prediction(depth, rig.depth_to_disparity(depth), None, np.full(left.shape, self.confidence))


@pytest.mark.parametrize(
    ("rig", "depth", "confidence", "depths"),
    [
        (LONG, 10.0, 1.0, [0.84, pytest.approx(9.0)]),
        (LONG, 1.0, 1.0, [0.84]),
        (LONG, 10.0, 0.2, [0.84]),
        (LONG, np.inf, 1.0, [0.84]),
        (NATECAM, 10.0, 1.0, [0.84]),
    ],
)
def test_the_second_run_needs_reduced_images_and_a_farther_scene(rig, depth, confidence, depths):
    far = Far(depth, confidence)
    closer_look(far, IMAGE, IMAGE, rig)
    assert far.nearest == depths


@pytest.mark.parametrize(("reach", "runs"), [(128, 2), (384, 1), (200, 1)])
def test_a_network_may_have_another_reach(reach, runs):
    """NaTeCam has 191.5 px at 0.84 m: a network that sees 128 px reduced its images."""
    far = Far()
    far.reach = reach
    closer_look(far, IMAGE, IMAGE, NATECAM)
    assert len(far.nearest) == runs


def test_a_given_depth_is_run_for_once():
    far = Far()
    closer_look(far, IMAGE, IMAGE, LONG, nearest=3.0)
    assert far.nearest == [3.0]


def test_estimators_without_nearest_run_once():
    class Plain:
        def infer(self, left, right, rig):
            return Far(7.0).infer(left, right, rig)

    assert (closer_look(Plain(), IMAGE, IMAGE, LONG, nearest=2.0).depth == 7).all()


def test_a_wrong_result_is_reported_before_it_is_used():
    class Bare:
        def infer(self, left, right, rig, nearest=None):
            return np.ones(left.shape)

    with pytest.raises(EstimatorError, match=r"Bare\.infer returned an array of shape \(8, 8\)"):
        closer_look(Bare(), IMAGE, IMAGE, LONG)
