"""Where the viewer of a page stands, beside a camera in a world with z up."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera

NEAREST, FARTHEST = 0.2, 20.0  # [m] from which a cloud is looked at
WIDEST = 8.0  # [px] between points that are drawn large enough to touch each other


def upright(pose: np.ndarray) -> np.ndarray:
    """Return the frame at a camera whose x axis is the horizontal direction of its view, and whose z axis is up.

    Args:
        pose: (4, 4) camera to world. A camera that looks straight up or down heads where its image is up or down.

    Returns:
        (4, 4) frame to world.
    """
    forward = pose[:2, 2]
    if np.hypot(*forward) < 1e-3:
        forward = -pose[:2, 1] * (1.0 if pose[2, 2] < 0 else -1.0)
    x, y = forward / np.hypot(*forward)
    frame = np.eye(4)
    frame[:2, 0], frame[:2, 1] = (x, y), (-y, x)
    frame[:3, 3] = pose[:3, 3]
    return frame


def moved_along(points: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return points of the world that keep their place beside a camera which moves. Up stays up.

    Args:
        points: (N, 3) [m].
        before, after: (4, 4) camera to world.
    """
    frame = upright(after) @ np.linalg.inv(upright(before))
    return np.asarray(points @ frame[:3, :3].T + frame[:3, 3])


def depth_looked_at(points: np.ndarray) -> float:
    """Return the distance [m] that a cloud is looked at from: its median depth, or 3 m without points.

    Args:
        points: (N, 3) [m], camera frame.
    """
    return float(np.clip(np.median(points[:, 2]), NEAREST, FARTHEST)) if len(points) else 3.0


def stands(pose: np.ndarray, distance: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the places of the viewer by the name of their button: position and what is looked at, (3,) [m] each.

    Args:
        pose: (4, 4) left camera to world.
        distance: What depth_looked_at returns.
    """
    frame = upright(pose)
    eye, ahead, up = frame[:3, 3], frame[:3, 0], frame[:3, 2]
    seen = eye + distance * pose[:3, 2]
    return {
        "From behind": (eye + distance * (0.25 * up - 0.5 * ahead), seen),
        "Through the left camera": (eye, seen),
        # a little behind, so that the way ahead is up in the picture
        "From above": (seen + distance * (1.8 * up - 0.02 * ahead), seen),
    }


def point_size(points: np.ndarray, camera: PinholeCamera) -> float:
    """Return the size [m] of points that nearly touch each other at a cloud's median depth.

    Args:
        points: (N, 3) [m], camera frame.
        camera: The camera, of whose pixels all or some became points.
    """
    apart = np.sqrt(camera.width * camera.height / max(1, len(points)))  # [px]; at most twice too large, for the sky
    return float(depth_looked_at(points) * min(apart, WIDEST) / camera.fx)
