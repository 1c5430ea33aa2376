import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from marssim.scene.outcrop.polygons import area_and_centroid, clip, inset, outline, perimeter

SQUARE = np.array([[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]])
FOUR = np.array([4])


def drawn(seed: int, polygons: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Return convex polygons of 3 to 8 corners, with arbitrary values after the corners of each."""
    rng = np.random.default_rng(seed)
    count = rng.integers(3, 9, polygons)
    corners = rng.normal(0, 9, (polygons, 8, 2))
    for row, n in zip(corners, count):
        angle = np.sort(rng.uniform(0, 2 * np.pi, n)) * 0.1 + np.arange(n) / n * 2 * np.pi * 0.9
        row[:n] = np.stack([np.cos(angle), 0.6 * np.sin(angle)], axis=1) + rng.normal(size=2)
    return corners, count


def test_area_centroid_and_perimeter_of_a_square():
    area, middle = area_and_centroid(SQUARE, FOUR)
    assert area[0] == pytest.approx(4) and middle[0] == pytest.approx([1, 1]) and perimeter(SQUARE, FOUR)[0] == 8


@given(st.integers(0, 10_000))
def test_the_area_is_that_of_the_convex_hull(seed):
    corners, count = drawn(seed, 5)
    hulls = [ConvexHull(row[:n]).volume for row, n in zip(corners, count)]
    assert area_and_centroid(corners, count)[0] == pytest.approx(hulls)


@given(st.integers(0, 10_000), st.floats(0, 2 * np.pi), st.floats(-0.8, 0.8))
def test_the_two_sides_of_a_cut_are_the_whole(seed, angle, offset):
    corners, count = drawn(seed)
    area, middle = area_and_centroid(corners, count)
    normal = np.tile([np.cos(angle), np.sin(angle)], (len(count), 1))
    at = np.einsum("ni,ni->n", normal, middle) + offset
    parts = [area_and_centroid(*clip(corners, count, side * normal, side * at)) for side in (1, -1)]
    assert parts[0][0] + parts[1][0] == pytest.approx(area)
    moment = sum(part * centre.T for part, centre in parts)
    assert moment == pytest.approx(area * middle.T, abs=1e-9)


@given(st.integers(0, 10_000), st.floats(0.0, 0.3))
def test_an_inset_keeps_its_distance_from_every_side(seed, gap):
    corners, count = drawn(seed)
    inner, number = inset(corners, count, np.full(corners.shape[:2], gap))
    for row, n, inside, m in zip(corners, count, inner, number):
        hull = ConvexHull(row[:n])
        reach = hull.equations[:, :2] @ inside[:m].T + hull.equations[:, 2:]
        assert m == 0 or reach.max() <= -gap + 1e-9


@given(st.integers(0, 10_000), st.integers(8, 24))
def test_an_outline_has_the_shape_of_its_polygon(seed, points):
    corners, count = drawn(seed)
    shape = outline(corners, count, points)
    assert shape.shape == (len(count), points, 2)
    area = area_and_centroid(shape, np.full(len(count), points))[0]
    whole = area_and_centroid(corners, count)[0]
    assert (area <= whole + 1e-9).all() and (area > 0.75 * whole).all()
