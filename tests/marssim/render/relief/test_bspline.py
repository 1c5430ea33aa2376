import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.compute.compiled import compiled
from marssim.render.relief.bspline import (
    cubic_at,
    cubic_coefficients,
    cubic_curve_at,
    quadratic_at,
    quadratic_coefficients,
)

NODES, SIDE = 24, 32
places = st.tuples(st.floats(0.0, NODES - 1.01), st.floats(0.0, NODES - 1.01))


@compiled
def cubics(coefficients, nodes, x, y):
    out = np.empty((len(x), 3))
    for k in range(len(x)):
        out[k] = cubic_at(coefficients, np.int32(0), np.int32(nodes), np.float32(x[k]), np.float32(y[k]))
    return out


@compiled
def curves(coefficients, nodes, x, y):
    out = np.empty((len(x), 6))
    for k in range(len(x)):
        out[k] = cubic_curve_at(coefficients, np.int32(0), np.int32(nodes), np.float32(x[k]), np.float32(y[k]))
    return out


@compiled
def quadratics(coefficients, side, x, y):
    out = np.empty((len(x), 3))
    for k in range(len(x)):
        out[k] = quadratic_at(coefficients, np.int32(0), np.int32(side), np.float32(x[k]), np.float32(y[k]))
    return out


def cubic(heights: np.ndarray, x, y) -> np.ndarray:
    """(N, 3) value and slopes of the cubic spline through heights."""
    return cubics(cubic_coefficients(heights).ravel(), len(heights) + 2, np.atleast_1d(x), np.atleast_1d(y))


def quadratic(field: np.ndarray, x, y) -> np.ndarray:
    """(N, 3) value and slopes of the periodic quadratic spline through a field."""
    coefficients = quadratic_coefficients(np.fft.rfft2(field), len(field)).astype(np.float32).ravel()
    return quadratics(coefficients, len(field), np.atleast_1d(x), np.atleast_1d(y))


def drawn(side: int) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((side, side))


def test_splines_pass_through_the_nodes():
    row, column = np.indices((NODES, NODES)).reshape(2, -1)
    assert np.allclose(cubic(drawn(NODES), column * 1.0, row * 1.0)[:, 0], drawn(NODES).ravel(), atol=2e-3)
    row, column = np.indices((SIDE, SIDE)).reshape(2, -1)
    assert np.allclose(quadratic(drawn(SIDE), column * 1.0, row * 1.0)[:, 0], drawn(SIDE).ravel(), atol=1e-4)


@given(*[st.floats(-1, 1) for _ in range(6)])
def test_a_cubic_spline_is_a_parabola_through_one_and_has_its_slopes_and_curvature(a, b, c, d, e, f):
    """Not about the border, where it is symmetric."""
    axis = (np.arange(64) - 31.5) / 16
    at_x, at_y = np.random.default_rng(0).uniform(24, 39, (2, 50))
    x, y = (at_x - 31.5) / 16, (at_y - 31.5) / 16
    u, v = axis[None, :], axis[:, None]
    heights = a + b * u + c * v + d * u * u + e * u * v + f * v * v
    expected = np.stack([
        a + b * x + c * y + d * x * x + e * x * y + f * y * y, (b + 2 * d * x + e * y) / 16,
        (c + 2 * f * y + e * x) / 16, 0 * x + d / 128, 0 * x + e / 256, 0 * x + f / 128,
    ], axis=1)  # fmt: skip
    assert np.allclose(cubic(heights, at_x, at_y), expected[:, :3], atol=2e-5)
    got = curves(cubic_coefficients(heights).ravel(), 66, at_x, at_y)
    assert np.allclose(got, expected, atol=2e-5)


@pytest.mark.parametrize(("spline", "order"), [(cubic, 4), (quadratic, 3)])
def test_the_error_of_a_sine_falls_with_the_order_of_the_spline(spline, order):
    side = 64
    errors = []
    for waves in (8, 4):  # of 8 and of 16 nodes
        k = 2 * np.pi * waves / side
        field = np.cos(k * np.arange(side))[None, :] * np.ones((side, 1))
        x = np.random.default_rng(1).uniform(20, 44, 2000)
        value, along, across = spline(field, x, 0.3 * x + 10).T
        errors.append([np.abs(value - np.cos(k * x)).max(), np.abs(along / k + np.sin(k * x)).max()])
        assert np.abs(across).max() < 1e-4
    fall = np.log2(np.array(errors[0]) / errors[1])
    assert errors[1][0] < 2e-3 and errors[1][1] < 0.02
    assert fall[0] > order - 0.5 and fall[1] > order - 1.5  # the slope is one order less exact


@given(places)
def test_slopes_are_the_derivatives_of_the_value(place):
    step = 0.02
    for spline, field in ((cubic, drawn(NODES)), (quadratic, drawn(SIDE))):
        x, y = (np.clip(at, 2 * step, NODES - 1.2) for at in place)
        at = [spline(field, x + i * step, y + j * step)[0] for i, j in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
        # a quadratic spline's slope has kinks, where a difference is off by half a step times the change of curvature
        assert (at[1][0] - at[2][0]) / (2 * step) == pytest.approx(at[0][1], abs=0.12)
        assert (at[3][0] - at[4][0]) / (2 * step) == pytest.approx(at[0][2], abs=0.12)


@given(places, st.integers(-3, 3), st.integers(-3, 3))
def test_quadratic_splines_are_periodic(place, i, j):
    field = drawn(SIDE)
    here, there = quadratic(field, *place)[0], quadratic(field, place[0] + i * SIDE, place[1] + j * SIDE)[0]
    assert there == pytest.approx(here, abs=1e-3)


def test_a_cubic_spline_beyond_its_grid_is_that_of_the_edge():
    heights = drawn(NODES)
    inside = cubic(heights, [0.0, NODES - 1.0, 5.5], [3.3, 3.3, 0.0])
    outside = cubic(heights, [-7.0, NODES + 7.0, 5.5], [3.3, 3.3, -2.0])
    assert np.allclose(outside[:, 0], inside[:, 0], atol=1e-2)
