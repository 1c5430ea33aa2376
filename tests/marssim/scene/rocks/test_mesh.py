import numpy as np
import pytest
import trimesh

from marssim.scene.rocks.mesh import build_rocks
from marssim.scene.rocks.population import COBBLE_ANGLE, RockConfig


def level_ground(x, y):
    return np.zeros_like(x)


def build(seed=0, half=10.0, horizon=20.0, clear=(), **config):
    return build_rocks(RockConfig(**config), half, horizon, level_ground, np.random.default_rng(seed), clear)


def test_rocks_stand_out_of_the_ground_by_their_height_and_reach_below_it():
    rocks = build(k=0.1)
    for rock in range(0, len(rocks), 300):
        vertices = rocks.vertices[np.unique(rocks.faces[rocks.face_rock == rock])]
        assert vertices[:, 2].max() == pytest.approx(rocks.height[rock], abs=1e-6)
        assert vertices[:, 2].min() < 0


def test_heights_are_about_half_the_diameter():
    rocks = build(k=0.15)
    assert np.median(rocks.height / rocks.diameter) == pytest.approx(0.5, abs=0.08)


def test_every_rock_of_a_scene_is_a_closed_body_with_its_outside_out():
    rocks = build(k=0.15, half=6.0, horizon=20.0)
    mesh = trimesh.Trimesh(rocks.vertices, rocks.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    a, b, c = (rocks.vertices[rocks.faces[:, i]] - rocks.centre[rocks.face_rock] for i in range(3))
    cone = np.einsum("ij,ij->i", a, np.cross(b, c))
    assert (cone > 0).all()  # star-shaped about the centre
    volume = np.bincount(rocks.face_rock, cone) / 6
    box = np.pi / 4 * rocks.diameter**2 * rocks.height
    assert 0.6 < np.median(volume / box) < 1.6
    mean = np.bincount(rocks.face_rock, mesh.area_faces) / np.bincount(rocks.face_rock)
    assert (mesh.area_faces / mean[rocks.face_rock]).min() > 0.01  # no slivers


def test_clear_discs_are_free_of_the_discs_of_rocks():
    rocks = build(k=0.2, clear=((2.0, -3.0, 2.5),))
    large = rocks.diameter >= 0.1
    to_disc = np.hypot(rocks.centre[large, 0] - 2, rocks.centre[large, 1] + 3) - rocks.diameter[large] / 2
    assert to_disc.min() >= 2.5


def test_heights_do_not_depend_on_the_mix_of_families():
    for families in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
        rocks = build(k=0.15, families=families)
        assert np.mean(rocks.height / rocks.diameter) == pytest.approx(0.5, abs=0.04)
    slabs, cobbles = (build(k=0.15, families=(0, share, 1)) for share in (3, 0))
    assert np.std(slabs.height / slabs.diameter) > np.std(cobbles.height / cobbles.diameter)


def test_rocks_lean_with_a_slope_and_show_the_same_there():
    """Seen from above, a plane tilted by 20 degrees buries no more of the rocks; heights count from the plane."""
    tilt = np.tan(np.deg2rad(20))
    args = (RockConfig(k=0.1), 8.0, 8.0)
    level = build_rocks(*args, level_ground, np.random.default_rng(0))
    steep = build_rocks(*args, lambda x, y: tilt * x - 0.1 * y, np.random.default_rng(0))
    plane = tilt * steep.vertices[:, 0] - 0.1 * steep.vertices[:, 1]
    assert np.allclose(steep.vertices[:, :2], level.vertices[:, :2])
    assert np.allclose(steep.vertices[:, 2] - plane, level.vertices[:, 2])
    mesh = trimesh.Trimesh(steep.vertices, steep.faces, process=False)
    agree = np.einsum("vi,vi->v", steep.vertex_normals, mesh.vertex_normals)
    assert np.median(agree) > 0.98 and np.quantile(agree, 0.02) > 0.7  # blurred on the smallest


def test_near_and_large_rocks_have_more_triangles():
    rocks = build(k=0.2, half=16.0, horizon=40.0)
    count = np.bincount(rocks.face_rock)
    away = np.abs(rocks.centre[:, :2]).max(axis=1)
    large, near = rocks.diameter > 0.6, away < 6.0
    assert count[large & near].min() >= 320 and count[large & near].mean() > 3 * count[large & (away > 25)].mean()
    assert count[(rocks.diameter < 0.05) | (away > 39)].max() <= 320
    # what a camera cannot see is not drawn; what it can see, is
    assert (rocks.diameter[away > 17] >= COBBLE_ANGLE * (16 - 6.4)).all() and rocks.diameter[away > 41].size == 0
    assert 0.04 < rocks.diameter[(away > 16) & (away < 20)].min() < 0.06
    # small rocks get their levels of detail from angles of 0.005 to 0.026 rad on, LEVEL_ANGLES, which costs triangles
    assert rocks.diameter[near].min() < 0.04 and len(rocks.faces) < 850_000


def test_no_rocks_at_k_zero_and_faces_ascend():
    assert len(build(k=0.0)) == 0
    rocks = build(k=0.05)
    assert (np.diff(rocks.face_rock) >= 0).all()
    assert set(np.unique(rocks.face_rock)) == set(range(len(rocks)))
