import numpy as np
import pytest

from m3depth.checked_inference import EstimatorError
from m3depth.prediction.settings import with_settings
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import NATECAM

IMAGE = np.zeros((8, 8), np.uint8)
RIG = NATECAM.resized(8, 8)


class Flat:
    """Returns `nearest` as the depth of every pixel."""

    def infer(self, left, right, rig, nearest=2.0) -> Prediction:
        depth = np.full(left.shape[:2], nearest, np.float32)
        return Prediction(depth, rig.depth_to_disparity(depth), None, np.ones_like(depth))


class Broken:
    def infer(self, left, right, rig):
        return left


def test_settings_that_are_given_reach_the_estimator() -> None:
    assert (with_settings(Flat(), "flat", nearest=3.5)(IMAGE, IMAGE, RIG).depth == 3.5).all()
    assert (with_settings(Flat(), "flat", nearest=None, max_pixels=None)(IMAGE, IMAGE, RIG).depth == 2.0).all()


def test_settings_that_the_estimator_does_not_take_are_named() -> None:
    with pytest.raises(ValueError, match="--max-pixels: --estimator flat takes no such setting"):
        with_settings(Flat(), "flat", nearest=3.0, max_pixels=100)


def test_what_is_no_prediction_is_refused() -> None:
    with pytest.raises(EstimatorError, match=r"Broken\.infer"):
        with_settings(Broken(), "broken")(IMAGE, IMAGE, RIG)
