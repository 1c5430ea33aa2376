"""The height of the ground between the stones, as a function of world position and of what a pixel covers there.

It is the sum of the terrain's grids, interpolated smoothly, of fine self-affine relief, and of the wind's ripples on
sand; plates of bedrock stand out of it where the wind has swept the sand away.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.relief.bspline import cubic_at, cubic_curve_at, quadratic_at
from marssim.render.relief.tiles import NONE, WHOLE, Tile, level_at, nearest_level, tile_at

SAND_RELIEF = 0.85  # share of the fine relief that sand buries
SOFT = 0.002  # [m] height over which sand thins out on a plate of bedrock
GRAIN_LIMIT = np.float32(0.013)  # [m] width of a pixel from which on it shows none of the grain
SWEPT_DEPTH = 0.02  # [m] height of sand that the wind takes where the ground is swept by 1
MOST_SWEPT = 1.3  # how swept the ground is where the wind takes no more
EXPOSED = 0.12  # how swept the ground is from which on plates stand out fully; they begin to at 0
SAND, GRAVEL, SWEPT = np.int32(0), np.int32(1), np.int32(2)  # the shares of Cover


class Base(NamedTuple):
    """The terrain's grids: coefficients of `cubic_coefficients`, and where and how wide their cells are.

    Attributes:
        fine: Where the coefficients [m] of the fine grid begin in the relief's data.
        fine_nodes: Its nodes along a side, with the margin.
        fine_start: x and y of its first node [m].
        per_fine_cell: Its nodes per metre.
        half: Half the side of the square in which it counts [m].
        coarse: Where those of the coarse grid begin.
        coarse_nodes: Its nodes along a side.
        coarse_start: x and y of its first node [m].
        per_coarse_cell: Its nodes per metre.
    """

    fine: np.int32
    fine_nodes: np.int32
    fine_start: np.float32
    per_fine_cell: np.float32
    half: np.float32
    coarse: np.int32
    coarse_nodes: np.int32
    coarse_start: np.float32
    per_coarse_cell: np.float32


class Cover(NamedTuple):
    """What covers the ground, on a grid around the middle of the scene; beyond it, as at its edge.

    Attributes:
        share: Where (N, N, 3) shares begin in the relief's data, rows northward: of rippled sand, of gravel (stones
            that lie close together), and how bare the wind has swept the ground (0 to about 1.5).
        nodes: N.
        start: x and y of the first node [m].
        per_cell: Nodes per metre.
    """

    share: np.int32
    nodes: np.int32
    start: np.float32
    per_cell: np.float32


class Relief(NamedTuple):
    """The relief between the stones, as kernels take it.

    Attributes:
        base: The terrain's grids.
        cover: What covers the ground.
        fractal: Self-affine relief with waves of 3 to 40 cm.
        grain: Self-affine relief with waves of 8 to 30 mm.
        ripples: One level of ripples, of unit height.
        plates: Plates of bedrock; see `plates_at`.
        strength: Factor of fractal and grain.
        ripple_height: Factor of the ripples [m].
        ripple_length: Wavelength of the ripples [m].
        bedrock: Whether the scene has plates.
    """

    base: Base
    cover: Cover
    fractal: Tile
    grain: Tile
    ripples: Tile
    plates: Tile
    strength: np.float32
    ripple_height: np.float32
    ripple_length: np.float32
    bedrock: bool


@inlined
def base_at(data, base, x, y):
    """Return height [m] and slopes of the terrain, float32, at x, y [m]."""
    fine, nodes, start, per_cell, half, coarse, far_nodes, far_start, per_far_cell = base
    if abs(x) < half and abs(y) < half:
        height, east, north = cubic_at(data, fine, nodes, (x - start) * per_cell, (y - start) * per_cell)
        return height, east * per_cell, north * per_cell
    u, v = (x - far_start) * per_far_cell, (y - far_start) * per_far_cell
    height, east, north = cubic_at(data, coarse, far_nodes, u, v)
    return height, east * per_far_cell, north * per_far_cell


@inlined
def share_at(data, cover, x, y, which):
    """Return a share of the cover and its slopes [1/m] at x, y [m], float32. which: SAND or GRAVEL."""
    share, nodes, start, per_cell = cover
    last, zero = np.float32(nodes) - np.float32(1.001), np.float32(0)
    east, north = (x - start) * per_cell, (y - start) * per_cell
    u, v = min(max(east, zero), last), min(max(north, zero), last)
    left, low = np.floor(u), np.floor(v)
    s, t = u - left, v - low
    at = np.uint32(share + which + np.int32(3) * (np.int32(low) * nodes + np.int32(left)))
    up, n3 = at + np.uint32(np.int32(3) * nodes), np.uint32(3)
    below, above = data[at + n3] - data[at], data[up + n3] - data[up]
    first, second = data[at] + s * below, data[up] + s * above
    along = (below + t * (above - below)) * per_cell if east == u else zero
    return first + t * (second - first), along, (second - first) * per_cell if north == v else zero


@inlined
def swept_at(data, cover, x, y):
    """Return how swept the ground is, and its slopes [1/m], at x, y [m], float32.

    It is a quadratic B-spline, since plates that stand out by it would show the kinks of a bilinear one.
    """
    share, nodes, start, per_cell = cover
    zero, half, one, most = np.float32(0), np.float32(0.5), np.float32(1), np.float32(0.75)
    east, north, last = (x - start) * per_cell, (y - start) * per_cell, np.float32(nodes - 2)
    u, v = min(max(east, one), last), min(max(north, one), last)
    left, low = np.floor(u + half), np.floor(v + half)
    s, t = u - left, v - low
    row = np.int32(3) * nodes
    at = share + SWEPT + np.int32(3) * (np.int32(left) - np.int32(1)) + row * (np.int32(low) - np.int32(1))
    p0, p2, q0, q2, ss = half - s, half + s, half - t, half + t, s + s
    weights = (half * q0 * q0, most - t * t, half * q2 * q2)
    slopes = (-q0, -t - t, q2)
    value, along, across = zero, zero, zero
    for k in range(3):
        a, b, c = data[np.uint32(at)], data[np.uint32(at + np.int32(3))], data[np.uint32(at + np.int32(6))]
        line = half * p0 * p0 * a + (most - s * s) * b + half * p2 * p2 * c
        value, across = value + weights[k] * line, across + slopes[k] * line
        along += weights[k] * (p2 * c - p0 * a - ss * b)
        at += row
    return value, along * per_cell if east == u else zero, across * per_cell if north == v else zero


@inlined
def cover_at(data, cover, x, y):
    """Return sand and its slopes [1/m], gravel, and how swept the ground is, at x, y [m]; all float32."""
    sand, east, north = share_at(data, cover, x, y, SAND)
    gravel, _, _ = share_at(data, cover, x, y, GRAVEL)
    swept, _, _ = swept_at(data, cover, x, y)
    return sand, east, north, gravel, swept


@inlined
def stone_cover_at(data, cover, x, y):
    """Return the shares of sand and of gravel at x, y [m], float32."""
    sand, _, _ = share_at(data, cover, x, y, SAND)
    gravel, _, _ = share_at(data, cover, x, y, GRAVEL)
    return sand, gravel


@inlined
def footprint_at(eye, focal, x, y, z):
    """Return the width of a pixel on level ground at a point [m], float32.

    It is the geometric mean of the axes of the ellipse that a pixel covers. eye: position of the left camera [m];
    focal: its focal length [px].
    """
    dx, dy, up = np.float32(eye[0] - x), np.float32(eye[1] - y), np.float32(eye[2] - z)
    square = dx * dx + dy * dy + up * up + np.float32(1e-12)
    distance = math.sqrt(square)
    # distance / sqrt(sine of the slant), which is up / distance
    return math.sqrt(square * distance / max(up, np.float32(0.08) * distance)) / np.float32(focal)


@inlined
def shown_at(length, footprint, none, whole):
    """Return the share, 0 to 1, that pixels show of what is `length` [m] wide.

    none, whole: the numbers of pixels across it up to which it does not show, and from which on it shows fully.
    """
    ramp = (length - none * footprint) / ((whole - none) * footprint)
    ramp = min(max(ramp, np.float32(0)), np.float32(1))
    return ramp * ramp * (np.float32(3) - np.float32(2) * ramp)


@inlined
def exposed_at(swept):
    """Return how far plates stand out where the ground is swept by more than 0, 0 to 1, and the derivative."""
    one, ramp = np.float32(1), min(swept * np.float32(1 / EXPOSED), np.float32(1))
    return ramp * ramp * (np.float32(3) - ramp - ramp), np.float32(6 / EXPOSED) * ramp * (one - ramp)


@inlined
def height_at(data, relief, x, y, footprint, grained):
    """Return height [m], slopes, the terrain's own slopes, the fine relief's height [m], and the share of bedrock.

    x, y: world position [m]; footprint: width of a pixel there [m]; all float32. grained: include the grain.
    """
    base, cover, fractal, grain, ripples, plates, strength, ripple_height, ripple_length, bedrock = relief
    zero, one, half = np.float32(0), np.float32(1), np.float32(0.5)
    height, east, north = base_at(data, base, x, y)
    sand, sand_east, sand_north = share_at(data, cover, x, y, SAND)
    fine, along, across = tile_at(data, fractal, x, y, footprint)
    if grained and footprint < GRAIN_LIMIT:
        value, du, dv = tile_at(data, grain, x, y, footprint)
        fine, along, across = fine + value, along + du, across + dv
    rough = strength * (one - np.float32(SAND_RELIEF) * sand)
    less = strength * np.float32(SAND_RELIEF) * fine
    lie, lie_east, lie_north = rough * fine, rough * along - less * sand_east, rough * across - less * sand_north
    if sand > zero and ripple_length > np.float32(NONE) * footprint:
        weight = ripple_height * shown_at(ripple_length, footprint, np.float32(NONE), np.float32(WHOLE))
        start, side, _, spacing, cosine, sine, offset = ripples
        scale = one / spacing
        u, v = (cosine * x - sine * y) * scale + offset, (sine * x + cosine * y) * scale + offset
        value, du, dv = quadratic_at(data, start, side, u, v)
        steep = weight * sand * scale
        lie += weight * sand * value
        lie_east += steep * (cosine * du + sine * dv) + weight * value * sand_east
        lie_north += steep * (cosine * dv - sine * du) + weight * value * sand_north
    bare, swept, swept_east, swept_north = zero, zero, zero, zero
    if bedrock:
        swept, swept_east, swept_north = swept_at(data, cover, x, y)
    if swept > zero:
        value, du, dv = tile_at(data, plates, x, y, footprint)
        depth = np.float32(SWEPT_DEPTH) if swept < np.float32(MOST_SWEPT) else zero
        value += np.float32(SWEPT_DEPTH) * min(swept, np.float32(MOST_SWEPT))
        over = (value - lie) * np.float32(1 / SOFT)
        if over > -one:
            # a smooth maximum of sand and plate
            rise = np.float32(0.25 * SOFT) * (over + one) * (over + one) if over < one else value - lie
            exposed, steep = exposed_at(swept)
            bare = min(half + half * over, one) * exposed
            steep = steep * rise + bare * depth
            lie += exposed * rise
            lie_east += bare * (du - lie_east) + steep * swept_east
            lie_north += bare * (dv - lie_north) + steep * swept_north
    return height + lie, east + lie_east, north + lie_north, east, north, strength * fine, bare


@inlined
def around(data, relief, x, y, footprint):
    """Return a model of the relief within a few decimetres of x, y [m], for `near_height`.

    The terrain is a parabola, and each tile one level: it is close to `height_at`, but much faster to evaluate.
    """
    base, cover, fractal, _, ripples, plates, strength, ripple_height, ripple_length, bedrock = relief
    fine, nodes, start, per_cell, half, coarse, far_nodes, far_start, per_far_cell = base
    if abs(x) < half and abs(y) < half:
        curve = cubic_curve_at(data, fine, nodes, (x - start) * per_cell, (y - start) * per_cell)
    else:
        curve = cubic_curve_at(data, coarse, far_nodes, (x - far_start) * per_far_cell, (y - far_start) * per_far_cell)
        per_cell = per_far_cell
    value, east, north, bend, twist, arch = curve
    square = np.float32(0.5) * per_cell * per_cell
    terrain = (value, east * per_cell, north * per_cell, bend * square, twist * square, arch * square)
    sand, sand_east, sand_north, _, swept = cover_at(data, cover, x, y)
    weight = np.float32(0)
    if sand > 0:
        weight = ripple_height * shown_at(ripple_length, footprint, np.float32(NONE), np.float32(WHOLE))
    bare = swept if bedrock else np.float32(0)
    return (
        terrain, (sand, sand_east, sand_north, bare, strength, weight),
        nearest_level(fractal, x, y, footprint), (fractal.cosine, fractal.sine),
        nearest_level(ripples, x, y, np.float32(0)), (ripples.cosine, ripples.sine),
        nearest_level(plates, x, y, footprint), (plates.cosine, plates.sine),
    )  # fmt: skip


@inlined
def near_height(data, model, dx, dy):
    """Return height [m], slopes and the terrain's own slopes at dx, dy [m] beside the middle of a model of `around`."""
    terrain, cover, fractal, fractal_turn, ripples, ripples_turn, plates, plates_turn = model
    value, east, north, bend, twist, arch = terrain
    sand, sand_east, sand_north, swept, strength, weight = cover
    zero, one, two = np.float32(0), np.float32(1), np.float32(2)
    height = value + dx * (east + bend * dx + two * twist * dy) + dy * (north + arch * dy)
    east, north = east + two * (bend * dx + twist * dy), north + two * (arch * dy + twist * dx)
    share = min(max(sand + sand_east * dx + sand_north * dy, zero), one)
    lie, lie_east, lie_north = zero, zero, zero
    if fractal[4] > zero:
        lie, lie_east, lie_north = level_at(data, fractal, fractal_turn[0], fractal_turn[1], dx, dy)
        rough = strength * (one - np.float32(SAND_RELIEF) * share)
        lie, lie_east, lie_north = rough * lie, rough * lie_east, rough * lie_north
    if weight > zero:
        crest, du, dv = level_at(data, ripples, ripples_turn[0], ripples_turn[1], dx, dy)
        steep = weight * share
        lie, lie_east, lie_north = lie + steep * crest, lie_east + steep * du, lie_north + steep * dv
    if swept > zero:
        crest, du, dv = zero, zero, zero
        if plates[4] > zero:
            crest, du, dv = level_at(data, plates, plates_turn[0], plates_turn[1], dx, dy)
        crest += np.float32(SWEPT_DEPTH) * min(swept, np.float32(MOST_SWEPT))
        if crest > lie:
            exposed, _ = exposed_at(swept)
            lie += exposed * (crest - lie)
            lie_east += exposed * (du - lie_east)
            lie_north += exposed * (dv - lie_north)
    return height + lie, east + lie_east, north + lie_north, east, north
