"""The cap lies above the ground and its stones, so that no ray begins below them."""

from dataclasses import replace

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled
from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.inspection.tilted_planes import BARE, plane
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.geometry.surface import SceneSurface
from marssim.render.relief.height import cover_at, height_at
from marssim.render.relief.stones.bodies import BARE as ON_BARE_GROUND
from marssim.render.relief.stones.bodies import (
    CELLS,
    EAST,
    GRAVEL,
    MIDDLE,
    NORTH,
    RANK,
    RISE,
    SAND_STONES,
    SIDE,
    SIZE,
    X,
    Y,
)
from marssim.render.renderers.by_name import make_renderer
from marssim.render.renderers.embree_renderer import MeshTracer
from marssim.scene.look import draw_look
from marssim.scene.outcrop.config import OutcropConfig
from marssim.scene.presets import preset
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, build_scene

DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
FINEST = 0.002  # [m]
LOOKS = {
    "plain": {"texture_strength": 0.0, "gravel": 0.0, "pebbles": 0.0},
    "gravel": {"texture_strength": 1.0, "gravel": 0.9},
    "rippled": {"texture_strength": 1.3, "wind_ripples": 0.9, "gravel": 0.05, "pebbles": 1.0},
    "bedrock": {"texture_strength": 1.0, "bedrock": 0.9, "gravel": 0.1},
    "drifts": {"texture_strength": 0.5, "drifts": 1.0, "gravel": 0.1},
}


@compiled
def _heights(data, relief, xy):
    out = np.empty(len(xy))
    for k in range(len(xy)):
        out[k] = height_at(data, relief, np.float32(xy[k, 0]), np.float32(xy[k, 1]), np.float32(FINEST), True)[0]
    return out


@compiled
def _lying(data, cover, stone, octave):
    """Return the middles x, y (N, 2) of the stones that lie on the ground in one copy of each octave's tile."""
    out, which = np.empty((len(stone), 2)), np.empty(len(stone), dtype=np.int64)
    count = 0
    for m in range(len(stone)):
        n = 0
        while octave[n, SIDE] < stone[m, SIZE]:
            n += 1
        period = CELLS * octave[n, SIDE]
        x, y = stone[m, X] + octave[n, EAST], stone[m, Y] + octave[n, NORTH]
        x -= period * np.floor(x / period + 0.5)  # the copy nearest to the scene's middle
        y -= period * np.floor(y / period + 0.5)
        sand, _, _, gravel, _ = cover_at(data, cover, np.float32(x), np.float32(y))
        share = octave[n, ON_BARE_GROUND] * (1 - SAND_STONES * sand) + octave[n, GRAVEL] * gravel
        if stone[m, RANK] <= share:
            out[count, 0], out[count, 1], which[count] = x, y, m
            count += 1
    return out[:count], which[:count]


def looked(name: str) -> Scene:
    rocks = RockConfig(k=0.2 if name == "drifts" else 0.0)
    config = preset("gravel", size=8.0, horizon=16.0, rocks=rocks, outcrop=OutcropConfig(fragments=(0, 0)))
    scene = build_scene(config, 3)
    return replace(scene, look=replace(draw_look(BARE, np.random.default_rng(0)), texture_seed=2, **LOOKS[name]))


def clearance(surface: SceneSurface, xy: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Return how high (N,) the cap lies over heights above the ground, top (N,), at places (N, 2)."""
    tracer = MeshTracer([surface.cap])
    pose = DOWN.copy()
    pose[2, 3] = 1000.0  # nearly vertical rays
    rays = np.stack([xy[:, 0] / 1000, -xy[:, 1] / 1000, np.ones(len(xy))], axis=1)
    over = []
    for part in np.array_split(np.arange(len(xy)), 4):
        over.append(1000.0 - tracer.trace(rays[part], pose).depth.astype(float))
    tracer.close()
    return np.concatenate(over) - _heights(surface.ground.data, surface.ground.relief, xy) - top


@pytest.mark.parametrize("name", LOOKS)
def test_the_cap_lies_above_the_ground_and_its_stones_and_not_much_higher(name):
    surface = SceneSurface(looked(name))
    ground = surface.ground
    inside = np.random.default_rng(0).uniform(-4.2, 4.2, (40_000, 2))
    around = np.random.default_rng(1).uniform(-15, 15, (20_000, 2))
    for xy, most in ((inside, 0.05), (around, 0.12)):
        over = clearance(surface, xy, np.zeros(len(xy)))
        assert over.min() > -1e-4, f"{over.min()} at {xy[over.argmin()]}"
        assert np.median(over) < most
    xy, which = _lying(ground.data, ground.relief.cover, ground.stones.stone, ground.stones.octave)
    if name == "plain":
        assert len(xy) == 0
        return
    near = (np.abs(xy) < 4.5).all(axis=1)
    stone = ground.stones.stone[which[near]].astype(float)
    assert len(stone) > 1000
    over = clearance(surface, xy[near], 1 / stone[:, RISE] + stone[:, MIDDLE])
    assert over.min() > -1e-4, f"{(over < -1e-4).sum()} stones stand out, by up to {-over.min()}"


@pytest.mark.parametrize("name", ["scan", "embree"])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.2, -0.1)])
def test_no_ray_slips_through_at_the_edge_of_the_fine_grid(name, tilt):
    scene = plane(np.array(tilt))
    renderer = make_renderer(name, scene)
    half = scene.half
    camera = PinholeCamera(161, 161, 400.0, 400.0, 80.0, 80.0)
    up = np.array([-tilt[0], -tilt[1], 1.0])
    for x, y, yaw in ((half - 1.0, 0.3, 0.0), (-half + 0.75, half - 0.75, 2.3), (half + 1.0, -1.0, 3.1)):
        eye = np.array([x, y, tilt[0] * x + tilt[1] * y + 0.9])
        pose = look_pose(eye, yaw, np.deg2rad(40), 0.2)
        view = renderer.render(camera, pose)
        rays = camera.rays() @ pose[:3, :3].T
        expected = -(eye @ up) / (rays @ up)
        place = np.abs((eye + expected[..., None] * rays)[..., :2]).max(axis=-1)
        assert (place < half).any() and (place > half).any(), "the view does not show the edge"
        assert (view.surface == GROUND).all()
        assert np.allclose(view.depth, expected, rtol=2e-4)
    renderer.close()


def test_rays_across_the_edge_of_rough_ground_hit_it_where_the_finest_steps_do():
    scene = looked("rippled")
    renderer, half = make_renderer("scan", scene), scene.half
    x, y = half + np.linspace(-0.3, 0.3, 1001), 0.7
    eye = np.array([half, y, float(scene.terrain.height_at(half, y)) + 1.0])
    pose = look_pose(eye, 0.0, np.deg2rad(90))
    rays = np.stack(
        [(np.array([x, np.full_like(x, y)]).T - eye[:2]) @ pose[:2, k] for k in range(2)] + [np.ones_like(x)], 1
    )
    hits = renderer.trace(rays, pose, Footprint(eye, 500.0))
    assert (hits.surface == GROUND).all()
    assert np.abs(np.diff(hits.depth)).max() < 0.03  # no gap
    renderer.close()
