"""Maps of how rocks change the ground around them: they hide part of the sky, and fragments lie at their feet."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.scene.ground.bilinear import bilinear_weights
from marssim.scene.rocks.mesh import Rocks

CELL = 0.05  # [m] grid spacing of the maps
SMALLEST = 0.12  # [m] diameter of the smallest rocks that count
REACHES = (0.08, 0.24)  # [m] distances over which a rock of that height hides sky
APRON = 1.7  # radius of the area with fragments, in radii of the rock
FRAGMENTS = 0.6  # density of fragments there, 0 to 1
APRON_BORDER = 0.1  # [m] standard deviation of the blur at its border
SHIFT = 4  # binary digits of sub-pixel positions in OpenCV's drawing
CODE = 255  # code of a share of 1


def surroundings(rocks: Rocks, half: float, outcrop: Rocks | None = None) -> np.ndarray:
    """Return the maps of a scene's fine square.

    Args:
        rocks: The rocks.
        half: Half the side of the square [m].
        outcrop: Bodies that hide sky too, but shed no fragments; None for none.

    Returns:
        (N, N, 2) uint8 on a grid of spacing CELL, rows northward, columns eastward, in units of 1 / CODE: the share of
        the sky that rocks hide from level ground (half at the foot of a wall), and the density of fragments around
        them.
    """
    side = int(np.ceil(2 * half / CELL)) + 1
    height, rubble = np.zeros((2, side, side), dtype=np.float32)
    one = 1 << SHIFT
    if outcrop is not None:
        for n, (x, y), r in zip(*_discs(outcrop, half)):
            cv2.circle(
                height, (round(x * one), round(y * one)), round(r * one), outcrop.height[n], -1, cv2.LINE_8, SHIFT
            )
    chosen, at, radius = _discs(rocks, half)
    for (x, y), r, tall in zip(np.rint(at * one), np.rint(radius * one), rocks.height[chosen]):
        cv2.circle(height, (int(x), int(y)), int(r), float(tall), -1, cv2.LINE_8, SHIFT)
        cv2.circle(rubble, (int(x), int(y)), int(APRON * r), FRAGMENTS, -1, cv2.LINE_8, SHIFT)
    hidden = np.mean(
        [cv2.GaussianBlur(np.minimum(height / reach, 1), (0, 0), reach / CELL) for reach in REACHES], axis=0
    )
    broken = cv2.GaussianBlur(rubble, (0, 0), APRON_BORDER / CELL)
    return np.rint(CODE * np.stack([hidden, broken], axis=-1)).astype(np.uint8)


def _discs(bodies: Rocks, half: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the bodies (N,) that count, the largest first, and their middles (N, 2) and radii (N,) in cells."""
    chosen = np.flatnonzero((bodies.diameter > SMALLEST) & (np.abs(bodies.centre[:, :2]) < half + 1).all(axis=1))
    chosen = chosen[np.argsort(-bodies.diameter[chosen], kind="stable")]
    return chosen, (bodies.centre[chosen, :2] + half) / CELL, bodies.diameter[chosen] / 2 / CELL


@inlined
def hidden_sky_at(near, half, x, y):
    """Return the share of hidden sky at x, y [m]; 0 outside the map. near: of `surroundings`."""
    i, j = (x + half) * np.float32(1 / CELL), (y + half) * np.float32(1 / CELL)
    top = np.float32(len(near) - 1)
    if not (i >= 0 and j >= 0 and i < top and j < top):
        return np.float32(0)
    left, low = np.int32(i), np.int32(j)
    a, b, c, d = bilinear_weights(i - left, j - low)
    p, q = near[low, left, 0], near[low, left + 1, 0]
    r, w = near[low + 1, left, 0], near[low + 1, left + 1, 0]
    return (a * p + b * q + c * r + d * w) * np.float32(1 / CODE)
