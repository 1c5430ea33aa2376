import numpy as np
import pytest
from scipy import ndimage

from marssim.inspection.tilted_planes import plane
from marssim.render.relief.bspline import cubic_coefficients
from marssim.render.relief.terrain_spline import FineSpline, halved
from marssim.scene.ground.drifts import EDGE


def values(coefficients: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the spline's values at x, y in cells from the first node without the margin."""
    return ndimage.map_coordinates(coefficients.astype(float), [y + 1, x + 1], order=3, prefilter=False)


@pytest.fixture
def rough() -> np.ndarray:
    return cubic_coefficients(np.random.default_rng(0).normal(size=(21, 21)))


def test_the_surface_is_the_same_on_a_finer_grid(rough):
    finer = halved(halved(rough).T).T
    assert finer.shape == (2 * 21 - 1 + 2,) * 2
    x, y = np.random.default_rng(1).uniform(1, 19, (2, 500))
    assert np.allclose(values(finer, 2 * x, 2 * y), values(rough, x, y), atol=1e-5)


def test_a_terrain_is_refined_until_its_nodes_are_near_enough():
    spline = FineSpline.from_terrain(plane(np.array([0.2, -0.1])).terrain)
    finer = spline.refined(spline.cell / 3)
    assert finer.cell == pytest.approx(spline.cell / 4) and finer.nodes == 4 * (spline.nodes - 1) + 1
    assert spline.refined(spline.cell) is spline
    last = finer.start + (finer.nodes - 1) * finer.cell
    assert (finer.start, last) == pytest.approx((spline.start, -spline.start))
    i, j = np.meshgrid(*[np.arange(4 * EDGE, finer.nodes - 4 * EDGE, 7)] * 2)
    x, y = finer.start + i * finer.cell, finer.start + j * finer.cell
    assert np.allclose(values(finer.coefficients, i, j), 0.2 * x - 0.1 * y, atol=1e-4)


def test_what_lies_on_the_surface_is_nowhere_higher_than_the_nodes_around_it(rough):
    flat = FineSpline(np.zeros_like(rough), 0.0, 1.0)
    heights = np.maximum(np.random.default_rng(2).normal(size=(21, 21)), 0).astype(np.float32)
    raised = flat.raised(heights).coefficients
    x, y = np.random.default_rng(3).uniform(2, 18, (2, 2000))
    highest = ndimage.maximum_filter(heights, size=5)[np.rint(y).astype(int), np.rint(x).astype(int)]
    over = values(raised, x, y)
    assert (over <= highest + 1e-6).all() and (over >= -1e-6).all() and over.max() > 0.8
    assert raised[1:-1, 1:-1].sum() == pytest.approx(heights.sum(), rel=1e-5)
