import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from marssim.scene.rocks import (
    FAMILIES,
    RockConfig,
    build_rocks,
    covered_area,
    draw_diameters,
    draw_shape,
    icosphere,
    number_density,
)


def level_ground(x, y):
    return np.zeros_like(x)


def build(seed=0, half=10.0, horizon=20.0, clear=(), **config):
    return build_rocks(RockConfig(**config), half, horizon, level_ground, np.random.default_rng(seed), clear)


@given(st.floats(0.02, 0.3), st.floats(0.06, 1.0))
def test_number_density_integrates_to_the_covered_area(k, smallest):
    """Golombek's N(>D) and F_k(D) are two views of one population."""
    d = np.geomspace(smallest, 60, 20_000)
    number = number_density(d, k)
    area = np.sum(-np.diff(number) * np.pi / 4 * ((d[1:] + d[:-1]) / 2) ** 2)
    assert area == pytest.approx(float(covered_area(np.array(smallest), k)), rel=0.02)


def test_counts_are_those_of_the_published_table():
    for k, at_tenth, at_third, at_metre in ((0.033, 69.6, 3.7, 0.01), (0.07, 138, 13.3, 0.12), (0.20, 333, 45.9, 1.2)):
        got = 100 * number_density(np.array([0.1, 0.3, 1.0]), k)
        assert got == pytest.approx([at_tenth, at_third, at_metre], rel=0.05, abs=0.005)


def test_drawn_diameters_cover_what_the_law_says():
    areas = []
    for seed in range(30):
        d = draw_diameters(0.07, 0.1, 900.0, np.random.default_rng(seed))
        areas.append(np.sum(np.pi / 4 * d**2) / 900)
        assert (np.diff(d) <= 0).all()
    expected = covered_area(np.array(0.1), 0.07) - covered_area(np.array(2.5), 0.07)
    error = np.std(areas) / np.sqrt(len(areas))
    assert np.mean(areas) == pytest.approx(float(expected), abs=4 * error + 0.02 * expected)


@settings(max_examples=20)
@given(st.sampled_from(FAMILIES), st.integers(0, 3), st.integers(0, 10_000))
def test_shapes_are_closed_star_shaped_and_of_unit_outline(family, level, seed):
    vertices, middle = draw_shape(family, level, np.random.default_rng(seed))
    faces = icosphere(level)[1]
    assert vertices[:, 2].min() == pytest.approx(0)
    assert vertices[:, 2].max() == pytest.approx(1)
    a, b, c = (vertices[faces[:, i]] - (0, 0, middle) for i in range(3))
    assert (np.einsum("ij,ij->i", a, np.cross(b, c)) > 0).all()  # every face is seen from the centre, outward
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert ConvexHull(vertices[:, :2]).volume == pytest.approx(np.pi / 4)


def test_rocks_stand_out_of_the_ground_by_their_height_and_reach_below_it():
    rocks = build(k=0.1)
    for rock in range(0, len(rocks), 40):
        own = rocks.vertices[np.unique(rocks.faces[rocks.face_rock == rock])]
        assert own[:, 2].max() == pytest.approx(rocks.height[rock], abs=1e-6)
        assert own[:, 2].min() < 0


def test_heights_are_about_half_the_diameter():
    rocks = build(k=0.15)
    assert np.median(rocks.height / rocks.diameter) == pytest.approx(0.5, abs=0.08)


def test_clear_discs_are_free_of_rocks():
    rocks = build(k=0.2, clear=((2.0, -3.0, 2.5),))
    large = rocks.diameter >= 0.1
    gap = np.hypot(rocks.centre[large, 0] - 2, rocks.centre[large, 1] + 3) - rocks.diameter[large] / 2
    assert gap.min() >= 2.5


def test_large_rocks_hardly_overlap():
    rocks = build(k=0.1, cluster=0.5)
    large = np.flatnonzero(rocks.diameter >= 0.3)
    d = np.linalg.norm(rocks.centre[large, None, :2] - rocks.centre[None, large, :2], axis=2)
    touching = d < 0.5 * (rocks.diameter[large, None] + rocks.diameter[None, large])
    assert np.triu(touching, 1).sum() <= 0.02 * len(large)


def test_no_rocks_at_k_zero_and_faces_ascend():
    assert len(build(k=0.0)) == 0
    rocks = build(k=0.05)
    assert (np.diff(rocks.face_rock) >= 0).all()
    assert set(np.unique(rocks.face_rock)) == set(range(len(rocks)))


@pytest.mark.parametrize("bad", [{"k": 0.9}, {"min_diameter": 0.0}, {"buried": (0.4, 0.9)}, {"families": (0, 0, 0)}])
def test_impossible_rocks_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        RockConfig(**bad)
