"""A second look at images that the network reduced more than what they show asks for."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature

import numpy as np

from m3depth.estimator import Estimator, checked_prediction
from m3depth.stereo.pairs import MAX_DISPARITY, NEAREST
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

SURE = 0.5  # confidence from which a pixel tells how near things are
NEAR_SHARE = 0.5  # [%] of the sure pixels may be nearer than what the second look is meant for
SLACK = 0.9  # of that depth
WORTH = 1.25  # times less reduced is worth a second look


def closer_look(
    estimator: Estimator, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None
) -> Prediction:
    """What the estimator sees, at the resolution that the scene allows.

    M3Depth's disparities end at 192 px (its `reach`), so it reduces images in which 0.84 m is more. Where nothing is
    that near, a second look, less reduced, sees finer. nearest [m]: look once, for this. Estimators whose infer takes
    no `nearest` look once. Raises EstimatorError if what infer returns is no whole Prediction.
    """

    def look(**nearest: float) -> Prediction:
        infer: Callable[..., object] = estimator.infer
        return checked_prediction(estimator, infer(left, right, rig, **nearest), left.shape[:2])

    if not takes_nearest(estimator):
        return look()
    if nearest is not None:
        return look(nearest=nearest)
    first = look(nearest=NEAREST)
    farther = _nearest_seen(first)
    reduced = rig.fb / NEAREST > WORTH * getattr(estimator, "reach", MAX_DISPARITY)
    return look(nearest=farther) if reduced and farther > WORTH * NEAREST else first


def takes_nearest(estimator: Estimator) -> bool:
    """Can it be told the nearest depth that it has to see?"""
    return "nearest" in signature(estimator.infer).parameters


def _nearest_seen(prediction: Prediction) -> float:
    """[m] with some slack; 0 if nothing is seen for sure."""
    with np.errstate(invalid="ignore"):
        sure = np.isfinite(prediction.depth) & (prediction.confidence >= SURE)
    return SLACK * float(np.percentile(prediction.depth[sure], NEAR_SHARE)) if sure.any() else 0.0
