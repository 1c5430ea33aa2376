"""How much of the sun's disc triangles leave free over points, which makes the soft borders of shadows.

Seen from a point, the disc is a set of rays through samples that lie evenly on it. All points see the same samples, so
a shadow has no noise. A triangle hides the samples whose rays it meets: its three edge functions are linear in the
ray's place on the disc, so a few comparisons decide about most triangles.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.mesh import SceneMesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.scan import Bins, bins_of, block_reach, farthest
from marssim.render.geometry.triangles import box_extent, corners, extent, facing

SAMPLES = 64  # on the disc: a share is a multiple of 1 / 64, which is too fine for bands to show


def disc_samples(radius: float) -> np.ndarray:
    """Return (SAMPLES, 2) tangents of angles from the centre of a disc of a radius [rad], even (Vogel 1979)."""
    number = np.arange(SAMPLES)
    turn, out = number * np.pi * (3 - np.sqrt(5)), np.tan(radius) * np.sqrt((number + 0.5) / SAMPLES)
    return np.ascontiguousarray(out[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def disc_share(
    mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, s: np.ndarray, radius: float
) -> np.ndarray:
    """Return the share of the sun's disc that no triangle hides from points.

    Args:
        mesh: The triangles that cast shadows.
        view: Projection of the sun's centre.
        x: (N,) image coordinates of the points.
        y: (N,) image coordinates.
        s: (N,) S of the points, see projection.py.
        radius: Angle from the sun's centre to its edge [rad].

    Returns:
        (N,) float32, 0 to 1.
    """
    bins = Bins(x, y)
    return _share(
        mesh.vertices, mesh.faces, mesh.surface, mesh.start, mesh.low, mesh.high, view.numbers, view.away, bins.grid,
        bins.order, bins.start, bins.x, bins.y, s, disc_samples(radius), float(np.tan(radius)),
    )  # fmt: skip


@compiled
def _share(
    vertices, faces, surface, start, low, high, view, away, grid, order, bins, x, y, s, samples, radius
):  # fmt: skip
    number = grid[7]
    s = s[order]
    hidden = np.zeros((len(x), len(samples)), dtype=np.bool_)
    left_over = np.full(len(x), len(samples), dtype=np.int32)
    reach, deepest = block_reach(bins, s, number), s.max()
    for piece in range(len(start) - 1):
        left, right, top, bottom, first = box_extent(low[piece], high[piece], view)
        grow = radius * (deepest - first)
        last = farthest(left - grow, right + grow, top - grow, bottom + grow, grid, reach)
        if not last > first:
            continue
        grow = radius * (last - first)
        for face in range(start[piece], start[piece + 1]):
            a, b, c = corners(vertices, faces, face, view)
            if surface[face] == GROUND and away * facing(a, b, c) <= 0:
                continue
            left, right, top, bottom = extent(a, b, c)
            i0, i1, j0, j1 = bins_of(left - grow, right + grow, top - grow, bottom + grow, grid)
            first = min(a[3], min(b[3], c[3]))
            for j in range(j0, j1 + 1):
                if i0 > i1:
                    break
                for k in range(bins[j * number + i0], bins[j * number + i1 + 1]):
                    wide = radius * (s[k] - first)
                    if left_over[k] == 0 or wide <= 0 or x[k] < left - wide or x[k] > right + wide:
                        continue
                    if y[k] >= top - wide and y[k] <= bottom + wide:
                        left_over[k] -= _hide(
                            hidden[k], samples, radius, (a[0] - x[k], a[1] - y[k], s[k] - a[3]),
                            (b[0] - x[k], b[1] - y[k], s[k] - b[3]), (c[0] - x[k], c[1] - y[k], s[k] - c[3]),
                        )  # fmt: skip
    out = np.empty(len(x), dtype=np.float32)
    for k in range(len(x)):
        out[order[k]] = left_over[k] / len(samples)
    return out


@inlined
def _line(a, b):
    """Return the edge function of a side a b, as factors of 1 and of the sample's two coordinates, and its steepness.

    a, b: corners relative to the point: across, across, and distance towards the sun.
    """
    u, v = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]
    return a[0] * b[1] - a[1] * b[0], u, v, math.sqrt(u * u + v * v)


@inlined
def _hide(hidden, samples, radius, a, b, c):
    """Mark the samples that a triangle hides, and return how many of them were not yet hidden."""
    ea, eb, ec = _line(b, c), _line(c, a), _line(a, b)
    da, db, dc = radius * ea[3], radius * eb[3], radius * ec[3]
    positive = ea[0] > da or eb[0] > db or ec[0] > dc  # one of them is positive all over the disc
    negative = ea[0] < -da or eb[0] < -db or ec[0] < -dc
    if positive and negative:
        return 0
    count = 0
    for n in range(len(samples)):
        if hidden[n]:
            continue
        u, v = samples[n, 0], samples[n, 1]
        wa, wb, wc = ea[0] + u * ea[1] + v * ea[2], eb[0] + u * eb[1] + v * eb[2], ec[0] + u * ec[1] + v * ec[2]
        if wa * wb < 0 or wa * wc < 0 or wb * wc < 0 or wa + wb + wc == 0:
            continue
        if (wa * a[2] + wb * b[2] + wc * c[2]) / (wa + wb + wc) > 0:  # it lies towards the sun
            hidden[n] = True
            count += 1
    return count
