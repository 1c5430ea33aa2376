"""Rigs as they were built, for the simulator: two lenses, how they are turned, and what the rectified pair looks like.

A rig file is JSON. Width, height, fx, fy, cx, cy [px] and baseline [m] describe two equal, parallel cameras without
distortion. These fields may be added:

    distortion_model, distortion_coefficients     of the lens, with ROS's names of models: plumb_bob,
                                                  rational_polynomial, equidistant
    right             the right lens where it differs, with fx, fy, cx, cy, and its distortion if it has any
    vergence_deg      angle between both cameras, each of which is turned towards the other by half
    rotation_deg      further turn of the right camera about its x, y and z axis, as a vector of Rodrigues

Calibrations of a raw pair (read_pair.py) are taken in place of a rig file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.camera_info import MODELS
from marssim.base.calibration.cameras import PosedCamera, PosedPair
from marssim.base.calibration.lenses.coverage import check_lens
from marssim.base.calibration.lenses.lens import Lens
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.opencv_file import is_opencv, lens_of, rodrigues
from marssim.base.calibration.orientation import RectifiedView, rectified_view
from marssim.base.calibration.read_pair import read_raw_calibration
from marssim.base.calibration.rectified import LENS_FIELDS
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.files.json_file import DatasetError, read_json

RIG_FIELDS = tuple(NATECAM.to_dict())
LENS = ("fx", "fy", "cx", "cy")
DISTORTION = ("distortion_model", "distortion_coefficients")
FIELDS = (*RIG_FIELDS, "distortion_model", *LENS_FIELDS)
MOST_TURN = 45.0  # [deg]
HEAD = 4096  # bytes of a file that tell JSON from other calibrations


@dataclass(frozen=True)
class RawRig:
    """Two cameras as they were built, and the rectified view of their pairs.

    Attributes:
        cameras: The cameras, with sizes.
        view: The view that m3depth.rectify gives these cameras if it takes no common disparity out.
    """

    cameras: PosedPair
    view: RectifiedView

    @classmethod
    def from_cameras(cls, cameras: PosedPair) -> RawRig:
        """Return the rig of two cameras.

        Raises:
            ValueError: A camera has no size, the sizes differ, a lens folds over, or the cameras do not stand side by
                side.
        """
        left, right = cameras.left.size, cameras.right.size
        if left is None or right is None:
            raise ValueError("the size of the images is missing: image_width and image_height")
        if left != right:
            raise ValueError(
                f"the left camera has images of {left[0]} x {left[1]} px, the right one of {right[0]} x {right[1]} px: "
                "both must have one size"
            )
        for eye in ("left", "right"):
            check_lens(getattr(cameras, eye).lens, left, f"the distortion of the {eye} camera")
        return cls(cameras, rectified_view(cameras))

    @property
    def rig(self) -> StereoRig:
        """The rectified rig."""
        return StereoRig(self.view.left, self.view.baseline)

    def to_dict(self) -> dict[str, Any]:
        """Return the cameras as plain values, for JSON: each lens and its pose in the frame of the left camera."""
        turn, origin = self.cameras.left.rotation, self.cameras.left.centre
        out = {}
        for eye in ("left", "right"):
            camera: PosedCamera = getattr(self.cameras, eye)
            out[eye] = {
                "lens": type(camera.lens).__name__, **asdict(camera.lens),  # type: ignore[call-overload]
                "rotation": (camera.rotation @ turn.T).tolist(), "centre": (turn @ (camera.centre - origin)).tolist(),
            }  # fmt: skip
        return out


def read_rig_file(paths: Sequence[Path]) -> StereoRig | RawRig:
    """Read a rig file, or a calibration of a raw pair.

    Args:
        paths: One file, or those of the left and of the right camera.

    Returns:
        A StereoRig for two equal, parallel cameras without distortion, else a RawRig.

    Raises:
        ValueError: The file cannot be read, or a field is missing, unknown or bad. One line that names them.
    """
    content = _rig_fields(paths[0]) if len(paths) == 1 else None
    try:
        if content is None:
            pair = read_raw_calibration(paths)
        elif content.keys() <= set(RIG_FIELDS):
            return StereoRig.from_dict(content)
        else:
            pair = pair_of_rig_file(content)
    except FileNotFoundError as error:
        raise DatasetError(str(error)) from None
    except DatasetError:
        raise
    except ValueError as error:
        raise DatasetError(fields.message_in(paths, error)) from None
    try:
        return plain_rig(pair) or RawRig.from_cameras(pair)
    except ValueError as error:
        raise DatasetError(fields.message_in(paths, error)) from None


def pair_of_rig_file(content: Mapping[str, Any]) -> PosedPair:
    """Return the cameras of a rig file.

    Args:
        content: Its fields.

    Raises:
        ValueError: A field is missing, unknown or bad.
    """
    if unknown := sorted(set(content) - set(FIELDS)):
        raise ValueError(f"unknown field {', '.join(unknown)}; a rig has {', '.join(FIELDS)}")
    rig = StereoRig.from_dict(dict(content))
    size = (rig.camera.width, rig.camera.height)
    lenses = {"left": _lens(content, size), "right": _right_lens(content, size)}
    vergence = float(fields.matrix(content, "vergence_deg", (1,))[0]) if "vergence_deg" in content else 0.0
    turn = fields.matrix(content, "rotation_deg", (3,)) if "rotation_deg" in content else np.zeros(3)
    for name, most in (("vergence_deg", abs(vergence)), ("rotation_deg", np.linalg.norm(turn))):
        if not most <= MOST_TURN:
            raise ValueError(f"field {name} must be at most {MOST_TURN:g} deg, got {most:g}")
    # the rig's frame lies between the cameras, with x along the baseline; a turn about y (down) is to the right
    half = np.array([0.0, np.deg2rad(vergence) / 2, 0.0])
    left = rodrigues(half).T
    right = rodrigues(np.deg2rad(turn)).T @ rodrigues(-half).T
    return PosedPair(
        PosedCamera(lenses["left"], left, np.zeros(3), size),
        PosedCamera(lenses["right"], right, np.array([rig.baseline, 0.0, 0.0]), size),
    )


def plain_rig(pair: PosedPair) -> StereoRig | None:
    """Return the rig of two cameras that are rectified as they are, and equal; None for other cameras."""
    left, right = pair.left, pair.right
    lens = left.lens
    if not isinstance(lens, RadialTangential) or any(lens.coefficients) or lens != right.lens or left.size is None:
        return None
    across = left.rotation @ (right.centre - left.centre)
    if not np.array_equal(left.rotation, right.rotation) or any(across[1:]) or left.size != right.size:
        return None
    if not across[0] > 0:  # exchanged eyes, which have the same baseline
        return None
    return StereoRig(PinholeCamera(*left.size, lens.fx, lens.fy, lens.cx, lens.cy), pair.baseline)


def _rig_fields(path: Path) -> dict[str, Any] | None:
    """Return the fields of a rig file; None for a file of another kind. Raises DatasetError for one without JSON."""
    if path.is_file() and path.suffix.lower() != ".json":
        with path.open("rb") as file:
            if not file.read(HEAD).lstrip().startswith(b"{"):
                return None
    content = read_json(path)
    return None if is_opencv(content) else content


def _lens(content: Mapping[str, Any], size: tuple[int, int], name: str = "") -> Lens:
    """Return the lens of some fields; name: where they are in the file, as "right."."""
    for first, second in (DISTORTION, DISTORTION[::-1]):
        if first in content and second not in content:
            raise ValueError(f"field {name}{second} is missing beside {first}")
    fx, fy, cx, cy = (float(fields.matrix(content, part, (1,))[0]) for part in LENS)
    for part, focal in (("fx", fx), ("fy", fy)):
        if not focal > 0:
            raise ValueError(f"field {name}{part} must be positive [px], got {focal:g}")
    terms, model = np.zeros(0), content.get(DISTORTION[0])
    if model is not None:
        if model not in tuple(MODELS):
            raise ValueError(f"field {name}{DISTORTION[0]}: {model!r} is unknown; choose from {', '.join(MODELS)}")
        terms = fields.numbers(content[DISTORTION[1]], DISTORTION[1]).ravel()
    try:
        lens = lens_of(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), terms, MODELS.get(str(model), False))
    except ValueError as error:
        raise ValueError(f"field {name}{DISTORTION[1]}: {error}") from None
    check_lens(lens, size, f"field {name}{DISTORTION[1]}: the distortion")
    return lens


def _right_lens(content: Mapping[str, Any], size: tuple[int, int]) -> Lens:
    right = content.get("right", content)
    if not isinstance(right, Mapping):
        raise ValueError("field right must hold the fields of the right lens")
    if right is not content:
        if unknown := sorted(set(right) - {*LENS, *DISTORTION}):
            names = ", ".join(f"right.{name}" for name in unknown)
            raise ValueError(f"unknown field {names}; a lens has {', '.join(LENS + DISTORTION)}")
        for name in LENS:
            if name not in right:
                raise ValueError(f"field right.{name} is missing: a right lens of its own has {', '.join(LENS)}")
    return _lens(right, size, "right." if right is not content else "")
