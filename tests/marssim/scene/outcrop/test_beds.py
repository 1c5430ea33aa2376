import cv2
import numpy as np

from marssim.scene.outcrop.beds import THICKNESS, upper_beds
from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.pavement import draw_slabs
from marssim.scene.outcrop.polygons import area_and_centroid


def level_ground(x, y):
    return np.zeros_like(x)


TRAITS = Traits(slabs=0.4, slab_size=0.6, slab_tilt_deg=3.0, slab_height=0.05)
SLABS = draw_slabs(TRAITS, 8.0, 24.0, level_ground, np.random.default_rng(0))


def drawn(clear=(), most=10_000):
    return upper_beds(SLABS, level_ground, clear, most, np.random.default_rng(1))


def depth_inside(outline, points):
    """Return how far points (N, 2) lie inside an outline [m]; negative outside."""
    polygon = outline.astype(np.float32)
    return np.array([cv2.pointPolygonTest(polygon, (float(x), float(y)), True) for x, y in points])


def supports(bed, n, parts):
    """Return how far bed n lies inside the outline of each plate just below it, and the gap between them [m]."""
    points, centre = bed.outline[n], bed.outline[n].mean(axis=0)
    for part in parts:
        for below in np.flatnonzero(np.hypot(*(part.outline.mean(axis=1) - centre).T) < 2):
            rise = bed.plane[n] @ (1, *centre) - part.plane[below] @ (1, *centre)
            if 0 < rise < 2 * THICKNESS[1]:
                yield depth_inside(part.outline[below], points).min(), rise - bed.thickness[n]


def test_some_slabs_carry_beds_and_some_beds_carry_another():
    slabs, beds = sum(map(len, SLABS)), sum(map(len, drawn()))
    assert 0.2 * slabs < beds < 2 * slabs
    height = max(part.exposed.max() for part in drawn()) - max(part.exposed.max() for part in SLABS)
    assert height < 3 * THICKNESS[1] and {part.level for part in drawn()} <= {part.level for part in SLABS}


def assert_supported(beds):
    for bed in beds:
        for n in range(len(bed)):
            assert any(inside > -1e-4 and gap < 0 for inside, gap in supports(bed, n, [*SLABS, *beds]))  # [m]


def test_the_outline_of_a_bed_lies_inside_that_of_a_plate_just_below_it():
    beds = drawn()
    assert sum(map(len, beds)) > 50
    assert_supported(beds)


def test_clear_discs_and_numbers_leave_no_bed_without_a_plate_below_it():
    disc = (1.0, -2.0, 2.5)
    for beds in (drawn(clear=(disc,)), drawn(most=60)):
        assert 20 < sum(map(len, beds)) < sum(map(len, drawn()))
        assert_supported(beds)
    assert sum(map(len, drawn(most=60))) == 60
    for part in drawn(clear=(disc,)):
        assert (np.hypot(*(part.middle - disc[:2]).T) > disc[2] + part.diameter / 2).all()


def test_diameters_and_middles_are_those_of_what_shows():
    buried = 0
    for part in drawn():
        whole, centre = area_and_centroid(part.outline, np.full(len(part), part.outline.shape[1]))
        area = np.pi / 4 * part.diameter**2
        out = (part.top_at(part.outline[..., 0], part.outline[..., 1]) > 0).all(axis=1)
        assert np.allclose(area[out], whole[out]) and np.allclose(part.middle[out], centre[out])
        assert (area[~out] < whole[~out]).all()
        buried += (~out).sum()
    assert buried > 5


def test_no_slabs_have_no_beds():
    assert upper_beds([], level_ground, (), 10, np.random.default_rng(0)) == []
