"""The settings of a prediction that some estimators take beside the pair."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature

import numpy as np

from m3depth.estimator import Estimator, checked_prediction
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

Infer = Callable[[np.ndarray, np.ndarray, StereoRig], Prediction]


def with_settings(estimator: Estimator, name: str, **settings: float | None) -> Infer:
    """Return the estimator's infer with settings, which checks that it returns a whole Prediction.

    Args:
        estimator: The method.
        name: What the user calls it, for the message.
        **settings: Arguments of infer, such as nearest or max_pixels; those that are None are left out.

    Raises:
        ValueError: The estimator's infer takes no such argument; the message names its flag. EstimatorError, where
            infer returns something else than a whole Prediction.
    """
    given = {key: value for key, value in settings.items() if value is not None}
    infer: Callable[..., object] = estimator.infer
    for key in given:
        if key not in signature(infer).parameters:
            raise ValueError(f"--{key.replace('_', '-')}: --estimator {name} takes no such setting; leave it out")

    def run(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        return checked_prediction(estimator, infer(left, right, rig, **given), left.shape[:2])

    return run
