"""A second run of the network at a higher resolution, where nothing in view is near."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature

import numpy as np

from m3depth.estimator import Estimator, checked_prediction
from m3depth.stereo.pairs import MAX_DISPARITY, NEAREST
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

CONFIDENT = 0.5  # confidence from which a pixel counts for the nearest depth
NEAR_SHARE = 0.5  # [%] of the confident pixels that may be nearer than the second run's nearest depth
SLACK = 0.9  # factor by which the second run's nearest depth is nearer than what the first one found
WORTH = 1.25  # gain of resolution from which a second run is worth its time


def closer_look(
    estimator: Estimator, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None
) -> Prediction:
    """Return the estimator's prediction at the resolution that the scene allows.

    M3Depth's disparities end at 192 px (its `reach`), so it reduces images in which 0.84 m is more. Where nothing is
    that near, a second run on less reduced images resolves more. Estimators whose infer takes no `nearest` run once.

    Args:
        estimator: The method.
        left: (H, W) or (H, W, 3) uint8 left image, rectified.
        right: The right image, likewise.
        rig: The cameras of these images.
        nearest: Nearest depth [m] that must be seen; the estimator then runs once, for this depth.

    Raises:
        EstimatorError: infer did not return a whole Prediction.
    """

    def run(**nearest: float) -> Prediction:
        infer: Callable[..., object] = estimator.infer
        return checked_prediction(estimator, infer(left, right, rig, **nearest), left.shape[:2])

    if not takes_nearest(estimator):
        return run()
    if nearest is not None:
        return run(nearest=nearest)
    first = run(nearest=NEAREST)
    farther = _nearest_depth(first)
    reduced = rig.fb / NEAREST > WORTH * getattr(estimator, "reach", MAX_DISPARITY)
    return run(nearest=farther) if reduced and farther > WORTH * NEAREST else first


def takes_nearest(estimator: Estimator) -> bool:
    """Return whether the estimator's infer takes the nearest depth that must be seen."""
    return "nearest" in signature(estimator.infer).parameters


def _nearest_depth(prediction: Prediction) -> float:
    """Return the nearest predicted depth [m], with some slack; 0 if no pixel is confident."""
    with np.errstate(invalid="ignore"):
        confident = np.isfinite(prediction.depth) & (prediction.confidence >= CONFIDENT)
    return SLACK * float(np.percentile(prediction.depth[confident], NEAR_SHARE)) if confident.any() else 0.0
