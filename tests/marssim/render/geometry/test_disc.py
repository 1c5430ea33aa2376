"""Shares of the sun's disc compared with closed forms, and with Embree's rays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.disc import SAMPLES, disc_samples
from marssim.render.geometry.mesh import SceneMesh, scene_mesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.visibility import SELF_GAP, Visibility
from marssim.render.renderers.embree_renderer import MeshTracer
from marssim.scene.look import SUN_RADIUS, sun_direction
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
    [1, 5, 7], [1, 7, 3],
], dtype=np.int32)  # fmt: skip


def box(low, high) -> SceneMesh:
    low, high = np.array([low], dtype=float), np.array([high], dtype=float)
    vertices = low + CORNERS * (high - low)
    surface, none = np.full(len(FACES), GROUND + 1, np.int32), np.zeros((len(vertices), 3), np.float32)
    return SceneMesh(vertices, FACES, surface, none, np.array([0, len(FACES)]), low, high)


def beyond_edge(t: np.ndarray) -> np.ndarray:
    """Share of a disc of radius 1 on one side of a line at a distance t from its centre, on the far side for t > 0."""
    t = np.clip(t, -1, 1)
    return 0.5 + (t * np.sqrt(1 - t * t) + np.arcsin(t)) / np.pi


def below_wall(elevation: float, azimuth: float, distance: float, count: int = 201) -> tuple[np.ndarray, ...]:
    """Return a sun, and points across the border of the shadow that the top of a wall casts, `distance` [m] from it.

    The wall is the box of x from 0 to 3 m and y from -500 to 500 m, 2 m high, so its farther top edge is at x = 0. The
    points lie across the sunlight, up to three times half the border's width from its middle; so does `offset` [m].
    """
    sun = sun_direction(np.deg2rad(elevation), np.deg2rad(azimuth))
    edge = np.array([0.0, 0.0, 2.0])
    upward = np.cross(sun, [0.0, 1.0, 0.0])  # across the sunlight and the edge
    upward *= np.sign(upward[2]) / np.linalg.norm(upward)
    offset = np.linspace(-3, 3, count) * SUN_RADIUS * distance
    return sun, edge - distance * sun + offset[:, None] * upward, offset


@given(st.floats(8, 80), st.floats(-60, 60), st.floats(0.3, 30))
def test_behind_a_straight_edge_light_grows_as_the_disc_rises(elevation, azimuth, distance):
    sun, points, offset = below_wall(elevation, azimuth, distance)
    visibility = Visibility(box((0, -500, -20), (3, 500, 2)), sun)
    normals = np.tile(sun, (len(points), 1))
    expected = beyond_edge(offset / (SUN_RADIUS * (distance - SELF_GAP)))
    share = visibility.sun_share(points, normals)
    assert share == pytest.approx(expected, abs=0.05)
    assert np.abs(share - expected).mean() < 0.01
    assert (share[expected == 0] == 0).all() and (share[expected == 1] == 1).all()
    clear = np.abs(offset) > 1e-6
    assert np.array_equal(visibility.lit(points, normals)[clear], (expected > 0.5)[clear])
    apart = visibility.shadow_distance(points, normals)
    assert (apart[clear & (expected > 0.5)] == np.inf).all()
    assert apart[clear & (expected < 0.5) & (expected > 0)] == pytest.approx(distance, rel=0.03)


@given(st.floats(1, 40), st.floats(0.3, 30))
def test_a_points_share_does_not_depend_on_the_points_asked_with_it(elevation, distance):
    sun, points, _ = below_wall(elevation, 0.0, distance, count=31)
    visibility, normals = Visibility(box((0, -500, -20), (3, 500, 2)), sun), np.tile(sun, (len(points), 1))
    alone = [visibility.sun_share(points[[n]], normals[[n]])[0] for n in range(len(points))]
    assert np.array_equal(visibility.sun_share(points, normals), alone)


def test_near_what_casts_it_a_border_is_sharp():
    sun, points, offset = below_wall(30, 10, 0.1)
    points += (0.1 - 0.002) * sun  # 2 mm from the edge, at the same offsets
    share = Visibility(box((0, -500, -20), (3, 500, 2)), sun).sun_share(points, np.tile(sun, (len(points), 1)))
    soft = (share > 0) & (share < 1)
    assert (np.abs(offset[soft]) < 1.1 * SUN_RADIUS * 0.002).all()
    assert np.array_equal(share[~soft] == 1, (offset > 0)[~soft])


def test_two_bodies_hide_what_either_hides():
    sun = sun_direction(np.deg2rad(90), 0.0)
    points = np.zeros((200, 3))
    points[:, 0] = np.linspace(-0.05, 0.05, 200)
    up = np.tile([0.0, 0.0, 1.0], (200, 1))
    left, right = box((-5, -5, 4), (0, 5, 4.5)), box((0.01, -5, 7), (5, 5, 8))
    both = SceneMesh(
        np.concatenate([left.vertices, right.vertices]), np.concatenate([FACES, FACES + 8]),
        np.concatenate([left.surface, right.surface + 1]), np.zeros((16, 3), np.float32), np.array([0, 12, 24]),
        np.concatenate([left.low, right.low]), np.concatenate([left.high, right.high]),
    )  # fmt: skip
    shares = [Visibility(mesh, sun).sun_share(points, up) for mesh in (left, right, both)]
    assert shares[2] == pytest.approx(np.maximum(shares[0] + shares[1] - 1, 0), abs=1e-6)
    assert 0.2 < shares[2].max() < 0.9  # nowhere does the gap show the whole disc


def test_samples_lie_evenly_on_the_disc():
    samples = disc_samples(SUN_RADIUS) / np.tan(SUN_RADIUS)
    assert np.hypot(*samples.T).max() < 1 and np.abs(samples.mean(axis=0)).max() < 0.01
    for angle in np.linspace(0, np.pi, 37):
        along = samples @ [np.cos(angle), np.sin(angle)]
        for t in (-0.6, 0.0, 0.6):
            assert (along < t).mean() == pytest.approx(beyond_edge(np.array(t)), abs=2.5 / SAMPLES)


def test_among_rocks_shares_are_those_of_embrees_rays():
    scene = build_scene(SceneConfig(size=8.0, horizon=20.0, rocks=RockConfig(k=0.15)), 5).with_sun(20.0, 30.0)
    mesh = scene_mesh(scene)
    visibility = Visibility(mesh, scene.look.sun)
    points, up = border_points(scene, visibility, 3000)
    share = visibility.sun_share(points, up)
    caster = MeshTracer([mesh])
    axes = Projection.of_sun(scene.look.sun).axes[:2]
    samples = disc_samples(SUN_RADIUS)
    free = [caster.free(points, up, np.tile(scene.look.sun + each @ axes, (len(points), 1)), None) for each in samples]
    caster.close()
    expected = np.mean(free, axis=0)
    assert ((expected > 0) & (expected < 1)).mean() > 0.4
    assert np.abs(share - expected).mean() < 0.04
    assert np.abs(np.mean(share - expected)) < 0.01


def border_points(scene, visibility: Visibility, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points a little above the ground where light changes to shadow, and vertical normals."""
    rng = np.random.default_rng(1)
    ends = rng.uniform(-3, 3, (count, 2))
    ends = np.stack([ends, ends + rng.normal(0, 0.2, (count, 2))])
    up = np.tile([0.0, 0.0, 1.0], (count, 1))

    def above(place: np.ndarray) -> np.ndarray:
        return np.column_stack([place, scene.terrain.height_at(*place.T) + 0.1])

    first = visibility.lit(above(ends[0]), up)
    change = first != visibility.lit(above(ends[1]), up)
    for _ in range(12):
        middle = ends.mean(axis=0)
        same = visibility.lit(above(middle), up) == first
        ends[0, same], ends[1, ~same] = middle[same], middle[~same]
    place = ends.mean(axis=0)
    apart = np.hypot(*(place[:, None] - scene.bodies.centre[None, :, :2]).T).T
    some = change & (apart > scene.bodies.diameter).all(axis=1)  # no point inside a rock
    return above(place[some]), up[some]
