import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.scene.look import LookConfig, draw_look


@given(
    elevation=st.tuples(st.floats(0.1, 90), st.floats(0.1, 90)).map(sorted),
    azimuth=st.tuples(st.floats(-360, 720), st.floats(-360, 720)).map(sorted),
    seed=st.integers(0, 100),
)
def test_the_sun_stands_where_it_was_asked_to(elevation, azimuth, seed):
    config = LookConfig(sun_elevation_deg=tuple(elevation), sun_azimuth_deg=tuple(azimuth))
    look = draw_look(config, np.random.default_rng(seed))
    assert np.linalg.norm(look.sun) == pytest.approx(1)
    assert elevation[0] - 1e-5 <= np.rad2deg(look.sun_elevation) <= elevation[1] + 1e-5
    if elevation[1] < 89:
        turn = (np.rad2deg(np.arctan2(look.sun[1], look.sun[0])) - azimuth[0]) % 360
        assert turn <= azimuth[1] - azimuth[0] + 1e-5 or turn >= 360 - 1e-5
    assert 0.3 <= look.optical_depth <= 1.0 and 0.3 <= look.albedo_contrast <= 1.3


def test_a_range_of_one_value_is_that_value():
    config = LookConfig(optical_depth=(0.5, 0.5), texture_strength=(1.0, 1.0))
    look = draw_look(config, np.random.default_rng(0))
    assert look.optical_depth == 0.5 and look.texture_strength == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sun_elevation_deg", (0.0, 30.0)),
        ("sun_elevation_deg", (50.0, 95.0)),
        ("sun_elevation_deg", (60.0, 30.0)),
        ("optical_depth", (1.0, 0.5)),
        ("albedo_contrast", (float("nan"), 1.0)),
        ("albedo_contrast", (-0.5, 1.0)),
        ("optical_depth", (-1.0, 1.0)),
        ("optical_depth", (0.0, float("inf"))),
        ("sun_azimuth_deg", (0.0, float("inf"))),
        ("texture_strength", (0.0, float("inf"))),
    ],
)
def test_impossible_ranges_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        LookConfig(**{name: value})
