"""Vector functions compared with numpy's."""

import numpy as np
from numba import njit

from marssim.render.geometry.vectors import column, cross, dot, minus, mixed, row, times


@njit
def all_functions(a, b, c, matrix):
    p, q, r = row(a, 0), row(b, 0), row(c, 0)
    return minus(p, q), times(p, -2.5), dot(p, q), cross(p, q), mixed(p, q, r, (0.5, -2.0, 3.0)), column(matrix, 3)


def test_vector_functions_agree_with_numpy():
    rng = np.random.default_rng(1)
    a, b, c, matrix = (rng.standard_normal(shape) for shape in ((2, 3), (2, 3), (2, 3), (4, 4)))
    a[1] = b[1] = c[1] = np.nan  # the other row is not looked at
    results = all_functions(a, b, c, matrix)
    p, q, r = a[0], b[0], c[0]
    expected = p - q, -2.5 * p, p @ q, np.cross(p, q), 0.5 * p - 2 * q + 3 * r, matrix[:3, 3]
    for got, due in zip(results, expected):
        np.testing.assert_allclose(got, due, rtol=1e-14)
