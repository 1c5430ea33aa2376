"""The settings of a prediction that some estimators take beside the pair."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from m3depth.checked_inference import inferred
from m3depth.estimator import Estimator
from m3depth.stereo.prediction import Prediction
from m3depth.wrapped_estimators import takes_setting
from marssim.base.camera import StereoRig

# A function that predicts for a pair, as Estimator.infer does.
Infer = Callable[[np.ndarray, np.ndarray, StereoRig], Prediction]


def with_settings(estimator: Estimator, name: str, **settings: float | None) -> Infer:
    """Return the estimator's infer with settings, which checks that it returns a whole Prediction.

    Args:
        estimator: The method.
        name: What the user calls it, for the message.
        **settings: Arguments of infer, such as nearest or max_pixels; those that are None are left out.

    Returns:
        A function that raises EstimatorError where infer returns something else than a whole Prediction.

    Raises:
        ValueError: The estimator's infer takes no such argument; the message names its flag.
    """
    given = {key: value for key, value in settings.items() if value is not None}
    for key in given:
        if not takes_setting(estimator, key):
            raise ValueError(f"--{key.replace('_', '-')}: --estimator {name} takes no such setting; leave it out")

    def run(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        return inferred(estimator, left, right, rig, **given)

    return run
