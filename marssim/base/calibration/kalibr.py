"""Kalibr's camchain.yaml: cam0 and cam1 with intrinsics, distortion and T_cn_cnm1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.cameras import PosedPair, first_camera, second_camera
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.lens import Lens
from marssim.base.calibration.lenses.radial_tangential import RadialTangential


def is_kalibr(content: Mapping[str, Any]) -> bool:
    """Return whether the fields of a YAML file are a camchain."""
    return isinstance(content.get("cam0"), Mapping) and "camera_model" in content["cam0"]


def pair_of_kalibr(content: Mapping[str, Any]) -> PosedPair:
    """Return the cameras cam0 (left) and cam1 (right) of a camchain.

    Raises:
        ValueError: A field is missing or malformed, or a model is not pinhole with radtan, equidistant or none.
    """
    if not isinstance(content.get("cam1"), Mapping):
        raise ValueError("field cam1 is missing: a camchain of one camera is no pair")
    lenses, sizes = [], []
    for eye in ("cam0", "cam1"):
        lenses.append(fields.read_in(eye, _lens, content[eye]))
        sizes.append(fields.read_in(eye, fields.size, content[eye], ("resolution",)))
    transform = fields.read_in("cam1", fields.matrix, content["cam1"], "T_cn_cnm1", (4, 4))
    return PosedPair(
        first_camera(lenses[0], sizes[0]), second_camera(lenses[1], transform[:3, :3], transform[:3, 3], sizes[1])
    )


def kalibr_text(pair: PosedPair) -> str:
    """Return a camchain.yaml.

    Args:
        pair: The cameras, with sizes, and RadialTangential lenses of at most 4 coefficients or Fisheye lenses.

    Raises:
        ValueError: The cameras cannot be written.
    """
    rotation = pair.right.rotation @ pair.left.rotation.T
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = pair.right.rotation @ (pair.left.centre - pair.right.centre)
    lines = []
    for eye, camera in (("cam0", pair.left), ("cam1", pair.right)):
        lens = camera.lens
        if not isinstance(lens, RadialTangential | Fisheye) or any(lens.coefficients[4:]) or camera.size is None:
            raise ValueError("Kalibr's files hold cameras with a size and four coefficients of distortion")
        if isinstance(lens, Fisheye) and lens.skew:
            raise ValueError("Kalibr's files hold no skew")
        lines.append(f"{eye}:")
        if eye == "cam1":
            lines += ["  T_cn_cnm1:", *(f"  - {_list(row)}" for row in transform)]
        lines += [
            "  camera_model: pinhole",
            f"  distortion_coeffs: {_list(lens.coefficients[:4] or (0.0,) * 4)}",
            f"  distortion_model: {'equidistant' if isinstance(lens, Fisheye) else 'radtan'}",
            f"  intrinsics: {_list((lens.fx, lens.fy, lens.cx, lens.cy))}",
            f"  resolution: [{camera.size[0]}, {camera.size[1]}]",
        ]
    return "\n".join(lines) + "\n"


def _lens(camera: Mapping[str, Any]) -> Lens:
    model, distortion = camera.get("camera_model"), camera.get("distortion_model", "none")
    if model != "pinhole" or distortion not in ("radtan", "equidistant", "none"):
        raise ValueError(
            f"camera_model {model} with distortion_model {distortion} is not supported; "
            "pinhole with radtan, equidistant or none is"
        )
    fx, fy, cx, cy = (float(x) for x in fields.matrix(camera, "intrinsics", (4,)))
    if distortion == "none":
        return RadialTangential(fx, fy, cx, cy)
    terms = tuple(float(x) for x in fields.matrix(camera, "distortion_coeffs", (4,)))
    return (Fisheye if distortion == "equidistant" else RadialTangential)(fx, fy, cx, cy, terms)


def _list(values: Any) -> str:
    return "[" + ", ".join(f"{float(value)!r}" for value in values) + "]"
