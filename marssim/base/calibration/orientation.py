"""The common orientation of a rectified pair, and the views of its two cameras (Fusiello, Trucco and Verri 2000)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from marssim.base.calibration.cameras import PosedCamera, PosedPair
from marssim.base.calibration.lenses.lens import unit
from marssim.base.camera import PinholeCamera

WIDEST = np.deg2rad(70)  # largest angle between a view's edge and the optical axis; tan grows beyond all use there
LEAST_FOCAL = 0.5  # share of the lenses' focal length that a focal length chosen here has at least
FIELD = (1.0, 150.0)  # [deg] least and greatest width of a view whose focal length was asked for
FILLED = 0.98  # share of a view's border that must be visible


@dataclass(frozen=True)
class RectifiedView:
    """Two ideal cameras with one orientation, whose images are rectified.

    Attributes:
        rotation: (3, 3) rig frame to the frame of both cameras: x along the baseline, z forward.
        left, right: The cameras. They differ in cx alone; the right one's cx less the left one's is the shift.
        baseline: Distance of the cameras [m].
    """

    rotation: np.ndarray
    left: PinholeCamera
    right: PinholeCamera
    baseline: float

    @property
    def shift(self) -> float:
        """What is taken out of all disparities [px]: Z = f B / (x_left - x_right + shift)."""
        return self.right.cx - self.left.cx

    def with_shift(self, shift: float) -> RectifiedView:
        """Return the view with another shift [px]; the left camera stays."""
        return replace(self, right=replace(self.right, cx=self.left.cx + shift))


def common_orientation(pair: PosedPair) -> np.ndarray:
    """Return the orientation of both rectified cameras: x along the baseline, z near the mean of the optical axes.

    Args:
        pair: The cameras.

    Returns:
        (3, 3) rig frame to rectified frame.

    Raises:
        ValueError: The right camera stands left of the left one, or before it, so that no such images exist.
    """
    x = unit(pair.right.centre - pair.left.centre)
    forward = unit(pair.left.axis + pair.right.axis)
    right = unit(pair.left.rotation[0] + pair.right.rotation[0])
    if x @ right < 0 and abs(x @ forward) < abs(x @ right):
        raise ValueError("the right camera of the calibration stands left of the left one: exchange left and right")
    z = forward - (forward @ x) * x
    if np.linalg.norm(z) < 0.5 or x @ right < 0.5:
        raise ValueError("the cameras do not stand side by side: such a pair cannot be rectified")
    z = unit(z)
    return np.stack([x, np.cross(z, x), z])


def rectified_view(
    pair: PosedPair, focal: float | None = None, size: tuple[int, int] | None = None, apart: bool = False
) -> RectifiedView:
    """Choose the cameras of the rectified images.

    The middles of both images come to the middle of the rectified ones as far as one row for both allows.

    Args:
        pair: The cameras; both must have a size.
        focal: Focal length [px]. None takes the shortest with which both rectified images are filled, but at least half
            of the lenses' own and at most all of it.
        size: Width and height [px]; None takes those of the left image.
        apart: Give each eye the principal point that puts its own content in the middle, as cameras that are turned
            towards each other need; otherwise both have one.

    Raises:
        ValueError: The cameras do not stand side by side, or no lens has such a focal length.
    """
    rotation = common_orientation(pair)
    assert pair.left.size is not None and pair.right.size is not None
    width, height = size or pair.left.size
    middles = [_middle(camera, rotation) for camera in (pair.left, pair.right)]
    row = (middles[0][1] + middles[1][1]) / 2
    columns = [middle[0] for middle in middles] if apart else [(middles[0][0] + middles[1][0]) / 2] * 2

    def view(f: float) -> RectifiedView:
        left, right = (
            PinholeCamera(width, height, f, f, (width - 1) / 2 - f * column, (height - 1) / 2 - f * row)
            for column in columns
        )
        return RectifiedView(rotation, left, right, pair.baseline)

    if focal is not None:
        angle = np.rad2deg(2 * np.arctan2(width / 2, focal))
        if not FIELD[0] <= angle <= FIELD[1]:
            raise ValueError(
                f"a focal length of {focal:g} px makes rectified images of {width} px {angle:.3g} deg wide; "
                "it is counted in pixels of these images"
            )
        return view(focal)
    scale = np.sqrt(width * height / (pair.left.size[0] * pair.left.size[1]))
    lens_focal = float(scale * min(pair.left.lens.focal(), pair.right.lens.focal()))
    low, high = LEAST_FOCAL * lens_focal, lens_focal
    if _is_filled(pair, view(low)):
        return view(low)
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if _is_filled(pair, view(middle)) else (middle, high)
    return view(high)


def directions(camera: PinholeCamera, rotation: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return (..., 3) the directions that pixels (..., 2) of a rectified camera see, in the rig frame.

    Args:
        camera: The rectified camera.
        rotation: (3, 3) rig frame to its frame.
        pixels: (..., 2) column and row [px].
    """
    x, y = (pixels[..., 0] - camera.cx) / camera.fx, (pixels[..., 1] - camera.cy) / camera.fy
    return np.stack([x, y, np.ones_like(x)], axis=-1) @ rotation


def _middle(camera: PosedCamera, rotation: np.ndarray) -> tuple[float, float]:
    """Return x / z and y / z of the direction that the middle of a camera's image sees, in the rectified frame."""
    assert camera.size is not None
    middle = np.array([(camera.size[0] - 1) / 2, (camera.size[1] - 1) / 2])
    x, y, z = rotation @ camera.rays(middle).direction
    if not z > np.cos(WIDEST):
        raise ValueError("the middle of an image lies too far off the common optical axis to be rectified")
    return float(x / z), float(y / z)


def _is_filled(pair: PosedPair, view: RectifiedView) -> bool:
    """Return whether nearly all of the border of both rectified images shows what the cameras see."""
    shares = []
    for camera, ideal in ((pair.left, view.left), (pair.right, view.right)):
        assert camera.size is not None
        u, v = np.linspace(0, ideal.width - 1, 65), np.linspace(0, ideal.height - 1, 65)
        border = np.concatenate(
            [np.stack(np.broadcast_arrays(u, edge), -1) for edge in (0, ideal.height - 1)]
            + [np.stack(np.broadcast_arrays(edge, v), -1) for edge in (0, ideal.width - 1)]
        )
        pixels = camera.project_directions(directions(ideal, view.rotation, border))
        with np.errstate(invalid="ignore"):
            inside = (pixels >= -0.5).all(-1) & (pixels <= np.array(camera.size) - 0.5).all(-1)
        shares.append(inside.mean())
    return min(shares) >= FILLED
