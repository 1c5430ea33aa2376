"""What a method predicts for a pair, checked, and its errors, which name the method, the pair and the line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from traceback import extract_tb

import numpy as np

from m3depth.estimator import M3DEPTH, Estimator
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

CONFIDENCE_LIMITS = (-1e-3, 1 + 1e-3)  # that rounding may reach


class EstimatorError(ValueError):
    """A method returned something other than a Prediction of the images' size; the one-line message names its class."""


def inferred(
    estimator: Estimator, left: np.ndarray, right: np.ndarray, rig: StereoRig, **settings: object
) -> Prediction:
    """Return what a method predicts for a pair, checked.

    The method gets copies of the images: what it writes into them changes neither the images that another method sees
    nor those of the figures.

    Args:
        estimator: The method.
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.
        **settings: More arguments of its infer.

    Raises:
        EstimatorError: It returned something other than a Prediction of the images' size, or a class of the user raised
            a ValueError, an OSError or an ImportError; the message names the class, and the file and line that raised.
    """
    infer: Callable[..., object] = estimator.infer
    try:
        returned = infer(left.copy(), right.copy(), rig, **settings)
    except EstimatorError:
        raise
    except (ValueError, OSError, ImportError) as error:  # which end a command in one line
        if type(estimator).__module__.partition(".")[0] == M3DEPTH:
            raise
        what = f"{type(estimator).__name__}.infer raised {type(error).__name__}: {error}"
        raise EstimatorError(f"{what} ({_place(error, estimator)})") from error
    return checked_prediction(estimator, returned, left.shape[:2])


@contextmanager
def errors_at(where: str) -> Iterator[None]:
    """Say where a method was at work: in the line of an EstimatorError, and below the traceback of other exceptions.

    Args:
        where: The method and the pair, such as "Blocks, pair 00003/05".
    """
    try:
        yield
    except EstimatorError as error:
        raise EstimatorError(f"{where}: {error}") from None
    except Exception as error:
        error.add_note(f"raised at {where}")
        raise


def _place(error: Exception, estimator: Estimator) -> str:
    """Return file and line of the method's own code that led to an error: of its module, where the error passed it."""
    frames = extract_tb(error.__traceback__)
    file = getattr(sys.modules.get(type(estimator).__module__), "__file__", None)
    own = [frame for frame in frames if frame.filename == file]
    frame = (own or frames)[-1]
    return f"{Path(frame.filename).name}, line {frame.lineno}"


def checked_prediction(estimator: Estimator, result: object, size: tuple[int, int]) -> Prediction:
    """Return what `estimator.infer` returned, as float32, if it is a whole Prediction.

    Without depth, a pixel has no disparity either, whatever was returned there. Where its confidence is NaN, it is 0.

    Args:
        estimator: The method, for the message.
        result: What its infer returned.
        size: Height and width of the images [px].

    Raises:
        EstimatorError: It is something else; the message names the class, what it returned and what is expected.
    """
    caller = f"{type(estimator).__name__}.infer"
    if not isinstance(result, Prediction):
        kind = f"an array of shape {result.shape}" if isinstance(result, np.ndarray) else f"a {type(result).__name__}"
        raise EstimatorError(f"{caller} returned {kind}: it must be a Prediction of m3depth.stereo.prediction")
    for name in ("depth", "disparity", "confidence", "normal"):
        values = getattr(result, name)
        if name == "normal" and values is None:
            continue
        shape = (*size, 3) if name == "normal" else size
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiub":
            kind = f"an array of {values.dtype}" if isinstance(values, np.ndarray) else f"a {type(values).__name__}"
            raise EstimatorError(f"{caller} returned {kind} as {name}: it must be a float array of shape {shape}")
        if values.shape != shape:
            raise EstimatorError(f"{caller} returned {name} of shape {values.shape}: it must be {shape} here")
    low, high = CONFIDENCE_LIMITS
    if (result.depth < 0).any():
        lowest = f"{np.nanmin(result.depth):g} m"
        raise EstimatorError(f"{caller} returned a depth of {lowest}: unknown is NaN, and sky is inf")
    outside = result.confidence[(result.confidence < low) | (result.confidence > high)]
    if len(outside):
        raise EstimatorError(f"{caller} returned a confidence of {outside[0]:g}: it must lie in [0, 1]")
    maps = {name: getattr(result, name) for name in ("depth", "disparity", "normal", "confidence")}
    if np.isnan(result.confidence).any():
        maps["confidence"] = np.nan_to_num(result.confidence, nan=0.0)
    if (unknown := np.isnan(result.depth) & np.isfinite(result.disparity)).any():
        maps["disparity"] = np.where(unknown, np.float32(np.nan), result.disparity)
    return replace(result, **{name: m.astype(np.float32, copy=False) for name, m in maps.items() if m is not None})
