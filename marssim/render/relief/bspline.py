"""B-splines on regular grids: smooth surfaces with exact slopes.

A cubic B-spline carries the ground's grid, so that its normals have no facets. Quadratic B-splines carry the periodic
tiles of finer relief.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from marssim.base.compute.compiled import inlined


def cubic_coefficients(heights: np.ndarray) -> np.ndarray:
    """Return the coefficients of the cubic B-spline through heights (ny, nx) [m], float32 with a margin of one.

    The surface is symmetric about its border, so its slope across the border is 0 there.
    """
    return np.pad(ndimage.spline_filter(heights, order=3, mode="mirror"), 1, mode="reflect").astype(np.float32)


def quadratic_coefficients(spectrum: np.ndarray, side: int) -> np.ndarray:
    """Return the coefficients of the periodic quadratic B-spline through a field, given its rfft2.

    Args:
        spectrum: (side, side // 2 + 1) rfft2 of the field on a grid of side * side nodes.
        side: Nodes along a side.

    Returns:
        (side, side) float64.
    """
    down = 0.75 + 0.25 * np.cos(2 * np.pi * np.fft.fftfreq(side))
    across = 0.75 + 0.25 * np.cos(2 * np.pi * np.fft.rfftfreq(side))
    return np.fft.irfft2(spectrum / (down[:, None] * across[None, :]), s=(side, side))


@inlined
def _cubic(t, u):
    """Return the four weights of a cubic B-spline at t in [0, 1]; u: 1 - t."""
    one, half, sixth, most = np.float32(1), np.float32(0.5), np.float32(1 / 6), np.float32(2 / 3)
    tt, uu = t * t, u * u
    return uu * u * sixth, most - tt * (one - half * t), most - uu * (one - half * u), tt * t * sixth


@inlined
def _cubic_slopes(t, u):
    """Return the derivatives of these weights."""
    half, more, two = np.float32(0.5), np.float32(1.5), np.float32(2)
    return -half * u * u, t * (more * t - two), u * (two - more * u), half * t * t


@inlined
def cubic_at(coefficients, start, nodes, x, y):
    """Return value and slopes of `cubic_coefficients`, float32, at a point in cells from the first node.

    coefficients: flat; start: int32, where those of this grid begin; nodes: int32, its nodes along a side, with margin.
    """
    zero, one = np.float32(0), np.float32(1)
    last = np.float32(nodes) - np.float32(3.001)
    x = min(max(x, zero), last)
    y = min(max(y, zero), last)
    left, low = np.floor(x), np.floor(y)
    s, t = x - left, y - low
    k = np.uint32(start + np.int32(low) * nodes + np.int32(left))
    step = np.uint32(nodes)
    u, v = one - s, one - t
    a0, a1, a2, a3 = _cubic(s, u)
    b0, b1, b2, b3 = _cubic(t, v)
    c0, c1, c2, c3 = _cubic_slopes(s, u)
    d0, d1, d2, d3 = _cubic_slopes(t, v)
    n1, n2, n3 = np.uint32(1), np.uint32(2), np.uint32(3)
    p, q, r, w = coefficients[k], coefficients[k + n1], coefficients[k + n2], coefficients[k + n3]
    line = a0 * p + a1 * q + a2 * r + a3 * w
    value, across, along = b0 * line, d0 * line, b0 * (c0 * p + c1 * q + c2 * r + c3 * w)
    k += step
    p, q, r, w = coefficients[k], coefficients[k + n1], coefficients[k + n2], coefficients[k + n3]
    line = a0 * p + a1 * q + a2 * r + a3 * w
    value, across, along = value + b1 * line, across + d1 * line, along + b1 * (c0 * p + c1 * q + c2 * r + c3 * w)
    k += step
    p, q, r, w = coefficients[k], coefficients[k + n1], coefficients[k + n2], coefficients[k + n3]
    line = a0 * p + a1 * q + a2 * r + a3 * w
    value, across, along = value + b2 * line, across + d2 * line, along + b2 * (c0 * p + c1 * q + c2 * r + c3 * w)
    k += step
    p, q, r, w = coefficients[k], coefficients[k + n1], coefficients[k + n2], coefficients[k + n3]
    line = a0 * p + a1 * q + a2 * r + a3 * w
    value, across, along = value + b3 * line, across + d3 * line, along + b3 * (c0 * p + c1 * q + c2 * r + c3 * w)
    return value, along, across


@inlined
def cubic_curve_at(coefficients, start, nodes, x, y):
    """Return value, slopes and second derivatives (xx, xy, yy) as `cubic_at` takes and returns them."""
    zero, one, two, three = np.float32(0), np.float32(1), np.float32(2), np.float32(3)
    last = np.float32(nodes) - np.float32(3.001)
    x, y = min(max(x, zero), last), min(max(y, zero), last)
    left, low = np.floor(x), np.floor(y)
    s, t = x - left, y - low
    k = np.uint32(start + np.int32(low) * nodes + np.int32(left))
    u, v = one - s, one - t
    a, b, c, d = _cubic(s, u), _cubic(t, v), _cubic_slopes(s, u), _cubic_slopes(t, v)
    e, f = (u, three * s - two, one - three * s, s), (v, three * t - two, one - three * t, t)
    value, along, across, bend, twist, arch = zero, zero, zero, zero, zero, zero
    for row in range(4):
        at = k + np.uint32(row) * np.uint32(nodes)
        p, q = coefficients[at], coefficients[at + np.uint32(1)]
        r, w = coefficients[at + np.uint32(2)], coefficients[at + np.uint32(3)]
        line = a[0] * p + a[1] * q + a[2] * r + a[3] * w
        rise = c[0] * p + c[1] * q + c[2] * r + c[3] * w
        curve = e[0] * p + e[1] * q + e[2] * r + e[3] * w
        value, along, bend = value + b[row] * line, along + b[row] * rise, bend + b[row] * curve
        across, twist, arch = across + d[row] * line, twist + d[row] * rise, arch + f[row] * line
    return value, along, across, bend, twist, arch


@inlined
def quadratic_at(coefficients, start, side, x, y):
    """Return value and slopes of a periodic quadratic B-spline, float32, at x, y [nodes].

    coefficients: flat; start: int32, where those of this grid begin; side: int32, its nodes along a side, a power of
    two.
    """
    half, most = np.float32(0.5), np.float32(0.75)
    one, mask = np.int32(1), np.int32(side - 1)
    left, low = np.floor(x + half), np.floor(y + half)
    s, t = x - left, y - low
    i1, j1 = np.int32(left) & mask, np.int32(low) & mask
    i0, i2 = (i1 - one) & mask, (i1 + one) & mask
    r0, r2 = start + ((j1 - one) & mask) * side, start + ((j1 + one) & mask) * side
    r1 = start + j1 * side
    p0, p2, q0, q2 = half - s, half + s, half - t, half + t
    a0, a1, a2 = half * p0 * p0, most - s * s, half * p2 * p2
    b0, b1, b2 = half * q0 * q0, most - t * t, half * q2 * q2
    u00, u01, u02 = coefficients[np.uint32(r0 + i0)], coefficients[np.uint32(r0 + i1)], coefficients[np.uint32(r0 + i2)]
    u10, u11, u12 = coefficients[np.uint32(r1 + i0)], coefficients[np.uint32(r1 + i1)], coefficients[np.uint32(r1 + i2)]
    u20, u21, u22 = coefficients[np.uint32(r2 + i0)], coefficients[np.uint32(r2 + i1)], coefficients[np.uint32(r2 + i2)]
    l0, l1, l2 = a0 * u00 + a1 * u01 + a2 * u02, a0 * u10 + a1 * u11 + a2 * u12, a0 * u20 + a1 * u21 + a2 * u22
    ss, tt = s + s, t + t
    s0, s1, s2 = p2 * u02 - p0 * u00 - ss * u01, p2 * u12 - p0 * u10 - ss * u11, p2 * u22 - p0 * u20 - ss * u21
    return b0 * l0 + b1 * l1 + b2 * l2, b0 * s0 + b1 * s1 + b2 * s2, q2 * l2 - q0 * l0 - tt * l1
