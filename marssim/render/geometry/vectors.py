"""Vectors in space within kernels: tuples x, y, z, which the compiler keeps in registers, as it does not arrays."""

from __future__ import annotations

from marssim.base.compute.compiled import inlined


@inlined
def row(array, n):
    """Row n of an array (N, 3)."""
    return array[n, 0], array[n, 1], array[n, 2]


@inlined
def column(matrix, n):
    """The first three numbers of column n of a matrix."""
    return matrix[0, n], matrix[1, n], matrix[2, n]


@inlined
def minus(a, b):
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(a, factor):
    """a, of another length."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@inlined
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """Vector product, right-handed."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def mixed(a, b, c, weights):
    """Sum of three vectors, each times its weight."""
    wa, wb, wc = weights
    return (
        wa * a[0] + wb * b[0] + wc * c[0],
        wa * a[1] + wb * b[1] + wc * c[1],
        wa * a[2] + wb * b[2] + wc * c[2],
    )
