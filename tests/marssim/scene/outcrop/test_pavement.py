import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.laying import HEIGHTS, LEAST_SLAB
from marssim.scene.outcrop.pavement import draw_slabs
from marssim.scene.outcrop.polygons import area_and_centroid

HALF, HORIZON = 16.0, 96.0


def level_ground(x, y):
    return np.zeros_like(x)


def slope(x, y):
    return 0.1 * x - 0.05 * y


def drawn(seed=0, ground=level_ground, **traits):
    values = {"slabs": 0.3, "slab_size": 0.5, "slab_tilt_deg": 4.0, "slab_height": 0.05, **traits}
    return draw_slabs(Traits(**values), HALF, HORIZON, ground, np.random.default_rng(seed))


def joined(parts, name):
    return np.concatenate([getattr(part, name) for part in parts])


@settings(deadline=None, max_examples=8)
@given(seed=st.integers(0, 1000), size=st.floats(0.3, 1.2), tilt=st.floats(0, 15), height=st.floats(0.02, 0.15))
def test_slabs_have_edges_of_2_to_15_cm_and_tilts_of_up_to_15_degrees(seed, size, tilt, height):
    parts = drawn(seed, slab_size=size, slab_tilt_deg=tilt, slab_height=height, slabs=0.5)
    for part in parts:
        top = part.top_at(part.outline[..., 0], part.outline[..., 1])
        assert np.allclose(top.max(axis=1), part.exposed) and part.exposed.min() >= HEIGHTS[0] - 1e-9
        assert part.exposed.max() <= HEIGHTS[1] + 1e-9
        assert np.rad2deg(np.arctan(np.hypot(*part.plane[:, 1:].T))).max() <= 15 + 1e-6
        assert part.diameter.min() > 0.4 * LEAST_SLAB


def test_slabs_follow_the_slope_of_the_ground():
    parts = drawn(1, ground=slope, slab_tilt_deg=0.0)
    assert np.allclose(joined(parts, "plane")[:, 1:], [0.1, -0.05])


def test_the_sides_of_most_slabs_reach_into_the_ground():
    parts = drawn(2)
    bottom = [(p.top_at(p.outline[..., 0], p.outline[..., 1]) - p.thickness[:, None]).max(axis=1) for p in parts]
    assert (np.concatenate(bottom) < 0).mean() > 0.9  # the others are hollow below their high edge


def test_neighbours_do_not_overlap():
    """The outlines on a raster cover as much as the sum of their areas."""
    import cv2

    parts = [part for part in drawn(3, slabs=0.6) if part.level == 2]
    cover = np.zeros((1200, 1200), np.uint8)
    whole = 0.0
    for part in parts:
        inside = np.abs(part.outline).max(axis=(1, 2)) < 6
        whole += area_and_centroid(part.outline[inside], np.full(inside.sum(), part.outline.shape[1]))[0].sum()
        for points in part.outline[inside]:
            one = np.zeros_like(cover)
            cv2.fillPoly(one, [np.rint((points + 6) * 100 * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
            cover += one
    assert (cover > 0).sum() > 100_000
    assert (cover > 1).sum() < 0.08 * (cover > 0).sum()  # OpenCV draws the border of a polygon too
    assert whole == pytest.approx((cover > 0).sum() * 1e-4, rel=0.1)


def test_more_ground_has_slabs_where_more_is_asked_for():
    def share(slabs):
        parts = [drawn(seed, slabs=slabs) for seed in range(4)]
        return np.mean([sum((np.pi / 4 * p.diameter**2).sum() for p in part) for part in parts]) / 80**2

    few, many = share(0.1), share(0.5)
    assert 0.01 < few < 0.1 and 2 * few < many < 0.5


def test_no_slabs_where_none_are_asked_for():
    assert drawn(slabs=0.0) == []


def test_far_slabs_have_fewer_points_and_are_larger():
    parts = drawn(4)
    assert [part.level for part in parts] == [2, 1, 0]
    away = np.abs(joined(parts[2:], "middle")).max(axis=1)
    assert np.median(away) > HALF and np.median(parts[2].diameter) > 0.25
