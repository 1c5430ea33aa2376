"""How much of the sun stones and fine relief leave free over a point of the ground."""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.relief.height import around, footprint_at, near_height
from marssim.render.relief.stones.hits import Piece, most_stones, stone_hit, tallest
from marssim.scene.look import SUN_RADIUS

LONGEST_SHADOW = 0.5  # [m] length of a ray to the sun that is followed among stones
SHADOW_STEPS = 3  # places over which the fine relief may hide the sun


@inlined
def sun_share(data, relief, stones, steepest, eye, focal, x, y, z, gap, east, north, sun):
    """Return the share of the sun's disc that relief and stones leave free over a point, 0 to 1, float32.

    x, y, z: the point, a little off its surface; gap: its height over the ground between the stones; east, north:
    slopes of that ground; sun: unit vector towards the sun. Hills and rocks are not looked at.
    """
    growth = sun[2] - east * sun[0] - north * sun[1]
    if growth <= 0.02:
        return np.float32(1)
    footprint = footprint_at(eye, focal, x, y, z)
    ranks = most_stones(data, relief.cover, x, y)
    top = tallest(stones.octave, ranks, footprint)
    if gap < top:
        length = min((top - gap) / growth, LONGEST_SHADOW)
        piece = Piece(x, y, z, gap, sun[0], sun[1], growth, length)
        if stone_hit(data, relief.cover, stones, eye, focal, footprint, ranks, piece).stone >= 0:
            return np.float32(0)
    free = np.float32(1)
    level = math.sqrt(sun[0] * sun[0] + sun[1] * sun[1])
    if sun[2] < level * (2.5 * steepest + 0.1):
        reach = max(0.012, 1.5 * footprint) / level
        model = around(data, relief, np.float32(x), np.float32(y), footprint)
        for _ in range(SHADOW_STEPS):
            height, _, _, _, _ = near_height(data, model, np.float32(reach * sun[0]), np.float32(reach * sun[1]))
            blur = SUN_RADIUS * reach + 0.1 * footprint
            free = min(free, np.float32(min(max(0.5 + 0.5 * (z + reach * sun[2] - height) / blur, 0.0), 1.0)))
            reach *= 2.2
    return free
