"""Cameras as they were built: a lens with a pose and an image size, and two of them as a pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.calibration.lenses.cahvore import Cahvore, Vector
from marssim.base.calibration.lenses.lens import Lens, Rays, unit
from marssim.base.camera import WIDEST_BASELINE

SHORTEST_BASELINE = 1e-4  # [m]
FAR = 1e4  # [m] distance of what a direction sees; entrance pupils move by millimetres
ROUNDING = 1e-2  # by which a rotation in a file may miss an orthonormal matrix


@dataclass(frozen=True)
class PosedCamera:
    """A lens at a place in the frame of its rig.

    Attributes:
        lens: The lens model.
        rotation: (3, 3) rig frame to camera frame.
        centre: (3,) the camera's centre [m], rig frame.
        size: Width and height of its images [px]; None if the calibration does not say.
        frame: Name of the rig frame, where a label gives one; two cameras of a pair must agree.
        note: What is uncertain about the camera, for a warning.
    """

    lens: Lens
    rotation: np.ndarray
    centre: np.ndarray
    size: tuple[int, int] | None = None
    frame: str = ""
    note: str = ""

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return (..., 2) the pixels that show points (..., 3) of the rig frame; NaN where the camera does not."""
        return self.lens.project((np.asarray(points, dtype=float) - self.centre) @ self.rotation.T)

    def project_directions(self, directions: np.ndarray) -> np.ndarray:
        """Return (..., 2) the pixels that see far away in directions (..., 3) of the rig frame; NaN where none does."""
        return self.lens.project(FAR * (np.asarray(directions, dtype=float) @ self.rotation.T))

    def rays(self, pixels: np.ndarray) -> Rays:
        """Return the rays of pixels (..., 2), in the rig frame."""
        rays = self.lens.rays(pixels)
        return Rays(rays.origin @ self.rotation + self.centre, rays.direction @ self.rotation)

    @property
    def axis(self) -> np.ndarray:
        """(3,) the direction of the camera's z axis in the rig frame."""
        return self.rotation[2]


@dataclass(frozen=True)
class PosedPair:
    """Two cameras in one frame, as a calibration gives them. They are not rectified.

    Attributes:
        left, right: The cameras.

    Raises:
        ValueError: The cameras have different frames, or no baseline that a rig can have.
    """

    left: PosedCamera
    right: PosedCamera

    def __post_init__(self) -> None:
        if self.left.frame != self.right.frame:
            raise ValueError(
                f"the cameras stand in different frames, {self.left.frame} and {self.right.frame}: "
                "are the images of different times?"
            )
        if not self.baseline >= SHORTEST_BASELINE:
            raise ValueError(f"the cameras stand {self.baseline:g} m apart: are both files of one eye?")
        if self.baseline > WIDEST_BASELINE:
            raise ValueError(f"the cameras stand {self.baseline:g} m apart; is the translation in millimetres?")

    @property
    def baseline(self) -> float:
        """Distance of the cameras' centres [m]."""
        return float(np.linalg.norm(self.right.centre - self.left.centre))

    @property
    def vergence(self) -> float:
        """Angle between the cameras' z axes [rad]."""
        cross = np.linalg.norm(np.cross(self.left.axis, self.right.axis))
        return float(np.arctan2(cross, self.left.axis @ self.right.axis))


def second_camera(
    lens: Lens, rotation: np.ndarray, translation: np.ndarray, size: tuple[int, int] | None = None
) -> PosedCamera:
    """Return a camera from the transformation of the first camera's frame to its own, x2 = R x1 + t.

    Args:
        lens: Its lens.
        rotation: (3, 3) R.
        translation: (3,) t [m].
        size: Width and height of its images [px].

    Raises:
        ValueError: R is no rotation.
    """
    rotation = nearest_rotation(rotation)
    return PosedCamera(lens, rotation, -rotation.T @ np.asarray(translation, dtype=float).reshape(3), size)


def first_camera(lens: Lens, size: tuple[int, int] | None = None) -> PosedCamera:
    """Return a camera whose frame is that of the rig."""
    return PosedCamera(lens, np.eye(3), np.zeros(3), size)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """Return the rotation next to a (3, 3) matrix that was rounded.

    Raises:
        ValueError: The matrix is no rotation.
    """
    matrix = np.asarray(matrix, dtype=float)
    if (np.abs(matrix) <= 1 + ROUNDING).all():  # with infinities, the decomposition does not end
        u, _, vt = np.linalg.svd(matrix)
        rotation = u @ vt
        if np.linalg.det(rotation) > 0 and np.abs(rotation - matrix).max() <= ROUNDING:
            return rotation
    raise ValueError("the rotation between the cameras is no rotation matrix")


def from_vectors(
    c: np.ndarray, a: np.ndarray, h: np.ndarray, v: np.ndarray, o: np.ndarray | None = None,
    r: Vector = (0.0, 0.0, 0.0), e: Vector = (0.0, 0.0, 0.0), linearity: float = 1.0,
    size: tuple[int, int] | None = None, frame: str = "",
) -> PosedCamera:  # fmt: skip
    """Return the camera of a CAHV, CAHVOR or CAHVORE model. See lenses/cahvore.py for its vectors.

    Args:
        c: (3,) C [m], rig frame.
        a: (3,) A, rig frame.
        h: (3,) H [px], rig frame.
        v: (3,) V [px], rig frame.
        o: (3,) O, rig frame; None is A.
        r: R.
        e: E [m].
        linearity: L.
        size: Width and height of the images [px].
        frame: Name of the rig frame.

    Raises:
        ValueError: The vectors are no camera: parallel, mirrored, or an axis that is not of unit length.
    """
    c, a, h, v = (np.asarray(x, dtype=float) for x in (c, a, h, v))
    o = a if o is None else np.asarray(o, dtype=float)
    for name, axis in (("A", a), ("O", o)):
        if abs(np.linalg.norm(axis) - 1) > ROUNDING:
            raise ValueError(f"vector {name} of the camera model must have length 1, has {np.linalg.norm(axis):g}")
    z, optical = unit(a), unit(o)
    across = h - (h @ z) * z
    if not np.linalg.norm(across) > 0:
        raise ValueError("vectors A and H of the camera model are parallel")
    x = unit(across)
    rotation = np.stack([x, np.cross(z, x), z])
    if not v @ rotation[1] > 0:
        raise ValueError("vectors A, H and V of the camera model are left-handed, as of a mirrored image")
    in_camera = (tuple(float(value) for value in rotation @ vector) for vector in (a, h, v, optical))
    a_, h_, v_, o_ = in_camera
    lens = Cahvore(a_, h_, v_, o_, tuple(r), tuple(e), linearity)  # type: ignore[arg-type]
    return PosedCamera(lens, rotation, c, size, frame)
