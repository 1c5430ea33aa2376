"""Pinhole cameras and rectified stereo rigs.

Convention: camera frame x right, y down, z forward (OpenCV). Pixel centres are integers, so the principal point of
an image of width W lies at (W - 1) / 2. Depth is z along the optical axis, not ray length. A pose is the 4 x 4 matrix
that takes camera coordinates to world coordinates (world: x east, y north, z up).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from marssim.base.masked import filled

LARGEST_FLOAT = sys.float_info.max
NARROWEST_BASELINE = 0.001  # [m] a smaller one is taken for metres that were read as millimetres
WIDEST_BASELINE = 10.0  # [m] a larger one is taken for millimetres
LARGEST_IMAGE = 1 << 16  # [px] width and height
LONGEST_FOCAL = 1e9  # [px]
FARTHEST_PRINCIPAL_POINT = 1e6  # [px] from the first pixel, for parts of images that do not hold it
MIN_DEPTH = 0.5  # [m] nearest depth that is scored (paper, Sec. V-B)
MAX_DEPTH = 15.0  # [m] farthest depth that is scored


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion.

    Attributes:
        width: Width of the image [px].
        height: Height of the image [px].
        fx: Focal length along the rows [px].
        fy: Focal length along the columns [px].
        cx: Column of the principal point [px].
        cy: Row of the principal point [px].

    Raises:
        ValueError: A value is out of range. One line that begins with its name.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not 1 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be at least 1 pixel, got {getattr(self, name)}")
            if getattr(self, name) % 1:
                raise ValueError(f"{name} must be a whole number of pixels, got {getattr(self, name)}")
            object.__setattr__(self, name, int(getattr(self, name)))  # also of 512.0, as files may have it
            if getattr(self, name) > LARGEST_IMAGE:
                raise ValueError(f"{name} must be at most {LARGEST_IMAGE} px, got {getattr(self, name)}")
        for name in ("fx", "fy"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive and finite [px], got {getattr(self, name)}")
            if getattr(self, name) > LONGEST_FOCAL:
                raise ValueError(f"{name} must be at most {LONGEST_FOCAL:g} px, got {getattr(self, name):g}")
        for name in ("cx", "cy"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite [px], got {getattr(self, name)}")
            if abs(getattr(self, name)) > FARTHEST_PRINCIPAL_POINT:
                raise ValueError(
                    f"{name} must lie within +-{FARTHEST_PRINCIPAL_POINT:.0f} px, got {getattr(self, name):g}"
                )

    @classmethod
    def centred(cls, width: int, height: int, focal: float) -> PinholeCamera:
        """Return a camera with square pixels and its principal point in the middle of the image.

        Args:
            width: Width of the image [px].
            height: Height of the image [px].
            focal: Focal length [px].
        """
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)

    @property
    def K(self) -> np.ndarray:
        """(3, 3) intrinsic matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def fov(self) -> tuple[float, float]:
        """Horizontal and vertical field of view [rad], from outer pixel edge to outer pixel edge."""
        half_x = np.arctan2([self.cx + 0.5, self.width - 0.5 - self.cx], self.fx)
        half_y = np.arctan2([self.cy + 0.5, self.height - 0.5 - self.cy], self.fy)
        return float(half_x.sum()), float(half_y.sum())

    def rays(self) -> np.ndarray:
        """Return the direction of each pixel centre.

        Returns:
            (H, W, 3) float64, camera frame, scaled to z = 1. The array is read-only, since calls share it.
        """
        return _rays(self)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points to the image.

        Args:
            points: (..., 3) [m], camera frame.

        Returns:
            (..., 2) column u and row v [px]; NaN for points in the plane of the camera or behind it.
        """
        points = np.asarray(points, dtype=float)
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        u = self.fx * points[..., 0] / z + self.cx
        v = self.fy * points[..., 1] / z + self.cy
        return np.stack([u, v], axis=-1)

    def unproject(self, depth: np.ndarray) -> np.ndarray:
        """Return the points that a depth map shows.

        Args:
            depth: (H, W) [m] along the optical axis.

        Returns:
            (H, W, 3) [m], camera frame; not finite where depth is not.

        Raises:
            ValueError: The map has another size than the image.
        """
        depth = np.asarray(depth)
        if depth.shape != (self.height, self.width):
            raise ValueError(f"depth must have the shape {(self.height, self.width)} of the image, got {depth.shape}")
        return self.rays() * depth[..., None]

    def cropped(self, x: int, y: int, width: int, height: int) -> PinholeCamera:
        """Return the camera of a part of the image.

        Args:
            x: First column of the part [px].
            y: First row of the part [px].
            width: Width of the part [px].
            height: Height of the part [px].
        """
        return PinholeCamera(width, height, self.fx, self.fy, self.cx - x, self.cy - y)

    def resized(self, width: int, height: int) -> PinholeCamera:
        """Return the camera of the resampled image, whose outer pixel edges stay where they are.

        Args:
            width: New width [px].
            height: New height [px].
        """
        sx, sy = width / self.width, height / self.height
        return PinholeCamera(
            width, height, self.fx * sx, self.fy * sy, (self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5
        )


@lru_cache(maxsize=4)
def _rays(camera: PinholeCamera) -> np.ndarray:
    out = np.ones((camera.height, camera.width, 3))
    out[..., 0] = (np.arange(camera.width) - camera.cx) / camera.fx
    out[..., 1] = ((np.arange(camera.height) - camera.cy) / camera.fy)[:, None]
    out.flags.writeable = False
    return out


@dataclass(frozen=True)
class StereoRig:
    """Two equal, rectified cameras. The right one stands at x = +baseline in the frame of the left one.

    Attributes:
        camera: Either camera.
        baseline: Distance between the cameras [m].

    Raises:
        ValueError: The baseline is out of range.
    """

    camera: PinholeCamera
    baseline: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.baseline) and self.baseline > 0):
            raise ValueError(f"baseline must be positive and finite [m], got {self.baseline}")
        if self.baseline > WIDEST_BASELINE:
            raise ValueError(
                f"baseline must be at most {WIDEST_BASELINE:g} m, got {self.baseline:g}; is it in millimetres?"
            )

    @property
    def fb(self) -> float:
        """Focal length times baseline [px m]: depth = fb / disparity."""
        return self.camera.fx * self.baseline

    def disparity_to_depth(self, disparity: np.ndarray) -> np.ndarray:
        """Convert disparity of rectified pixels to depth, Z = f B / d.

        Args:
            disparity: (...) [px], x_left - x_right; values <= 0, NaN and masked ones mean no match.

        Returns:
            (...) depth [m] along the optical axis; inf where there is no match. Floats keep their precision, integers
            give float64.
        """
        disparity = _floating(disparity)
        match = disparity > 0
        return np.where(match, self.fb / np.where(match, disparity, 1), np.inf).astype(disparity.dtype, copy=False)

    def depth_to_disparity(self, depth: np.ndarray) -> np.ndarray:
        """Convert depth to disparity of rectified pixels, d = f B / Z.

        Args:
            depth: (...) [m] along the optical axis.

        Returns:
            (...) disparity [px], x_left - x_right; 0 where depth is infinite, NaN, masked or <= 0. Floats keep their
            precision, integers give float64.
        """
        depth = _floating(depth)
        valid = np.isfinite(depth) & (depth > 0)
        return np.where(valid, self.fb / np.where(valid, depth, 1), 0).astype(depth.dtype, copy=False)

    def right_pose(self, left_pose: np.ndarray) -> np.ndarray:
        """Return the pose of the right camera.

        Args:
            left_pose: (4, 4) left camera to world.

        Returns:
            (4, 4) right camera to world.
        """
        out = np.array(left_pose, dtype=float)
        out[:3, 3] += out[:3, 0] * self.baseline
        return out

    def cropped(self, x: int, y: int, width: int, height: int) -> StereoRig:
        """Return the rig of the same part of both images.

        Args:
            x: First column of the part [px].
            y: First row of the part [px].
            width: Width of the part [px].
            height: Height of the part [px].
        """
        return replace(self, camera=self.camera.cropped(x, y, width, height))

    def resized(self, width: int, height: int) -> StereoRig:
        """Return the rig of both images resampled. Disparities scale with the width.

        Args:
            width: New width [px].
            height: New height [px].
        """
        return replace(self, camera=self.camera.resized(width, height))

    def to_dict(self) -> dict[str, Any]:
        """Return the rig as plain numbers by name, for JSON; from_dict reads them."""
        c = self.camera
        values = {
            "width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy,
            "baseline": self.baseline,
        }  # fmt: skip
        return {name: v.item() if isinstance(v, np.generic) else v for name, v in values.items()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> StereoRig:
        """Return the rig that to_dict wrote.

        Args:
            data: width, height, fx, fy, cx, cy [px] and baseline [m].

        Raises:
            ValueError: A field is missing or malformed. One line that names it.
        """
        if not isinstance(data, dict):
            raise ValueError(f"stereo rig: must have named fields, is a {type(data).__name__}")

        def read(name: str, whole: bool = False) -> float:
            if name not in data:
                raise ValueError(f"stereo rig: field {name!r} is missing")
            value = data[name]
            number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
            if not (number and abs(value) <= LARGEST_FLOAT) or (whole and value % 1):
                raise ValueError(f"stereo rig: field {name!r} must be a {'whole' if whole else 'finite'} number")
            return float(value)

        width, height = (int(read(name, whole=True)) for name in ("width", "height"))
        fx, fy, cx, cy, baseline = (read(name) for name in ("fx", "fy", "cx", "cy", "baseline"))
        try:
            return cls(PinholeCamera(width, height, fx, fy, cx, cy), baseline)
        except ValueError as error:
            raise ValueError(f"stereo rig: {error}") from None


NATECAM = StereoRig(PinholeCamera.centred(512, 512, 595.90), baseline=0.270)
"""Zhurong's Navigation and Terrain Camera: 512 x 512 px, f = 595.90 px, 46.5 deg, 270 mm baseline (paper, Sec. V-B)."""


def _floating(values: np.ndarray) -> np.ndarray:
    """Return values as an array of floats: floats keep their precision, integers become float64."""
    values = filled(values)
    return values if np.issubdtype(values.dtype, np.floating) else values.astype(float)
