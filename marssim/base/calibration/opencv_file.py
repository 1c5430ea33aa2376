"""Calibrations as programs write them with OpenCV's FileStorage: YAML, XML or JSON with K1 D1 K2 D2 R T.

The names are those of OpenCV's documentation and samples, and others that are in use (NAMES). Without R and T, the
results of stereoRectify (R1 R2 P1 P2) give the pose. Distortion has OpenCV's 4, 5, 8 or 12 coefficients, or the 4 of
cv2.fisheye, where the file says so: `distortion_model: fisheye` (or `model:`, or `fisheye: 1`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.bounded_text import parse_json_text, parse_xml, parse_yaml
from marssim.base.calibration.cameras import PosedCamera, PosedPair, nearest_rotation, second_camera
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.lens import Lens
from marssim.base.calibration.lenses.radial_tangential import RadialTangential

NAMES = {
    "K1": ("K1", "M1", "cameraMatrix1", "camera_matrix_1", "left_camera_matrix", "mtxL", "K_l", "Kl", "CM1"),
    "K2": ("K2", "M2", "cameraMatrix2", "camera_matrix_2", "right_camera_matrix", "mtxR", "K_r", "Kr", "CM2"),
    "D1": ("D1", "distCoeffs1", "dist_coeffs_1", "left_distortion_coefficients", "distL", "D_l", "Dl"),
    "D2": ("D2", "distCoeffs2", "dist_coeffs_2", "right_distortion_coefficients", "distR", "D_r", "Dr"),
    "R": ("R", "rotation", "rotation_matrix"),
    "T": ("T", "translation", "translation_vector", "t"),
}
# names of a distortion_model that are accepted
PINHOLES = (
    "radtan", "plumb_bob", "rational_polynomial", "pinhole", "radial-tangential", "radial_tangential", "brown-conrady",
    "brown_conrady", "none",
)  # fmt: skip
UNLIKE_FISHEYES = tuple(name for name in PINHOLES if name != "pinhole")  # a model pinhole may have any distortion
FISHEYES = ("fisheye", "equidistant", "kannala-brandt", "kannala_brandt")
SIZES = ("imageSize", "image_size", "img_size", "size", "resolution")
SIDES = (("image_width", "image_height"), ("width", "height"), ("image_Width", "image_Height"))


def parse_opencv(text: str) -> dict[str, Any]:
    """Return the fields of a file of FileStorage, in any of its three formats.

    Raises:
        ValueError: The text cannot be parsed.
    """
    if text.lstrip().startswith("<"):
        root = parse_xml(text)
        return {node.tag: _value(node) for node in root}
    return parse_json_text(text) if text.lstrip().startswith("{") else parse_yaml(text)


def is_opencv(content: Mapping[str, Any]) -> bool:
    """Return whether a file holds a part of a calibration with OpenCV's names."""
    return any(fields.first_of(content, NAMES[name]) for name in ("K1", "K2")) or {"R", "T"} <= content.keys()


def pair_of_opencv(content: Mapping[str, Any], fisheye: bool = False) -> PosedPair:
    """Return the cameras of a calibration.

    Args:
        content: The fields of the file, or of two, such as intrinsics.yml and extrinsics.yml.
        fisheye: Take four coefficients for those of cv2.fisheye, even if the file does not say so.

    Raises:
        ValueError: A field is missing or malformed, the distortion_model is not supported, or with `fisheye` the file
            says that the lenses are no fisheyes.
    """
    named = str(content.get("distortion_model") or "").lower()
    if named and named not in (*PINHOLES, *FISHEYES):
        raise ValueError(
            f"distortion_model {named} is not supported; radtan, plumb_bob, rational_polynomial and fisheye are"
        )
    kind = named or str(content.get(fields.first_of(content, ("model", "lens")) or "", "")).lower()
    said = str(content.get("fisheye", "")).lower()
    if fisheye and (named in PINHOLES or kind in UNLIKE_FISHEYES or said in ("0", "false")):
        field = (
            f"distortion_model {named}" if named else f"model {kind}" if kind in UNLIKE_FISHEYES else f"fisheye {said}"
        )
        raise ValueError(f"{field} says that the lenses are no fisheyes; leave --fisheye out")
    fisheye = fisheye or kind in FISHEYES or said in ("1", "true")
    size = fields.size(content, SIZES, SIDES)
    lenses = [_lens(content, NAMES[f"K{eye}"], NAMES[f"D{eye}"], fisheye) for eye in (1, 2)]
    if fields.first_of(content, NAMES["R"]) and fields.first_of(content, NAMES["T"]):
        rotation = fields.matrix(content, NAMES["R"], (3, 3), (3,))
        if rotation.shape == (3,):  # a vector of Rodrigues
            rotation = rodrigues(rotation)
        return PosedPair(
            PosedCamera(lenses[0], np.eye(3), np.zeros(3), size),
            second_camera(lenses[1], rotation, fields.matrix(content, NAMES["T"], (3,)), size),
        )
    if all(fields.first_of(content, (name,)) for name in ("R1", "R2", "P2")):
        p2 = fields.matrix(content, "P2", (3, 4))
        if not p2[0, 0] > 0:
            raise ValueError("field P2 has no positive focal length")
        turns = [nearest_rotation(fields.matrix(content, name, (3, 3))).T for name in ("R1", "R2")]
        centre = np.array([-p2[0, 3] / p2[0, 0], 0, 0])
        return PosedPair(
            PosedCamera(lenses[0], turns[0], np.zeros(3), size), PosedCamera(lenses[1], turns[1], centre, size)
        )
    raise ValueError("holds neither R and T nor R1, R2 and P2: the pose of the right camera is missing")


def opencv_text(pair: PosedPair) -> str:
    """Return a calibration in OpenCV's YAML, which FileStorage reads.

    Args:
        pair: The cameras, with RadialTangential or Fisheye lenses, both of one kind.

    Raises:
        ValueError: The lenses cannot be written.
    """
    lenses = pair.left.lens, pair.right.lens
    if len({type(lens) for lens in lenses}) > 1:
        raise ValueError("OpenCV's calibrations have two lenses of one kind")
    rotation = pair.right.rotation @ pair.left.rotation.T
    translation = pair.right.rotation @ (pair.left.centre - pair.right.centre)
    lines = ["%YAML:1.0", "---"]
    if pair.left.size is not None:
        lines += [f"image_width: {pair.left.size[0]}", f"image_height: {pair.left.size[1]}"]
    lines.append(f"distortion_model: {'fisheye' if isinstance(lenses[0], Fisheye) else 'radtan'}")
    for eye, lens in enumerate(lenses, 1):
        k, d = intrinsics(lens)
        lines += [_matrix_text(f"K{eye}", k), _matrix_text(f"D{eye}", np.array(d or (0.0,) * 5)[None])]
    lines += [_matrix_text("R", rotation), _matrix_text("T", translation[:, None])]
    return "\n".join(lines) + "\n"


def intrinsics(lens: Lens) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return the (3, 3) matrix K and the coefficients of distortion of a lens that has them.

    Raises:
        ValueError: The lens is of another kind.
    """
    if not isinstance(lens, RadialTangential | Fisheye):
        raise ValueError(f"a lens of kind {type(lens).__name__} has no coefficients of OpenCV")
    skew = lens.fx * lens.skew if isinstance(lens, Fisheye) else 0.0
    return np.array([[lens.fx, skew, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]]), lens.coefficients


def lens_of(k: np.ndarray, coefficients: np.ndarray, fisheye: bool) -> Lens:
    """Return the lens of a matrix K and coefficients of distortion.

    Args:
        k: (3, 3).
        coefficients: (N,).
        fisheye: Whether they are those of cv2.fisheye.

    Raises:
        ValueError: There is no such lens.
    """
    fx, fy, cx, cy = (float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    terms = tuple(float(value) for value in coefficients)
    if fisheye:
        return Fisheye(fx, fy, cx, cy, terms or (0.0,) * 4, float(k[0, 1]) / fx if fx else 0.0)
    return RadialTangential(fx, fy, cx, cy, terms if any(terms) else ())


def rodrigues(vector: np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation about a vector (3,) by its length [rad]."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle else vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _lens(content: Mapping[str, Any], k_names: tuple[str, ...], d_names: tuple[str, ...], fisheye: bool) -> Lens:
    k = fields.matrix(content, k_names, (3, 3))
    name = fields.first_of(content, d_names)
    terms = np.zeros(0)
    if name is not None:
        shapes = [(count,) for count in ((4,) if fisheye else (4, 5, 8, 12, 14, 0))]
        terms = fields.matrix(content, name, *shapes)
    try:
        return lens_of(k, terms, fisheye)
    except ValueError as error:
        raise ValueError(f"field {fields.first_of(content, k_names)}: {error}") from None


def _value(node: Element) -> Any:
    """Return what a node of OpenCV's XML holds: a matrix as a mapping, else its text."""
    if node.find("data") is None:
        return (node.text or "").strip() or None
    texts = {name: (node.findtext(name) or "").strip() for name in ("rows", "cols", "data")}
    whole = {name: int(texts[name]) if texts[name].isdigit() else None for name in ("rows", "cols")}
    return {**whole, "data": texts["data"]}


def _matrix_text(name: str, matrix: np.ndarray) -> str:
    rows, cols = matrix.shape
    data = ", ".join(f"{value:.17g}" if value % 1 else f"{value:.1f}" for value in matrix.ravel())
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]"
