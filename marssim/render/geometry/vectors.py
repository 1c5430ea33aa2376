"""Vectors in kernels, as tuples x, y, z: the compiler keeps tuples in registers, but not arrays."""

from __future__ import annotations

import math

from marssim.base.compute.compiled import inlined


@inlined
def row(array, n):
    """Return row n of an array (N, 3)."""
    return array[n, 0], array[n, 1], array[n, 2]


@inlined
def column(matrix, n):
    """Return the first three numbers of column n of a matrix."""
    return matrix[0, n], matrix[1, n], matrix[2, n]


@inlined
def minus(a, b):
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(a, factor):
    """Return a times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@inlined
def dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """Return the right-handed vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def mixed(a, b, c, weights):
    """Return the weighted sum of three vectors."""
    wa, wb, wc = weights
    return (
        wa * a[0] + wb * b[0] + wc * c[0],
        wa * a[1] + wb * b[1] + wc * c[1],
        wa * a[2] + wb * b[2] + wc * c[2],
    )


@inlined
def unit(a):
    """Return a vector of length 1 along a."""
    return times(a, 1 / math.sqrt(max(dot(a, a), 1e-24)))
