from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.compute.compiled import compiled
from marssim.inspection.tilted_planes import BARE
from marssim.render.relief.ground import Ground, ground_relief
from marssim.render.relief.height import around, base_at, footprint_at, height_at, near_height
from marssim.scene.look import draw_look
from marssim.scene.outcrop.config import OutcropConfig
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

SCENE = build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.0)), np.random.default_rng(3))
LOOKS = {
    "bare": {"texture_strength": 0.0},
    "rough": {"texture_strength": 1.2, "wind_ripples": 0.0, "bedrock": 0.0},
    "rippled": {"texture_strength": 1.0, "wind_ripples": 0.9, "bedrock": 0.0},
    "bedrock": {"texture_strength": 0.8, "wind_ripples": 0.3, "bedrock": 0.8},
}


@compiled
def heights(data, relief, x, y, footprint):
    out = np.empty((len(x), 7))
    for k in range(len(x)):
        out[k] = height_at(data, relief, np.float32(x[k]), np.float32(y[k]), np.float32(footprint), True)
    return out


@compiled
def bases(data, relief, x, y):
    out = np.empty((len(x), 3))
    for k in range(len(x)):
        out[k] = base_at(data, relief.base, np.float32(x[k]), np.float32(y[k]))
    return out


@compiled
def models(data, relief, x, y, dx, dy, footprint):
    out = np.empty((len(dx), 5))
    model = around(data, relief, np.float32(x), np.float32(y), np.float32(footprint))
    for k in range(len(dx)):
        out[k] = near_height(data, model, np.float32(dx[k]), np.float32(dy[k]))
    return out


@compiled
def width(eye, focal, x, y, z):
    return footprint_at(eye, focal, x, y, z)


def looked(name: str) -> Scene:
    return replace(SCENE, look=replace(draw_look(BARE, np.random.default_rng(0)), texture_seed=5, **LOOKS[name]))


class Grounds(dict[str, Ground]):
    """The ground of each look, made when a test first asks for it."""

    def __missing__(self, name: str) -> Ground:
        self[name] = ground_relief(looked(name))
        return self[name]


GROUNDS = Grounds()


def at(ground: Ground, x, y, footprint: float) -> np.ndarray:
    place = np.array(np.broadcast_arrays(x, y), dtype=float).reshape(2, -1)
    return heights(ground.data, ground.relief, place[0], place[1], footprint)


@pytest.mark.parametrize("footprint", [0.001, 0.004, 0.02, 0.1])
@pytest.mark.parametrize("name", LOOKS)
def test_slopes_are_the_derivatives_of_the_height(name, footprint):
    """On the fine grid, on the coarse one, and beyond the grid of the cover. Heights are float32."""
    step = 4e-4
    for reach in (3.9, 14.0):
        x, y = np.random.default_rng(0).uniform(-reach, reach, (2, 3000))
        slopes = at(GROUNDS[name], x, y, footprint)[:, 1:3]
        for axis in (0, 1):
            dx, dy = step * np.eye(2)[axis]
            ahead, behind = (at(GROUNDS[name], x + sign * dx, y + sign * dy, footprint) for sign in (1, -1))
            across = (ahead[:, 0] - behind[:, 0]) / (2 * step)
            bend = np.maximum(*(np.abs(end[:, 1 + axis] - slopes[:, axis]) for end in (ahead, behind)))
            assert (np.abs(across - slopes[:, axis]) < 0.003 + bend).all()


@pytest.mark.parametrize("name", LOOKS)
def test_height_and_slope_are_continuous_across_the_edge_of_the_fine_grid(name):
    ground, half = GROUNDS[name], float(GROUNDS[name].relief.base.half)
    along = np.random.default_rng(0).uniform(-half, half, 400)
    for footprint in (0.002, 0.02, 0.2):
        for x, y, dx, dy in ((half, along, 1, 0), (-half, along, 1, 0), (along, half, 0, 1), (along, -half, 0, 1)):
            before, after = (at(ground, x + step * dx, y + step * dy, footprint) for step in (-2e-5, 2e-5))
            off = np.abs(before - after)
            assert off[:, 0].max() < 3e-4
            assert np.percentile(off[:, 1:3], 99) < 0.03 and off[:, 1:3].mean() < 0.01


def test_the_terrain_is_the_smooth_surface_of_its_grids():
    ground, terrain = GROUNDS["bare"], SCENE.terrain
    x, y = np.random.default_rng(0).uniform(-3.5, 3.5, (2, 500))  # smooth_heights is symmetric about the edge
    values = bases(ground.data, ground.relief, x, y)
    assert np.allclose(values[:, 0], terrain.fine.smooth_heights(x, y), atol=5e-5)
    assert np.allclose(at(ground, x, y, 0.01)[:, :3], values, atol=1e-6)
    x, y = np.random.default_rng(1).uniform(5, 11, (2, 500))
    assert np.allclose(bases(ground.data, ground.relief, x, y)[:, 0], terrain.coarse.smooth_heights(x, y), atol=5e-5)


@pytest.mark.parametrize("grid", ["fine", "coarse"])
def test_normals_of_bare_ground_have_no_line_at_the_spacing_of_the_grid(grid):
    """Facets would give the slope's spectrum a line at the frequency of the nodes, and at its multiples."""
    ground, spacing = GROUNDS["bare"], getattr(SCENE.terrain, grid).cell
    per_cell, cells = 8, 48 if grid == "fine" else 8
    start = -2.0 if grid == "fine" else 5.0
    axis = start + np.arange(per_cell * cells) * spacing / per_cell
    lines = []
    for y in start + spacing * np.linspace(0.1, cells - 1, 12):
        bend = np.diff(at(ground, axis, y, 0.01)[:, 1], n=2) * np.hanning(len(axis) - 2)
        lines.append(np.abs(np.fft.rfft(bend, len(axis))) ** 2)
    power = np.mean(lines, axis=0)
    line = cells  # frequency of the nodes
    beside = np.concatenate([power[line - 4 : line - 1], power[line + 2 : line + 5]])
    facets = np.mean([
        np.abs(np.fft.rfft(np.diff(np.repeat(slope, per_cell), n=2) * np.hanning(len(axis) - 2), len(axis))) ** 2
        for slope in at(ground, axis[::per_cell], start + 1.0, 0.01)[None, :, 1]
    ], axis=0)  # fmt: skip
    assert power[line - 1 : line + 2].max() < 0.02 * facets[line - 1 : line + 2].max()
    assert power[line - 1 : line + 2].max() < 30 * np.median(beside) + 1e-3 * power.max()


@pytest.mark.parametrize("name", LOOKS)
@given(x=st.floats(-3.5, 3.5), y=st.floats(-3.5, 3.5), footprint=st.floats(0.002, 0.05))
def test_the_model_of_the_relief_around_a_place_is_near_to_it(name, x, y, footprint):
    ground = GROUNDS[name]
    dx, dy = np.random.default_rng(0).uniform(-0.06, 0.06, (2, 40))
    model = models(ground.data, ground.relief, x, y, dx, dy, footprint)
    exact = at(ground, x + dx, y + dy, footprint)
    off = np.abs(model[:, 0] - exact[:, 0])
    assert np.median(off) < 0.004 and off.max() < 0.025


def shares(**look: float) -> np.ndarray:
    """Return the cover (N, N, 3) of a scene: sand, gravel, and how swept the ground is."""
    place = replace(SCENE, look=replace(draw_look(BARE, np.random.default_rng(0)), texture_seed=5, **look))
    ground = ground_relief(place)
    cover = ground.relief.cover
    return ground.data[cover.share : cover.share + 3 * cover.nodes**2].reshape(cover.nodes, cover.nodes, 3)


@given(share=st.sampled_from([0.0, 0.1, 0.3, 0.5, 0.8, 1.0]))
def test_sand_and_gravel_cover_as_much_as_their_knobs_say(share):
    assert shares(wind_ripples=share)[..., 0].mean() == pytest.approx(share, abs=0.02)
    assert shares(gravel=share)[..., 1].mean() == pytest.approx(share, abs=0.02)
    assert shares(gravel=share)[..., 0].max() == 0


def test_bare_ground_has_fragments_at_the_feet_of_rocks_only_where_the_scene_has_fragments():
    config = SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.2), look=BARE)
    most = []
    for fragments in (0.0, 0.5, 1.0):
        place = build_scene(replace(config, outcrop=OutcropConfig(fragments=(fragments, fragments))), 3)
        ground = ground_relief(place)
        cover = ground.relief.cover
        most.append(ground.data[cover.share : cover.share + 3 * cover.nodes**2].reshape(-1, 3).max(axis=0))
    assert np.array(most)[:, 0].max() == 0 and most[0][1] == 0 < most[1][1] < most[2][1]


@given(up=st.floats(0.3, 3.0), away=st.floats(0.0, 40.0), turn=st.floats(0, 6.28), focal=st.floats(200.0, 3000.0))
def test_the_width_of_a_pixel_is_the_mean_axis_of_the_ellipse_that_it_covers(up, away, turn, focal):
    eye = np.array([1.0, -2.0, 5.0])
    got = width(eye, focal, eye[0] + away * np.cos(turn), eye[1] + away * np.sin(turn), eye[2] - up)
    distance = np.hypot(up, away)
    slant = max(up / distance, 0.08)
    assert got == pytest.approx(np.sqrt(distance / focal * distance / (focal * slant)), rel=1e-4)
