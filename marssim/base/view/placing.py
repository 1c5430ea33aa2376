"""Where the viewer of a page stands, beside a camera in a world with z up."""

from __future__ import annotations

import numpy as np

from marssim.base.pose import moved
from marssim.base.view.scene import View

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
    return moved(points, frame)


def reach_of(view: View) -> float:
    """Return the distance [m] at which a viewer looks: that of the view, the median depth, or 3 m without points."""
    if view.reach is not None:
        return view.reach
    return float(np.clip(np.median(view.points[:, 2]), NEAREST, FARTHEST)) if len(view.points) else 3.0


def stands(pose: np.ndarray, reach: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the places of the viewer by the name of their button: position and what is looked at, (3,) [m] each.

    Args:
        pose: (4, 4) left camera to world.
        reach: What reach_of returns [m].
    """
    frame = upright(pose)
    eye, ahead, up = frame[:3, 3], frame[:3, 0], frame[:3, 2]
    target = eye + reach * pose[:3, 2]
    return {
        "From behind": (eye + reach * (0.25 * up - 0.5 * ahead), target),
        "Through the left camera": (eye, target),
        # a little behind, so that the way ahead is up in the picture
        "From above": (target + reach * (1.8 * up - 0.02 * ahead), target),
    }


def point_size(view: View) -> float:
    """Return the size [m] of points that nearly touch each other at the median depth of a view."""
    camera = view.rig.camera
    apart = np.sqrt(camera.width * camera.height / max(1, len(view.points)))  # [px]; too large where there is much sky
    return float(reach_of(view) * min(apart, WIDEST) / camera.fx)
