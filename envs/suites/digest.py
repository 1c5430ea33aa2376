"""A digest of a scene, by which a suite notices that a simulator builds another one.

The digest covers the heights of the ground on both grids of the terrain, out to the horizon, and the vertices of all
rocks and slabs, rounded to 1 mm. These are a million numbers or more. One that lies at a step of the rounding may fall
to either side where computers differ in its last bits. So a scene has two digests, whose steps lie half a millimetre
apart, and two scenes count as the same if either digest is. A number that lies at a step of one, as the height 0 does,
is far from the steps of the other.

Processors with other instructions build scenes that differ by less than 1e-12 m, which changes both digests of hardly
any scene. Differences of 1e-6 m in all numbers change both of every scene.
"""

from __future__ import annotations

import hashlib

import numpy as np

from marssim.scene.scene import Scene

STEP = 1e-3  # [m] to which numbers are rounded
LENGTH = 16  # hexadecimal digits of a digest


def scene_digests(scene: Scene) -> tuple[str, str]:
    """Return the two digests of a scene's ground, rocks and slabs."""
    parts = [scene.terrain.fine.heights, scene.terrain.coarse.heights, scene.bodies.vertices]
    first, second = (_digest(parts, shift) for shift in (0.0, 0.5))
    return first, second


def _digest(parts: list[np.ndarray], shift: float) -> str:
    sha = hashlib.sha256()
    for part in parts:
        sha.update(np.floor(np.asarray(part, float) / STEP + shift).astype("<i4").tobytes())
    return sha.hexdigest()[:LENGTH]
