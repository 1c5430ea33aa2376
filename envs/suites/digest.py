"""A digest of a scene, by which a suite notices that a simulator builds another one.

The digest covers the heights of the ground every metre, and place and size of the rocks of 0.3 m and more, rounded to 1
mm. Computers differ in the last bits of such numbers, and one that lies between two millimetres may be rounded to
either. So a scene has two digests, whose steps of rounding lie half a millimetre apart: a number that is in doubt for
one of them is in no doubt for the other. Two scenes are the same if either digest is.
"""

from __future__ import annotations

import hashlib

import numpy as np

from marssim.scene.scene import Scene

STEP = 1e-3  # [m] to which numbers are rounded
GRID = 1.0  # [m] between the heights
LEAST_ROCK = 0.3  # [m] diameter
LENGTH = 16  # hexadecimal digits of a digest


def scene_digests(scene: Scene) -> tuple[str, str]:
    """Return the two digests of a scene's ground and rocks."""
    axis = np.linspace(-scene.half, scene.half, round(2 * scene.half / GRID) + 1)
    heights = scene.terrain.height_at(*np.meshgrid(axis, axis))
    bodies = scene.bodies
    large = bodies.diameter >= LEAST_ROCK
    rocks = np.column_stack([bodies.centre[large], bodies.diameter[large], bodies.height[large]])
    first, second = (_digest([heights, rocks], shift) for shift in (0.0, 0.5))
    return first, second


def _digest(parts: list[np.ndarray], shift: float) -> str:
    sha = hashlib.sha256()
    for part in parts:
        sha.update(np.floor(np.asarray(part, float) / STEP + shift).astype("<i8").tobytes())
    return sha.hexdigest()[:LENGTH]
