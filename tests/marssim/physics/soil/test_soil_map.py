from dataclasses import replace

import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.base.rover_spec import ZHURONG
from marssim.physics.soil.soil_map import SoilMap, on_rock
from marssim.physics.support import SupportMap
from marssim.render.relief.ground import ground_relief
from marssim.render.relief.height import height_at
from marssim.scene.ground.cover import ground_cover
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene


def scene(**look):
    place = preset("gale", size=12.0, horizon=16.0)
    fixed = {name: (value, value) for name, value in look.items()}
    return build_scene(replace(place, look=replace(place.look, **fixed)), 3)


def test_the_shares_add_up_and_follow_what_the_scene_shows():
    place = scene(wind_ripples=0.4, bedrock=0.4)
    cover, soils = ground_cover(place), SoilMap.from_scene(place)
    np.testing.assert_allclose(soils.shares.sum(axis=-1), 1, atol=1e-12)
    assert soils.shares.min() >= 0 and soils.shares[..., 2].max() > 0.5
    sand, crust, _ = np.moveaxis(soils.shares, -1, 0)
    np.testing.assert_allclose(sand * (1 - cover.sand), crust * cover.sand, atol=1e-6)  # plates lie over both alike
    sandy, swept = cover.sand > 0.95, cover.swept > 0.5
    assert soils.shares[sandy & (cover.swept <= 0)][:, 0].min() > 0.9
    assert soils.shares[swept & (cover.drift == 0)][:, 2].min() > 0.3


@compiled
def drawn_plates(data, relief, x, y):
    """Return where a pixel of 5 mm at x, y (N,) shows bedrock, (N,) 0 to 1."""
    out = np.empty(len(x))
    for k in range(len(x)):
        out[k] = height_at(data, relief, np.float32(x[k]), np.float32(y[k]), np.float32(0.005), True)[6]
    return out


@pytest.mark.parametrize("bedrock", [0.15, 0.4, 0.9])
def test_the_share_of_bedrock_is_the_drawn_one(bedrock):
    """Over the whole scene, and on ground that is swept little and much."""
    place = scene(bedrock=bedrock)
    x, y = np.random.default_rng(0).uniform(-6, 6, (2, 40_000))
    ground = ground_relief(place)
    drawn, share = drawn_plates(ground.data, ground.relief, x, y), SoilMap.from_scene(place).at(x, y)[:, 2]
    assert share.mean() == pytest.approx(drawn.mean(), abs=0.03)
    for part in (share < 0.2, share > 0.5):
        assert part.sum() < 400 or share[part].mean() == pytest.approx(drawn[part].mean(), abs=0.05)


def test_drifts_hide_the_bedrock_below_them():
    place = scene(wind_ripples=0.0, bedrock=1.0, drifts=0.9)
    cover, soils = ground_cover(place), SoilMap.from_scene(place)
    covered = (cover.drift > 0.5) & (cover.swept > 0.5)
    assert covered.any() and (soils.shares[..., 2] <= 1 - cover.drift + 1e-6).all()


def test_a_scene_without_bedrock_has_none_and_one_without_sand_is_crust():
    soils = SoilMap.from_scene(scene(wind_ripples=0.0, bedrock=0.0, drifts=0.0))
    np.testing.assert_array_equal(soils.shares[..., 1], 1)


def test_places_are_looked_up_between_the_nodes_and_clipped_at_the_edge():
    place = scene(wind_ripples=0.5)
    soils, axis = SoilMap.from_scene(place), ground_cover(place).axis
    np.testing.assert_allclose(soils.at(axis[[5]], axis[[9]])[0], soils.shares[9, 5], atol=1e-9)
    middle = soils.at((axis[[5]] + axis[[6]]) / 2, axis[[9]])[0]
    np.testing.assert_allclose(middle, soils.shares[9, 5:7].mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(soils.at(np.array([1e3]), np.array([1e3]))[0], soils.shares[-1, -1], atol=1e-5)


def test_one_soil_can_lie_everywhere():
    soils = SoilMap.from_scene(scene(), "crust")
    np.testing.assert_array_equal(soils.at(np.array([0.0, 5.0]), np.array([-3.0, 2.0])), [[0, 1, 0]] * 2)
    with pytest.raises(ValueError, match="ground 'mud' is unknown; choose from scene, sand, crust, bedrock"):
        SoilMap.from_scene(scene(), "mud")


def test_rocks_are_told_from_the_ground(make_scene):
    place = make_scene(balls=[(1.0, 0.0, 0.0, 0.2)])
    support = SupportMap.from_scene(place, ZHURONG.obstacle_height)
    np.testing.assert_array_equal(on_rock(support, np.array([1.0, 2.0]), np.zeros(2)), [True, False])
