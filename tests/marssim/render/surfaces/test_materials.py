from dataclasses import replace

import numpy as np
import pytest

from marssim.base.dataset.frame import GROUND
from marssim.inspection.tilted_planes import plane
from marssim.render.surfaces.materials import FILLET, HIGHEST_FILLET, materials
from marssim.render.surfaces.regolith import VARIANTS
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

SCENE = build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.1)), np.random.default_rng(3))


def seeded(seed: int):
    return materials(replace(SCENE, look=replace(SCENE.look, texture_seed=seed)))


def test_rocks_are_found_by_their_surface_id():
    rocks = materials(SCENE)[1].of_surface
    assert len(rocks) == len(SCENE.bodies) + 1 and not any(rocks[GROUND])
    members = rocks[GROUND + 1 :]
    assert np.array_equal(members["albedo"], SCENE.bodies.albedo)
    share = members["fillet"] / SCENE.bodies.height
    assert members["fillet"].max() <= HIGHEST_FILLET and share.max() <= FILLET[1]
    low = members["fillet"] < HIGHEST_FILLET
    assert share[low].min() >= FILLET[0] and share[low].std() > 0.02


def test_the_plane_under_a_rock_is_that_of_the_ground():
    slope = np.array([0.1, -0.2])
    scene = replace(SCENE, terrain=plane(slope).terrain)
    inside = (np.abs(scene.bodies.centre[:, :2]) < 14).all(axis=1)  # about the edge of the scene there is no plane
    members = materials(scene)[1].of_surface[1:][inside]
    assert len(members) > 100 and np.allclose(members["base"], 0, atol=1e-9)
    assert np.allclose([members["east"], members["north"]], slope[:, None])


def test_scenes_share_tiles_but_not_places():
    (first, stone), (second, other) = seeded(7), seeded(7 + VARIANTS)
    assert first.relief.tile is second.relief.tile and stone.noise.tile is other.noise.tile
    assert first.relief.tile is not stone.noise.tile and first.relief.tile is not first.stains.tile
    assert not np.allclose(first.relief.places[:, 1:5], second.relief.places[:, 1:5], atol=1e-3)
    assert first.pebbles.offset != second.pebbles.offset


@pytest.mark.parametrize("bedrock", [0.0, 0.5])
def test_plates_are_made_only_where_bedrock_shows(bedrock):
    ground = materials(replace(SCENE, look=replace(SCENE.look, bedrock=bedrock)))[0]
    assert (len(ground.bedrock.codes) > 1) == (bedrock > 0)
    assert ground.mix.swept == np.float32(bedrock)
