"""Estimators around others pass on what they are asked for."""

from types import SimpleNamespace

import numpy as np
import pytest

from m3depth.checked_inference import EstimatorError
from m3depth.estimator import for_pair, gets_truth
from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction
from m3depth.wrapped_estimators import FilledEstimator, ReducedEstimator, takes_setting
from marssim.base.camera import PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera.centred(4, 1, 100.0), 0.27)
IMAGE = np.zeros((1, 4), np.uint8)


class Network:
    """Returns nearest for depth and max_pixels for disparity, with holes; or the disparity that it was given."""

    normals_are_fitted = True
    takes_truth = True

    def __init__(self, disparity: np.ndarray | None = None) -> None:
        self.disparity = disparity

    def with_truth(self, disparity: np.ndarray) -> "Network":
        return Network(disparity)

    def infer(self, left, right, rig, nearest: float = 0.84, max_pixels: int | None = None) -> Prediction:
        depth = np.full(left.shape[:2], nearest, np.float32)
        disparity = np.full_like(depth, max_pixels or np.nan) if self.disparity is None else self.disparity
        return Prediction(depth, disparity, None, np.ones_like(depth))


def test_an_estimator_on_fewer_pixels_is_the_estimator_with_that_setting() -> None:
    estimator = ReducedEstimator(Network(), 4096)
    maps = estimator.infer(IMAGE, IMAGE, RIG, nearest=2.5)
    assert (maps.disparity == 4096).all() and (maps.depth == 2.5).all()
    assert estimator.normals_are_fitted and gets_truth(estimator)
    shown = for_pair(estimator, SimpleNamespace(disparity=np.full((1, 4), 7.0, np.float32)))
    assert (shown.infer(IMAGE, IMAGE, RIG).disparity == 7).all()
    with pytest.raises(EstimatorError, match=r"Broken\.infer returned a NoneType"):
        ReducedEstimator(Broken(), 4096).infer(IMAGE, IMAGE, RIG)


class Broken:
    """Returns nothing."""

    def infer(self, left, right, rig, max_pixels=None) -> None:
        return None


class Any:
    """Takes every setting."""

    def infer(self, left, right, rig, **settings) -> Prediction:
        return Network().infer(left, right, rig, **settings)


def test_what_the_inner_method_takes_counts() -> None:
    for estimator in (Network(), ReducedEstimator(Network(), 4096), FilledEstimator(ReducedEstimator(Network(), 4096))):
        assert takes_setting(estimator, "nearest") and takes_setting(estimator, "max_pixels")
        assert not takes_setting(estimator, "speed")
    assert takes_setting(Any(), "max_pixels")
    assert not takes_setting(FilledEstimator(SGBM()), "max_pixels")
