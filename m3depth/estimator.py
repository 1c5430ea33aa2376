"""One interface for everything that turns a stereo pair into depth.

Importing this loads no torch; `load_estimator("m3depth")` does.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig
from marssim.base.command.input_file import check_file
from marssim.base.results.code_state import source_file


@runtime_checkable
class Estimator(Protocol):
    """What evaluation, prediction and the driving environment ask of a method.

    A class attribute `normals_are_fitted`, True, says that its normals are planes fitted to its disparity: evaluation
    then does not fit them a second time.
    """

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Maps of the left image. left, right: (H, W) or (H, W, 3) uint8, RGB, rectified; rig: of these images."""
        ...


class EstimatorError(ValueError):
    """A method returned something else than what is asked for; one line that names its class."""


CONFIDENCE_LIMITS = (-1e-3, 1 + 1e-3)  # that rounding may reach
WINDOWS = ("ssd", "sad", "ncc", "ssd-sgm", "sad-sgm", "ncc-sgm")  # the paper's classical methods
NAMES = ("m3depth", "sgbm", "m3depth:WEIGHTS", "package.module:Class", *WINDOWS)


def load_estimator(
    spec: str | Estimator, role: str = "estimator", others: tuple[str, ...] = (), device: str = "auto"
) -> Estimator:
    """An estimator by name.

    spec: "m3depth" (the weights that come with the package), "m3depth:PATH" (weights of one's own), "sgbm", one of
    WINDOWS, "package.module:Class" (a class without arguments that has infer), or an object that has infer.
    role, others: what the caller calls it, and names that only the caller knows, for the messages. device: what M3Depth
    computes on: cpu, cuda, or auto, a GPU if there is one; the other methods know the CPU alone.
    Raises ValueError, in one line, if the name means nothing, the class is no estimator or there is no GPU;
    FileNotFoundError that names the file if weights are missing.
    """
    if not isinstance(spec, str):
        if not isinstance(spec, Estimator) or isinstance(spec, type):
            raise ValueError(f"{role} {spec!r} has no method infer(left, right, rig)")
        return spec
    name, _, rest = spec.partition(":")
    if name == "m3depth":
        return _load_m3depth(Path(rest) if rest else None, device)
    if spec == "sgbm":
        from m3depth.stereo.classical import SGBM

        return SGBM()
    if spec in WINDOWS:
        from m3depth.stereo.classical import BlockMatching

        cost, _, sgm = spec.partition("-")
        return BlockMatching(cost, "sgm" if sgm else "wta")  # type: ignore[arg-type]
    if name and rest:
        return _load_class(role, name, rest)
    raise ValueError(f"{role} {spec!r} is unknown; choose from {', '.join((*others, *NAMES))}")


def checked_prediction(estimator: Estimator, found: object, size: tuple[int, int]) -> Prediction:
    """What `estimator.infer` returned for images of this height and width, as float32, if it is a whole Prediction.

    Raises EstimatorError that names the class, what it returned and what is asked for.
    """
    named = f"{type(estimator).__name__}.infer"
    if not isinstance(found, Prediction):
        what = f"an array of shape {found.shape}" if isinstance(found, np.ndarray) else f"a {type(found).__name__}"
        raise EstimatorError(f"{named} returned {what}: it must be a Prediction of m3depth.stereo.prediction")
    for name in ("depth", "disparity", "confidence", "normal"):
        values = getattr(found, name)
        if name == "normal" and values is None:
            continue
        shape = (*size, 3) if name == "normal" else size
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiub":
            what = f"an array of {values.dtype}" if isinstance(values, np.ndarray) else f"a {type(values).__name__}"
            raise EstimatorError(f"{named} returned {what} as {name}: it must be a float array of shape {shape}")
        if values.shape != shape:
            raise EstimatorError(f"{named} returned {name} of shape {values.shape}: it must be {shape} here")
    low, high = CONFIDENCE_LIMITS
    if (found.depth < 0).any():
        worst = f"{np.nanmin(found.depth):g} m"
        raise EstimatorError(f"{named} returned a depth of {worst}: unknown is NaN, and sky is inf")
    outside = found.confidence[(found.confidence < low) | (found.confidence > high)]
    if len(outside):
        raise EstimatorError(f"{named} returned a confidence of {outside[0]:g}: it must lie in [0, 1]")
    maps = {name: getattr(found, name) for name in ("depth", "disparity", "normal", "confidence")}
    return replace(found, **{name: m.astype(np.float32, copy=False) for name, m in maps.items() if m is not None})


def _load_m3depth(weights: Path | None, device: str) -> Estimator:
    if weights is not None:
        check_file(weights, "weights file")  # before torch is imported
    from m3depth.network.device import chosen_device
    from m3depth.network.model import M3Depth

    return M3Depth.from_pretrained(weights).to(chosen_device(device))


def _load_class(role: str, module_name: str, class_name: str) -> Estimator:
    named = f"{role} '{module_name}:{class_name}'"
    try:
        module = import_module(module_name)
    except ModuleNotFoundError as error:
        raise ValueError(f"{named}: {error}") from None
    cls = getattr(module, class_name, None)
    if not isinstance(cls, type):
        raise ValueError(f"{named}: module {module_name} has no class {class_name!r}")
    try:
        estimator = cls()
    except TypeError as error:
        raise ValueError(f"{named}: cannot be made without arguments ({error})") from None
    if not isinstance(estimator, Estimator):
        raise ValueError(f"{named}: the class has no method infer(left, right, rig)")
    return estimator


def state_of_estimator(spec: str) -> str | None:
    """Of what load_estimator is given: SHA-256 of the file of m3depth:WEIGHTS, or of the one that a class of one's own
    is read from, but not of what that imports; None where there is none."""
    module, _, rest = spec.partition(":")
    file = Path(rest) if module == "m3depth" else source_file(module)
    return hashlib.sha256(file.read_bytes()).hexdigest() if file is not None and file.is_file() else None


def weights_digest(perception: str) -> str | None:
    """SHA-256 of the weights of a perception, None where it has none. Raises OSError for a file that is not there."""
    name, _, path = perception.partition(":")
    if name != "m3depth":
        return None
    from m3depth.network.model import SHIPPED_WEIGHTS

    return hashlib.sha256((Path(path) if path else SHIPPED_WEIGHTS).read_bytes()).hexdigest()
