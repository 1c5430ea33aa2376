"""The camera of Zhurong's labels (.2CL), from the fields of their interior and exterior orientation.

No product was at hand. What is assumed, and must be checked against a pair before depth is relied on:

- Names of fields as in VALUES; lengths of the interior orientation in millimetres, of the pixel in micrometres if it is
  over 1, else in millimetres; the principal point's offsets count from the middle of the image, to the right and up.
- Exterior orientation in the rover's frame: the centre in metres, and the angles in degrees of turns about x, then y,
  then z, which take the camera's photogrammetric frame (x right, y up, z backward) to the rover's.
- The lens has no distortion: the images of level 2C are said to be corrected.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.cameras import PosedCamera
from marssim.base.calibration.lenses.radial_tangential import RadialTangential

EXTERIOR = "Exterior_Orientation_Elements"
VALUES = {
    "focal": ("focal_length", "camera_focal_length", "Focal_Length"),
    "pixel": ("pixel_size", "pixel_width", "Pixel_Size"),
    "x0": ("principal_point_offset_x", "principal_point_x", "image_principal_point_x0", "x0"),
    "y0": ("principal_point_offset_y", "principal_point_y", "image_principal_point_y0", "y0"),
}
PIXEL = 5.5  # [um] of the detector, where the label does not say
PHOTOGRAMMETRIC = np.diag([1.0, -1.0, -1.0])  # our camera frame to one with y up and z backward


def is_zhurong(root: Element) -> bool:
    """Return whether a label has the fields of Zhurong's exterior orientation."""
    return next(root.iter(EXTERIOR), None) is not None


def camera_of_zhurong(root: Element, size: tuple[int, int] | None) -> PosedCamera:
    """Return the camera of a label.

    Args:
        root: The label.
        size: Width and height of the image [px].

    Raises:
        ValueError: A field is missing, or the size of the image is.
    """
    if size is None:
        raise ValueError("the label does not say the size of the image, which gives its middle")
    exterior = next(root.iter(EXTERIOR))
    given = {name: _text(root, names) for name, names in VALUES.items()}
    if given["focal"] is None:
        raise ValueError("field focal_length is missing")
    focal, x0, y0 = (float(fields.numbers(given[name] or "0", name).reshape(-1)[0]) for name in ("focal", "x0", "y0"))
    pixel = float(fields.numbers(given["pixel"] or str(PIXEL), "pixel").reshape(-1)[0])
    pixel = pixel / 1000 if pixel > 1 else pixel  # [mm]
    if not (pixel > 0 and focal > 0):
        raise ValueError("focal_length and pixel_size must be positive")
    position = {EXTERIOR: [exterior.findtext(f".//camera_center_position_{axis}") for axis in "xyz"]}
    angles = {EXTERIOR: [exterior.findtext(f".//camera_rotation_angle_{axis}") for axis in "xyz"]}
    centre = fields.matrix(position, EXTERIOR, (3,))
    x, y, z = np.deg2rad(fields.matrix(angles, EXTERIOR, (3,)))
    to_rover = _about(2, z) @ _about(1, y) @ _about(0, x)
    f = focal / pixel
    lens = RadialTangential(f, f, (size[0] - 1) / 2 + x0 / pixel, (size[1] - 1) / 2 - y0 / pixel)
    return PosedCamera(lens, PHOTOGRAMMETRIC @ to_rover.T, centre, size, "Zhurong")


def _text(root: Element, names: tuple[str, ...]) -> str | None:
    return next((node.text for name in names for node in root.iter(name) if node.text), None)


def _about(axis: int, angle: float) -> np.ndarray:
    """Return the (3, 3) turn about an axis by an angle [rad]."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    turn = np.eye(3)
    turn[[i, j], [i, j]] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return turn
