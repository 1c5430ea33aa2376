"""The outlines of rocks above ground, seen from above."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from marssim.scene.rocks.mesh import Rocks


def outline_points(
    rocks: Rocks, which: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return points whose convex hulls, seen from above, are the outlines of some rocks above ground.

    The points are the mesh's vertices above ground and the crossings of its edges with the ground.

    Args:
        rocks: All rocks.
        which: (M,) indices of the rocks.
        height_at: Function of x, y [m] that returns the height of the ground [m].

    Returns:
        (P, 2) x, y [m], unordered and with repetitions; and (P,) the position in `which` of each point's rock.
    """
    position = np.full(len(rocks), -1)
    position[which] = np.arange(len(which))
    owner = position[rocks.face_rock]
    faces, owner = rocks.faces[owner >= 0], owner[owner >= 0]
    corners = rocks.vertices[faces]
    above = corners[..., 2] - height_at(corners[..., 0], corners[..., 1])
    points, owners = [np.zeros((0, 2))], [np.zeros(0, owner.dtype)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        exposed = above[:, i] > 0
        cut = exposed != (above[:, j] > 0)  # the edge crosses the ground
        share = (above[cut, i] / (above[cut, i] - above[cut, j]))[:, None]
        points += [corners[exposed, i, :2], (1 - share) * corners[cut, i, :2] + share * corners[cut, j, :2]]
        owners += [owner[exposed], owner[cut]]
    return np.concatenate(points), np.concatenate(owners)


def reach_above_ground(
    rocks: Rocks, which: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return how far some rocks reach sideways from their centres above ground.

    A rock of diameter D is no disc: its mesh reaches farther than D / 2.

    Args:
        rocks: All rocks.
        which: (M,) indices of the rocks.
        height_at: Function of x, y [m] that returns the height of the ground [m].

    Returns:
        (M,) horizontal reach [m]; 0 for a rock that is below ground.
    """
    points, owner = outline_points(rocks, which, height_at)
    out = np.zeros(len(which))
    np.maximum.at(out, owner, np.hypot(*(points - rocks.centre[which][owner, :2]).T))
    return out
