"""A digest of a scene, by which a suite notices that a simulator builds another one.

The digest covers the heights of the ground every metre, and place and size of the rocks of 0.3 m and more, rounded to 1
mm. A scene has tens of thousands of such numbers. One that lies at a step of the rounding may fall to either side where
computers differ in its last bits. So a scene has two digests, whose steps lie half a millimetre apart, and two scenes
count as the same if either digest is.

This forgives a difference only where one of the digests has no number that moves over a step. Differences of the last
bits of float64 (1e-12 m) hardly ever move one. Differences of up to 1e-7 m in all numbers change both digests in 40 %
of the scenes with 20,000 numbers and in 65 % of those with 33,000, and of up to 1e-6 m in nearly all. So a simulator
whose numbers differ that much throughout is refused, though no drive might show it. One that differs in few numbers
mostly is not: with OpenCV's AVX2 and FMA switched off, few numbers move, by 1.2e-5 m at most, and nine courses matched.
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
