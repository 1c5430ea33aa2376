from dataclasses import replace

import numpy as np
import pytest

from marssim.base.dataset.frame import GROUND
from marssim.render.relief.ground import ground_relief
from marssim.render.relief.layers import VARIANTS
from marssim.render.relief.stones.bodies import TONE
from marssim.render.surfaces.materials import NO_PLATES, materials
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

SCENE = build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.1)), np.random.default_rng(3))


def made(scene: Scene):
    return materials(scene, ground_relief(scene))


def seeded(seed: int):
    return made(replace(SCENE, look=replace(SCENE.look, texture_seed=seed)))


def test_rocks_are_found_by_their_surface_id():
    rocks = made(SCENE)[1].of_surface
    assert len(rocks) == len(SCENE.bodies) + 1 and not any(rocks[GROUND])
    members = rocks[GROUND + 1 :]
    assert np.array_equal(members["albedo"], SCENE.bodies.albedo)


def test_scenes_share_tiles_but_not_places():
    (first, _), (second, _) = seeded(7), seeded(7 + VARIANTS)
    assert first.stains.tile is second.stains.tile
    assert not np.allclose(first.stains.places[:, 1:5], second.stains.places[:, 1:5], atol=1e-3)


def test_stones_have_tones_of_their_own():
    soil = seeded(7)[0]
    stones = ground_relief(SCENE).stones
    assert len(soil.tones) == len(stones.stone) and soil.tones.std() == pytest.approx(1, abs=0.02)
    assert np.array_equal(made(SCENE)[0].tones, stones.stone[:, TONE])


def test_stones_that_are_too_small_to_show_cover_as_much_as_their_knobs_say():
    def cover(**look) -> tuple[float, float]:
        scene = replace(SCENE, look=replace(SCENE.look, **look))
        mix = made(scene)[0].mix
        return float(mix.hidden_bare), float(mix.hidden_gravel)

    none, some, most = (cover(pebbles=share, gravel=0.3)[0] for share in (0.0, 0.5, 1.0))
    assert none == 0 < some < most < 0.5 < cover(pebbles=0.0, gravel=0.3)[1] < 1


@pytest.mark.parametrize("bedrock", [0.0, 0.5])
def test_plates_are_made_only_where_bedrock_shows(bedrock):
    soil = made(replace(SCENE, look=replace(SCENE.look, bedrock=bedrock)))[0]
    assert (soil.plates is NO_PLATES) == (bedrock == 0)
