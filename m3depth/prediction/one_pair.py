"""From the images of a pair to its maps: checks, alignment of rows, the method, and what becomes unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.estimator import Estimator, EstimatorName, load_estimator, name_with_weights
from m3depth.prediction.common_disparity import given_back, nearest_without
from m3depth.prediction.left_right import AGREEMENT, left_right_difference
from m3depth.prediction.masks import read_valid, unknown_where, unmeasured, without_sky_normals
from m3depth.prediction.matchable import MatchablePair
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.pair_checks import check_pair, empty_or_same, rows_of
from m3depth.prediction.settings import with_settings
from m3depth.rectification.checked import CheckedPair
from m3depth.runtimes.choice import recorded_runtime
from m3depth.stereo.pairs import NEAREST
from m3depth.stereo.prediction import Prediction, StepMap
from m3depth.stereo.rows import RowFit
from m3depth.wrapped_estimators import takes_setting
from marssim.base.calibration.rectified import Calibration
from marssim.base.camera import StereoRig


@dataclass(frozen=True)
class Method:
    """The method that predicts.

    Attributes:
        estimator: The method.
        record: What identifies it: name, SHA-256 of its weights, and the program that runs it.
    """

    estimator: Estimator
    record: dict[str, Any]

    @classmethod
    def from_options(cls, options: PredictOptions, estimator: Estimator | None = None) -> Method:
        """Load the method that the flags name, or take the given one instead.

        Raises:
            ValueError: The flags name no method; the message says which.
            OSError, ImportError: Its weights or its package are missing.
        """
        given = estimator
        if estimator is None:
            name, flag = method_name(options)
            estimator = load_estimator(name, flag, device=options.device, runtime=options.used_runtime)
        record = method_record(options, given)
        with_settings(estimator, options.estimator, nearest=options.nearest, max_pixels=options.max_pixels)  # a check
        if options.steps and not getattr(estimator, "takes_steps", False):
            name = record["estimator"]
            raise ValueError(f"--steps: {name} has no maps of refinement steps; leave it out, or give a network itself")
        return cls(estimator, record)


def method_name(options: PredictOptions) -> tuple[str, str]:
    """Return the name of the method, and the flag that names it."""
    if options.weights is not None:
        return name_with_weights(options.weights), "--weights"
    return options.estimator, "--estimator"


def method_record(options: PredictOptions, estimator: Estimator | None = None) -> dict[str, Any]:
    """Return what identifies the method that the flags name, or the given one. Raises as EstimatorName.digest."""
    if estimator is not None:
        return {"estimator": type(estimator).__name__}
    name, _ = method_name(options)
    runtime = recorded_runtime([name], options.used_runtime, options.device)
    return {"estimator": name, "sha256": EstimatorName(name).digest(), "runtime": runtime}


@dataclass(frozen=True)
class PreparedPair(MatchablePair):
    """A pair that was checked, as the method matches it.

    Attributes:
        removed: The misalignment of the rows that was taken out, or None.
        warnings: What speaks against the pair, without making its result meaningless.
        rectified: What is to be written of a pair that was raw.
    """

    removed: RowFit | None = None
    warnings: Sequence[str] = ()
    rectified: CheckedPair | None = None


@dataclass(frozen=True)
class PairPrediction:
    """The prediction of a pair.

    Attributes:
        left: (H, W) or (H, W, 3) uint8 left image.
        prediction: The maps that are written.
        rig: The cameras.
        difference: (H, W) left_right_difference [px], or None.
        removed: The misalignment of the rows that was taken out, or None.
        compared: Number of pixels that the method measured, that no mask hides, and whose difference is known.
        agreeing: How many of them agree.
        steps: Disparity after each refinement step, with --steps, without the common disparity.
        common: Common disparity that stayed out while the pair was matched [px].
        rectified: What is to be written of a pair that was raw.
        shift: The right camera's cx minus the left one's [px].
    """

    left: np.ndarray
    prediction: Prediction
    rig: StereoRig
    difference: np.ndarray | None
    removed: RowFit | None
    compared: int = 0
    agreeing: int = 0
    steps: Sequence[StepMap] = ()
    common: float = 0.0
    rectified: CheckedPair | None = None
    shift: float = 0.0


def prepare(
    left: np.ndarray,
    right: np.ndarray,
    calibration: Calibration,
    options: PredictOptions,
    labels: tuple[str, str] = ("left", "right"),
    files: tuple[Path, Path] | None = None,
    thorough: bool = True,
    valid: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
    rectified: CheckedPair | None = None,
) -> PreparedPair:
    """Check a pair and align it.

    Args:
        left, right: The images, (H, W) or (H, W, 3) uint8.
        calibration: Of these images.
        options: The command's flags.
        labels: What messages call the images.
        files: Their files, beside which masks may lie.
        thorough: Whether to match the pair both ways round too, which takes as long as fitting the rows. Without it,
            that is done only where the rows do not show that the images are a rectified pair.
        valid: Where the images show the scene, (H, W) bool each, or None, beside what masks say.
        rectified: What is to be written of a pair that was raw; its warnings come first.

    Raises:
        FileNotFoundError: A mask is missing.
        ValueError: The result would be meaningless, or a mask does not fit.
    """
    paths = (None, None) if files is None else files
    masks = [*options.mask, None, None][:2]
    left_mask, right_mask = (read_valid(path, mask, left.shape[:2]) for path, mask in zip(paths, masks))
    pair = PreparedPair.from_images(left, right, calibration, (_both(left_mask, valid[0]), _both(right_mask, valid[1])))
    rows = rows_of(pair.left, pair.right, pair.rig)
    warnings = [] if rectified is None else list(rectified.warnings)
    if thorough or rows is None or rows.significant or empty_or_same(pair.left, pair.right) is not None:
        for fatal, message in check_pair(pair.left, pair.right, pair.rig, rows, options.align_rows, labels):
            if fatal and not options.unchecked:
                raise ValueError(f"{message}; nothing was written (--unchecked writes the result nevertheless)")
            warnings.append(message)
    if options.align_rows and rows is not None and rows.significant:
        pair = replace(pair.with_aligned_rows(rows), removed=rows)
    return replace(pair, warnings=warnings, rectified=rectified)


def _both(first: np.ndarray | None, second: np.ndarray | None) -> np.ndarray | None:
    """Return where both of two masks (H, W) are true; None is true everywhere."""
    return first if second is None else second if first is None else first & second


def predict_pair(pair: PreparedPair, method: Method, options: PredictOptions) -> PairPrediction:
    """Predict for a prepared pair, and make unknown what the flags and the masks say.

    Args:
        pair: The pair.
        method: The method.
        options: The command's flags.

    Raises:
        EstimatorError: The method returned something else than a whole Prediction.
        ValueError: The method takes no such setting as a flag gives.
    """
    nearest = options.nearest
    if pair.common and (nearest is not None or takes_setting(method.estimator, "nearest")):
        nearest = nearest_without(nearest or NEAREST, pair.rig, pair.common)
    shown = pair.without_upper_margins()
    infer = with_settings(method.estimator, options.estimator, nearest=nearest, max_pixels=options.max_pixels)
    prediction = infer(shown.left, shown.right, pair.rig)
    unknown = unmeasured(prediction) | ~pair.matched_within(prediction)
    comparable = ~unknown
    unknown |= unmeasured(prediction, options.min_confidence)
    difference, compared, agreeing = None, 0, 0
    if options.left_right:
        difference = left_right_difference(infer, shown.left, shown.right, pair.rig, prediction, -pair.moved)
        agree = difference <= AGREEMENT
        both_see = np.isfinite(prediction.depth) & np.isfinite(difference) & comparable
        compared, agreeing = int(both_see.sum()), int((both_see & agree).sum())
        unknown |= ~agree
    prediction = unknown_where(without_sky_normals(prediction), unknown)
    prediction = given_back(prediction, pair.rig, pair.common)
    steps = refinement_steps(shown, method, nearest, options.max_pixels) if options.steps else []
    return PairPrediction(
        pair.left, prediction, pair.rig, difference, pair.removed, compared, agreeing, steps, pair.common,
        pair.rectified, pair.common + pair.moved,
    )  # fmt: skip


def refinement_steps(
    pair: PreparedPair, method: Method, nearest: float | None, max_pixels: int | None
) -> list[StepMap]:
    """Return the disparity of a pair after each refinement step, NaN where the left image does not show the scene.

    The common disparity of the pair stays out.

    Args:
        pair: The pair.
        method: A network that takes steps.
        nearest: Shortest distance that should be measured [m]; None for the network's own.
        max_pixels: Largest number of pixels of an image that the network works on; None for all.
    """
    steps: list[StepMap] = method.estimator.infer_steps(  # type: ignore[attr-defined]
        pair.left, pair.right, pair.rig, nearest, max_pixels
    )
    if pair.left_valid is not None:
        for step in steps:
            step.disparity[~pair.left_valid] = np.nan
    return steps
