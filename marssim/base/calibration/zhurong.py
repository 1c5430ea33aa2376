"""The camera of Zhurong's labels (.2CL), from the fields of their interior and exterior orientation.

No product was at hand; the names and values of fields are from public code that reads such labels.

- Interior: lengths in millimetres, of the pixel in micrometres if it is over 1, else in millimetres. The principal
  point's offsets count from the middle of the image, to the right and up. The lens has no distortion: the images of
  level 2C are said to be corrected.
- Orientation: Vector_Cartesian_3_Pointing has the directions in which the corners and the middle of the image look, in
  a frame with z up. The camera is turned onto them. In one published label of the left camera they fit the interior
  orientation as above, with corners at the outer edges of the pixels, to 0.0025 deg, a tenth of a pixel.
- Without these directions, the angles of the exterior orientation in degrees, in an order that no document at hand
  settles: NOTES says what is assumed, and commands print it.
- Position: the centre of the exterior orientation in metres, in the frame of the orientation. Directions and centres of
  different frames are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.cameras import PosedCamera, PosedPair
from marssim.base.calibration.lenses.radial_tangential import RadialTangential

EXTERIOR, POINTING = "Exterior_Orientation_Elements", "Vector_Cartesian_3_Pointing"
FRAME = "Zhurong"  # name of the frame of the cameras
VALUES = {
    "focal": ("focal_length", "camera_focal_length"),
    "pixel": ("pixel_size", "pixel_width"),
    "x0": ("principal_point_offset_x", "principal_point_x", "image_principal_point_x0", "x0"),
    "y0": ("principal_point_offset_y", "principal_point_y", "image_principal_point_y0", "y0"),
}
POSITIONS = tuple(f"camera_center_position_{axis}" for axis in "xyz")
PIXEL = 5.5  # [um] of the detector, where the label does not say
PHOTOGRAMMETRIC = np.diag([1.0, -1.0, -1.0])  # our camera frame to one with y up and z backward
# the directions: column and row of the image, from -1 to 1
CORNERS = {
    "up_left": (-1, -1), "down_left": (-1, 1), "up_right": (1, -1), "down_right": (1, 1), "center": (0, 0),
}  # fmt: skip
LEAST_DIRECTIONS = 3
LARGEST_TURN = 15.0  # [deg] between the cameras' positions and the x axes of their orientations
LARGEST_MISS = 0.1  # [deg] by which the directions may miss the interior orientation
# the spellings of the angles, and how each is understood
ABOUT_AXES = tuple(f"camera_rotation_angle_{axis}" for axis in "xyz")
BY_NAME = tuple(f"camera_rotation_angle_{name}" for name in ("pitch", "roll", "yaw"))
UNSETTLED = "the orientation of the cameras is uncertain: the labels have no Vector_Cartesian_3_Pointing, and of their "
NOTES = {
    ABOUT_AXES: f"{UNSETTLED}angles it is assumed that they turn a camera with y up and z backward about x, then y, "
    "then z",
    BY_NAME: f"{UNSETTLED}angles it is assumed that they turn a camera with y down and z forward about z by yaw, then "
    "about y by roll, then about x by pitch",
}


def is_zhurong(root: Element) -> bool:
    """Return whether a label has the fields of Zhurong's exterior orientation."""
    return _first(root, EXTERIOR) is not None


def camera_of_zhurong(root: Element, size: tuple[int, int] | None) -> PosedCamera:
    """Return the camera of a label.

    Args:
        root: The label.
        size: Width and height of the image [px].

    Raises:
        ValueError: A field is missing, or the size of the image is, or the directions do not fit the focal length.
    """
    if size is None:
        raise ValueError("the label does not say the size of the image, which gives its middle")
    exterior = _first(root, EXTERIOR)
    assert exterior is not None
    given = {name: _text(root, names) for name, names in VALUES.items()}
    if given["focal"] is None:
        raise ValueError("field focal_length is missing")
    focal, x0, y0 = (float(fields.numbers(given[name] or "0", name).reshape(-1)[0]) for name in ("focal", "x0", "y0"))
    pixel = float(fields.numbers(given["pixel"] or str(PIXEL), "pixel").reshape(-1)[0])
    pixel = pixel / 1000 if pixel > 1 else pixel  # [mm]
    if not (pixel > 0 and focal > 0):
        raise ValueError("focal_length and pixel_size must be positive")
    centre = _numbers(exterior, POSITIONS)
    f = focal / pixel
    lens = RadialTangential(f, f, (size[0] - 1) / 2 + x0 / pixel, (size[1] - 1) / 2 - y0 / pixel)
    if (pointing := _first(root, POINTING)) is not None:
        return PosedCamera(lens, _turned_onto(pointing, lens, size), centre, size, FRAME)
    if _text(exterior, ABOUT_AXES[:1]) is not None:
        x, y, z = np.deg2rad(_numbers(exterior, ABOUT_AXES))
        rotation = PHOTOGRAMMETRIC @ (_about(2, z) @ _about(1, y) @ _about(0, x)).T
        return PosedCamera(lens, rotation, centre, size, FRAME, NOTES[ABOUT_AXES])
    pitch, roll, yaw = np.deg2rad(_numbers(exterior, BY_NAME))
    rotation = (_about(0, pitch) @ _about(1, roll) @ _about(2, yaw)).T
    return PosedCamera(lens, rotation, centre, size, FRAME, NOTES[BY_NAME])


def check_frames(pair: PosedPair) -> None:
    """Raise ValueError if the cameras of labels do not stand side by side, as positions in another frame than that of
    the directions make it look.
    """
    right = pair.left.rotation[0] + pair.right.rotation[0]
    across = (pair.right.centre - pair.left.centre) / pair.baseline
    angle = float(np.rad2deg(np.arccos(np.clip(right @ across / np.linalg.norm(right), -1, 1))))
    if min(angle, 180 - angle) > LARGEST_TURN:  # exchanged eyes get a message of their own
        raise ValueError(
            f"the positions of the cameras lie {angle:.0f} deg off the line that their orientations make the baseline: "
            "are they in another frame? m3depth.predict --align --focal --baseline does without the labels"
        )


def _turned_onto(pointing: Element, lens: RadialTangential, size: tuple[int, int]) -> np.ndarray:
    """Return the (3, 3) rotation, label's frame to camera frame, that turns pixels onto the directions they look in.

    Args:
        pointing: The directions of the corners and of the middle of the image.
        lens: The camera.
        size: Width and height of the image [px].

    Raises:
        ValueError: There are too few directions, or they do not fit the lens.
    """
    pixels, directions = [], []
    for name, (column, row) in CORNERS.items():
        node = next((node for kind in ("observe_", "") for node in _all(pointing, f"{name}_point_{kind}vector")), None)
        if node is not None:
            pixels.append([(size[0] - 1 + column * size[0]) / 2, (size[1] - 1 + row * size[1]) / 2])
            directions.append(_numbers(node, tuple("xyz")))
    if len(directions) < LEAST_DIRECTIONS:
        raise ValueError(f"{POINTING} has {len(directions)} directions, at least {LEAST_DIRECTIONS} are needed")
    traced, stated = (_unit(np.array(vectors)) for vectors in (lens.rays(np.array(pixels)).direction, directions))
    u, _, vt = np.linalg.svd(
        stated.T @ traced
    )  # Kabsch: the rotation that brings the stated nearest to the traced ones
    rotation = vt.T @ np.diag([1, 1, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    cosine = np.clip((stated @ rotation.T * traced).sum(axis=1), -1, 1)
    if not (miss := float(np.rad2deg(np.arccos(cosine)).max())) <= LARGEST_MISS:
        raise ValueError(f"{POINTING} misses the focal length and the principal point by {miss:.2g} deg")
    return np.asarray(rotation)


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (lengths > 0).all():
        raise ValueError(f"{POINTING} has a direction without length")
    return vectors / lengths


def _all(root: Element, name: str) -> Iterator[Element]:
    """Yield the fields of a name, whose letters labels write large or small."""
    return (node for node in root.iter() if isinstance(node.tag, str) and node.tag.lower() == name.lower())


def _first(root: Element, name: str) -> Element | None:
    return next(_all(root, name), None)


def _text(root: Element, names: tuple[str, ...]) -> str | None:
    return next((node.text for name in names for node in _all(root, name) if (node.text or "").strip()), None)


def _numbers(root: Element, names: tuple[str, ...]) -> np.ndarray:
    """Return the numbers of fields, (N,). Raises ValueError that names one that is missing or no number."""
    values = {name: _text(root, (name,)) for name in names}
    if missing := [name for name, text in values.items() if text is None]:
        raise ValueError(f"field {missing[0]} is missing in {root.tag}")
    return np.array([float(fields.matrix(values, name, (1,))[0]) for name in names])


def _about(axis: int, angle: float) -> np.ndarray:
    """Return the (3, 3) turn about an axis by an angle [rad]."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    turn = np.eye(3)
    turn[[i, j], [i, j]] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return turn
