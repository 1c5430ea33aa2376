"""Estimators around another: with its unknown pixels filled, its filled pixels unknown, or on fewer pixels."""

from __future__ import annotations

from inspect import Parameter, signature

import numpy as np

from m3depth.checked_inference import inferred
from m3depth.estimator import Estimator, gets_truth
from m3depth.stereo.filling import filled_prediction
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig


class FilledEstimator:
    """An estimator whose unknown pixels are filled from the background, as those of the classical methods are.

    Args:
        estimator: The estimator.
    """

    def __init__(self, estimator: Estimator) -> None:
        self.estimator = estimator
        self.normals_are_fitted = getattr(estimator, "normals_are_fitted", False)
        self.takes_truth = gets_truth(estimator)

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig, **settings: object) -> Prediction:
        """Return the estimator's maps, filled; arguments as of Estimator.infer, and more of the estimator's own.

        Raises:
            EstimatorError: As of `inferred`.
        """
        return filled_prediction(inferred(self.estimator, left, right, rig, **settings), rig)

    def with_truth(self, disparity: np.ndarray) -> FilledEstimator:
        """Return the estimator for a pair of a known disparity, (H, W) [px]; itself if it takes none."""
        with_truth = getattr(self.estimator, "with_truth", None)
        return self if with_truth is None else FilledEstimator(with_truth(disparity))


class UnfilledEstimator:
    """A classical method whose holes stay unknown: pixels where nothing matches are not filled.

    Args:
        matcher: The method, one of BUILT_IN, whose confidence is 0 where it has filled.
    """

    def __init__(self, matcher: Estimator) -> None:
        self.estimator = matcher
        self.normals_are_fitted = True

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Return the method's maps, NaN where it has no match; arguments as of Estimator.infer."""
        maps = inferred(self.estimator, left, right, rig)
        assert maps.normal is not None
        matched = maps.confidence > 0
        depth, disparity = (np.where(matched, values, np.float32(np.nan)) for values in (maps.depth, maps.disparity))
        return Prediction(
            depth, disparity, np.where(matched[..., None], maps.normal, np.float32(np.nan)), maps.confidence
        )


class ReducedEstimator:
    """An estimator that works on at most so many pixels of an image.

    Args:
        estimator: The estimator, whose infer takes max_pixels.
        max_pixels: Largest number of pixels, 2048 or more for M3Depth.
    """

    def __init__(self, estimator: Estimator, max_pixels: int) -> None:
        self.estimator, self.max_pixels = estimator, max_pixels
        self.normals_are_fitted = getattr(estimator, "normals_are_fitted", False)
        self.takes_truth = gets_truth(estimator)

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig, **settings: object) -> Prediction:
        """Return the estimator's maps; arguments as of Estimator.infer, and more of the estimator's own.

        Raises:
            EstimatorError: As of `inferred`.
        """
        return inferred(self.estimator, left, right, rig, max_pixels=self.max_pixels, **settings)

    def with_truth(self, disparity: np.ndarray) -> ReducedEstimator:
        """Return the estimator for a pair of a known disparity, (H, W) [px]; itself if it takes none."""
        with_truth = getattr(self.estimator, "with_truth", None)
        return self if with_truth is None else ReducedEstimator(with_truth(disparity), self.max_pixels)


def takes_setting(estimator: Estimator, name: str) -> bool:
    """Return whether a method's infer takes an argument beside the pair, such as nearest, by its name or as any."""
    inner = estimator
    while isinstance(inner, FilledEstimator | ReducedEstimator):
        inner = inner.estimator
    arguments = signature(inner.infer).parameters
    return name in arguments or any(argument.kind is Parameter.VAR_KEYWORD for argument in arguments.values())
