"""Finds the pixels in the soft borders of shadows, which see a part of the sun's disc only.

A border is as wide as the sun's angular diameter times the distance to what casts the shadow. It is looked for in a
plane across the sunlight, where both are lengths: a pixel lies in the border if a change from light to shadow is
nearer than half that width. Borders narrower than a pixel are left to the sub-pixel rays of antialias.py, and so is the
outer half of a border whose middle lies beyond the image.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled, inlined, read_only
from marssim.render.geometry.projection import Projection
from marssim.scene.look import SUN_RADIUS

WIDEST = 96  # [px] half the width up to which a border is softened all over


def penumbra(
    rays: np.ndarray, pose: np.ndarray, depth: np.ndarray, distance: np.ndarray, sun: np.ndarray
) -> np.ndarray:
    """Return the pixels that may see a part of the sun's disc only, where that border is wider than a pixel.

    Args:
        rays: (H * W, 3) directions of the pixels, camera frame, z = 1.
        pose: (4, 4) camera to world.
        depth: (H, W) depth [m], inf in the sky.
        distance: (H, W) of `Renderer.shadow_distance` [m], 0 in the sky.
        sun: (3,) unit vector towards the sun, world frame.

    Returns:
        (H * W,) bool.
    """
    across = np.ascontiguousarray(Projection.of_sun(sun).axes[:2] @ pose[:3, :3])
    return _penumbra(read_only(rays), across, depth, distance, float(np.tan(SUN_RADIUS)))


@inlined
def _place(rays, across, depth, row, column):
    """Return where a pixel's point lies in the plane across the sunlight [m], less the place of the eye."""
    k = row * depth.shape[1] + column
    z = float(depth[row, column])
    return (
        z * (across[0, 0] * rays[k, 0] + across[0, 1] * rays[k, 1] + across[0, 2]),
        z * (across[1, 0] * rays[k, 0] + across[1, 1] * rays[k, 1] + across[1, 2]),
    )


@inlined
def _step(rays, across, depth, row, column, down, right):
    """Return how far the point moves in that plane from a pixel to one beside it, the nearer of the two: x, y, length.

    down, right: 1 and 0 for the pixels above and below, 0 and 1 for those on the left and right.
    """
    x, y = _place(rays, across, depth, row, column)
    best = (0.0, 0.0, np.inf)
    for sign in (-1, 1):
        j, i = row + sign * down, column + sign * right
        if 0 <= j < depth.shape[0] and 0 <= i < depth.shape[1] and depth[j, i] < np.inf:
            u, v = _place(rays, across, depth, j, i)
            u, v = sign * (u - x), sign * (v - y)
            length = math.sqrt(u * u + v * v)
            if length < best[2]:
                best = (u, v, length)
    return best


@compiled
def _penumbra(rays, across, depth, distance, radius):
    height, width = depth.shape
    out = np.zeros(height * width, dtype=np.bool_)
    for row in range(height):
        for column in range(width):
            if not 0 < distance[row, column] < np.inf:
                continue
            beside = (column > 0 and distance[row, column - 1] == np.inf) or (
                column < width - 1 and distance[row, column + 1] == np.inf
            )
            above = (row > 0 and distance[row - 1, column] == np.inf) or (
                row < height - 1 and distance[row + 1, column] == np.inf
            )
            if not (beside or above):
                continue
            half = radius * distance[row, column]
            ux, uy, u = _step(rays, across, depth, row, column, 0, 1)
            vx, vy, v = _step(rays, across, depth, row, column, 1, 0)
            area = abs(ux * vy - uy * vx)
            if not 0 < area < np.inf:
                continue
            wide, tall = half * v / area, half * u / area  # [px] how far a circle of that radius reaches in the image
            if not ((beside and 2 * wide > 1) or (above and 2 * tall > 1)):
                continue
            _mark(out, rays, across, depth, row, column, half + max(u, v), min(wide, WIDEST), min(tall, WIDEST))
    return out


@inlined
def _mark(out, rays, across, depth, row, column, near, wide, tall):
    """Mark the pixels whose points are nearer than `near` [m] in the plane, within wide and tall [px] of a pixel."""
    x, y = _place(rays, across, depth, row, column)
    wide, tall = math.ceil(wide) + 1, math.ceil(tall) + 1
    for j in range(max(row - tall, 0), min(row + tall + 1, depth.shape[0])):
        for i in range(max(column - wide, 0), min(column + wide + 1, depth.shape[1])):
            k = j * depth.shape[1] + i
            if out[k] or not depth[j, i] < np.inf:
                continue
            u, v = _place(rays, across, depth, j, i)
            out[k] = (u - x) * (u - x) + (v - y) * (v - y) < near * near
