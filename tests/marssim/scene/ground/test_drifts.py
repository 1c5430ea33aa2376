from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from marssim.inspection.tilted_planes import plane
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.geometry.surface import SceneSurface
from marssim.render.relief.ground import ground_relief
from marssim.scene.ground.drifts import BARE_SHARE, HIGHEST, MOAT_DEEPEST, SMALLEST, TAIL_HIGHEST, drift_heights
from marssim.scene.outcrop.outcrop import Outcrop
from marssim.scene.rocks.mesh import Rocks, mesh_population
from marssim.scene.rocks.population import RockConfig, RockPopulation
from marssim.scene.scene import Scene, SceneConfig, build_scene

CELL = 0.04
EAST = (1.0, 0.0)
LEVEL = plane(np.zeros(2))


def rocks(xy: np.ndarray, diameter: float, height: float) -> Rocks:
    """Return rounded rocks on level ground."""
    n = len(xy)
    every = np.ones(n)
    return mesh_population(
        RockPopulation(
            xy=xy, diameter=diameter * every, height=height * every, buried=0.4 * every, level=np.full(n, 2),
            family=np.full(n, 2), variant=np.arange(n), yaw=0 * every, stretch=every, albedo=every,
        ),
        lambda x, y: 0 * x,
    )  # fmt: skip


def scene(bodies: Rocks, drifts: float = 1.0, seed: int = 0) -> Scene:
    return replace(LEVEL, rocks=bodies, look=replace(LEVEL.look, drifts=drifts, texture_seed=seed))


def laid(place: Scene, wind: tuple[float, float] = EAST, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the drifts of a scene, and x and y of their nodes."""
    axis = np.arange(-place.half, place.half + CELL, CELL)
    heights = drift_heights(place, wind, -place.half, CELL, len(axis), np.random.default_rng(seed))
    return heights, *np.meshgrid(axis, axis)


def grid(spacing: float, reach: float) -> np.ndarray:
    axis = np.arange(-reach, reach + 1e-9, spacing)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def test_sand_lies_against_rocks_and_nowhere_else():
    xy = grid(2.0, LEVEL.half - 2.0)
    heights, x, y = laid(scene(rocks(xy, 0.3, 0.1)))
    away = np.min([np.hypot(x - a, y - b) for a, b in xy], axis=0)
    foot = heights[(away > 0.15) & (away < 0.22)]
    assert np.median(foot) > 0.003 and foot.max() <= HIGHEST
    assert (heights[away > 0.6] == 0).all()
    near = [heights[np.hypot(x - a, y - b) < 0.22].max() > 1e-3 for a, b in xy]
    assert 0.5 < np.mean(near) < 1 and np.mean(near) == pytest.approx(1 - BARE_SHARE, abs=0.2)


def about_one(diameter: float, height: float, wind: tuple[float, float] = EAST) -> tuple[np.ndarray, ...]:
    """Return the drifts (24, ...) about a rock in the middle, drawn 24 times, and x and y of their nodes."""
    place = scene(rocks(np.zeros((1, 2)), diameter, height))
    _, x, y = laid(place)
    return np.stack([laid(place, wind, seed)[0] for seed in range(24)]), x, y


@pytest.mark.parametrize("wind", [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)])
def test_tails_lie_in_the_lee_and_thin_out(wind):
    heights, x, y = about_one(0.5, 0.3, wind)
    before, *behind = (
        heights[:, np.hypot(x - along * wind[0], y - along * wind[1]) < 0.06].max(axis=1).mean()
        for along in (-0.8, 0.45, 0.8, 1.2, 2.6)
    )
    assert behind[0] > 0.02 > before and (np.diff(behind) < 0).all() and behind[-1] < 0.005
    assert heights.max() < 0.2 and heights[:, np.hypot(x, y) > 0.26].max() <= TAIL_HIGHEST


def test_moats_lie_upwind_of_some_high_rocks_only():
    heights, x, _ = about_one(0.6, 0.4)
    deepest = heights.reshape(len(heights), -1).min(axis=1)
    assert -MOAT_DEEPEST <= deepest.min() < -0.005 and 1 < (deepest < -0.003).sum() < 20
    for each in heights[deepest < -0.003]:
        assert x.ravel()[each.argmin()] < -0.2
    assert about_one(0.3, 0.1)[0].min() == 0


def test_no_slope_of_a_drift_is_steeper_than_sand_can_lie():
    place = scene(rocks(grid(2.0, LEVEL.half - 2.0), 0.4, 0.25))
    ground = ground_relief(place)
    heights, cell = ground.drifts.astype(float), 1 / float(ground.relief.base.per_fine_cell)
    axis = float(ground.relief.base.fine_start) + cell * np.arange(len(heights))
    away = np.min([np.hypot(axis[:, None] - y, axis - x) for x, y in place.rocks.centre[:, :2]], axis=0)
    steep = np.hypot(*np.gradient(heights, cell))[(heights > 0.003) & (away > 0.23)]
    assert len(steep) > 1000 and np.percentile(steep, 99) < np.tan(np.deg2rad(35))


def test_the_knob_scales_the_sand_and_none_is_none():
    bodies = rocks(grid(2.0, LEVEL.half - 2.0), 0.3, 0.1)
    half, whole = (laid(scene(bodies, amount))[0] for amount in (0.5, 1.0))
    assert 0.2 < half.sum() / whole.sum() < 0.6
    assert not laid(scene(bodies, 0.0))[0].any() and not laid(scene(rocks(np.zeros((0, 2)), 0.3, 0.1)))[0].any()
    assert not laid(scene(rocks(grid(2.0, 4.0), 0.9 * SMALLEST, 0.03)))[0].any()
    assert ground_relief(scene(bodies, 0.0)).drifts.size == 0


def test_drifts_are_a_function_of_the_scene_and_end_inside_the_fine_square():
    place = build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.15)), 3)
    first, second = laid(place)[0], laid(place)[0]
    assert np.array_equal(first, second) and first.any()
    assert not first[[0, -1]].any() and not first[:, [0, -1]].any()
    fragments = replace(place, outcrop=Outcrop(place.outcrop.bodies, (0, 0, len(place.outcrop)), place.outcrop.traits))
    assert np.array_equal(laid(fragments)[0], laid(replace(place, outcrop=Outcrop()))[0])


def test_rays_meet_the_sand():
    """Seen from above, the ground has the height of its drifts."""
    place = scene(rocks(np.array([[0.0, 0.0]]), 0.6, 0.4), seed=3)
    surface = SceneSurface(place)
    drifts, base, high = surface.ground.drifts, surface.ground.relief.base, 20.0
    assert drifts.max() > 0.03
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = high
    at = np.random.default_rng(0).uniform(-2, 2, (4000, 2)) / high
    rays = np.stack([at[:, 0], -at[:, 1], np.ones(len(at))], axis=1)
    none, before = np.full(len(at), -1), np.full(len(at), high - 0.3)
    hits = surface.hits_from(pose, rays, before, none, Footprint(pose[:3, 3], 600.0), False)
    place_of = (hits.depth[:, None] * at - base.fine_start) * base.per_fine_cell
    expected = ndimage.map_coordinates(drifts.astype(float), place_of.T[::-1], order=3, prefilter=False)
    assert np.allclose(high - hits.depth, expected, atol=1e-4)
    lean = np.hypot(hits.normal[:, 0], hits.normal[:, 1])
    assert lean.max() > 0.2 and (lean[expected == 0] < 1e-3).all()
