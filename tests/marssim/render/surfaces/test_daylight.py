from dataclasses import replace

import numpy as np
import pytest

from marssim.render.surfaces.daylight import SKY_FALL, Daylight, daylight, skies
from marssim.render.surfaces.shading import SKY_COLOUR
from marssim.scene.look import LookConfig, draw_look, sun_direction

LOOK = draw_look(LookConfig(), np.random.default_rng(0))


def light(elevation_deg: float, depth: float) -> Daylight:
    return daylight(replace(LOOK, sun=sun_direction(np.deg2rad(elevation_deg), 0.5), optical_depth=depth))


def ring(elevation_deg: float, count: int = 13) -> np.ndarray:
    """Return unit directions (N, 3) at one elevation, the first towards the sun's azimuth of 0.5 rad."""
    return np.stack([sun_direction(np.deg2rad(elevation_deg), 0.5 + a) for a in np.linspace(0, np.pi, count)])


@pytest.mark.parametrize("depth", [0.2, 0.9])
def test_a_sun_at_30_deg_shines_through_twice_the_dust_of_one_at_zenith(depth):
    low, high, clear = light(30.0, depth), light(90.0, 2 * depth), light(90.0, 0.0)
    np.testing.assert_allclose(low.sunlight, high.sunlight, rtol=1e-5)
    np.testing.assert_allclose(light(90.0, depth).sunlight ** 2, high.sunlight, rtol=1e-5)  # Beer and Lambert
    np.testing.assert_array_equal(clear.sunlight, 1)
    assert low.skylight / 0.5**SKY_FALL == pytest.approx(high.skylight, rel=1e-5) and clear.skylight == 0


def test_without_dust_the_sky_is_the_same_all_around_and_dust_makes_a_halo():
    directions = ring(25.0)
    spread = []
    for depth in (0.0, 0.5, 1.0):
        sky = skies(directions, light(30.0, 0.5)._replace(optical_depth=depth))
        spread.append(np.ptp(sky, axis=0))
        assert (np.diff(sky, axis=0) <= 1e-6).all()
    np.testing.assert_allclose(spread[0], 0, atol=1e-6)
    np.testing.assert_allclose(spread[2], 2 * spread[1], rtol=1e-5)
    assert (spread[1] > 0.05).all()


def test_dust_brightens_the_sky_away_from_the_sun_too():
    away = -light(30.0, 0.5).sun * [1, 1, -1]
    dark, bright = (skies(away[None], light(30.0, 0.5)._replace(optical_depth=depth)) for depth in (0.0, 1.0))
    assert (bright > 1.3 * dark).all()


@pytest.mark.parametrize(
    ("elevations", "depths", "least", "most"),
    [((15, 40, 70), (0.3, 0.6, 1.0), 1.1, 1.9), ((20, 40, 70), (3.0,), 2.2, 2.6), ((20, 40, 70), (12.0,), 6.9, 7.8)],
)
def test_the_sky_in_view_is_brighter_than_its_light_on_level_ground(elevations, depths, least, most):
    """As docs/results/scene.md says; the radiance of a sky of one brightness would be that of its light."""
    up, around = np.meshgrid((np.arange(60) + 0.5) / 60, (np.arange(120) + 0.5) * np.pi / 60)
    across = np.sqrt(1 - up**2)
    directions = np.stack([across * np.cos(around), across * np.sin(around), up], axis=-1).reshape(-1, 3)
    for elevation in elevations:
        for depth in depths:
            lit = light(elevation, depth)
            seen = 2 * (skies(directions, lit) * directions[:, 2:]).mean(axis=0)
            assert least < seen.mean() / (lit.skylight * np.mean(SKY_COLOUR)) < most
