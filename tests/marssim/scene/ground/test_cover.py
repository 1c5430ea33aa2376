from dataclasses import replace

import numpy as np
import pytest

from marssim.physics.soil.soil_map import SoilMap
from marssim.render.relief.ground import ground_relief
from marssim.scene.ground.cover import CELL, ground_cover
from marssim.scene.ground.drifts import drifts_of, wind_direction
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene


def scene(seed=3, **look):
    place = preset("gale", size=12.0, horizon=16.0)
    fixed = {name: (value, value) for name, value in look.items()}
    return build_scene(replace(place, look=replace(place.look, **fixed)), seed)


def test_the_renderer_draws_the_same_sand_and_bedrock():
    place = scene(wind_ripples=0.4, bedrock=0.3)
    cover, ground = ground_cover(place), ground_relief(place)
    at, nodes = int(ground.relief.cover.share), int(ground.relief.cover.nodes)
    shares = ground.data[at : at + 3 * nodes**2].reshape(nodes, nodes, 3)
    np.testing.assert_array_equal(shares[..., 0], cover.sand.astype(np.float32))
    np.testing.assert_array_equal(shares[..., 2], cover.swept.astype(np.float32))
    assert float(ground.relief.cover.start) == pytest.approx(cover.start)
    assert 1 / float(ground.relief.cover.per_cell) == pytest.approx(CELL)


def test_the_wind_blows_across_the_ripples_that_the_renderer_draws():
    for seed in range(3):
        place = scene(seed)
        ripples = ground_relief(place).relief.ripples
        assert wind_direction(place.look) == (float(ripples.cosine), -float(ripples.sine))


def test_the_knobs_are_the_shares_of_the_ground():
    bare = scene(wind_ripples=0.0, gravel=0.0, bedrock=0.0, drifts=0.0)
    assert not ground_cover(bare).sand.any() and not ground_cover(bare).gravel.any()
    sandy = ground_cover(scene(wind_ripples=0.6, gravel=0.0, bedrock=0.0, drifts=0.0))
    assert sandy.sand.mean() == pytest.approx(0.6, abs=0.03)


def test_drifts_are_sand_where_they_lie():
    place = scene(wind_ripples=0.0, drifts=1.0)
    cover, drifts = ground_cover(place), drifts_of(place)
    assert drifts.heights.max() > 0.02 and cover.drift.max() == 1.0
    np.testing.assert_array_equal(cover.sand, cover.drift)


def test_a_scene_has_one_cover():
    place = scene()
    assert ground_cover(place) is ground_cover(place)
    again = ground_cover(scene())
    np.testing.assert_array_equal(again.sand, ground_cover(place).sand)


@pytest.mark.parametrize(("bedrock", "share"), [(0.0, 0.0), (0.01, 0.06), (0.2, 0.15), (0.5, 0.4), (1.0, 0.8)])
def test_plates_of_bedrock_show_on_the_share_that_the_help_says(bedrock, share):
    place = preset("utopia", size=32.0, horizon=34.0, cell=0.5)
    place = build_scene(replace(place, rocks=replace(place.rocks, k=0.0)), 0)
    bare = replace(place.look, bedrock=bedrock, gravel=0.0, drifts=0.0)
    shares = [
        SoilMap.from_scene(replace(place, look=replace(bare, texture_seed=seed))).shares[..., 2].mean()
        for seed in range(12)
    ]
    assert np.mean(shares) == pytest.approx(share, abs=0.04)
