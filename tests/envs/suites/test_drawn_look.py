import numpy as np
import pytest

from envs.suites.drawn_look import look_values, same_look
from marssim.scene.look import LookConfig, draw_look


def test_a_record_has_every_value_of_the_look():
    fixed = LookConfig(sun_elevation_deg=(12, 12), sun_azimuth_deg=(-90, -90), gravel_size=(0.02, 0.02))
    values = look_values(draw_look(fixed, np.random.default_rng(0)))
    assert values.keys() == {*vars(fixed), "texture_seed"}
    assert (values["sun_elevation_deg"], values["sun_azimuth_deg"], values["gravel_size"]) == (12, 270, 0.02)
    assert fixed.optical_depth[0] <= values["optical_depth"] <= fixed.optical_depth[1]


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({}, True),
        ({"sun_azimuth_deg": 359.9999}, True),
        ({"optical_depth": 0.501}, False),
        ({"texture_seed": 4}, False),
    ],
)
def test_looks_are_the_same_up_to_rounding(changes, same):
    look = {"sun_azimuth_deg": 0.0, "optical_depth": 0.5, "texture_seed": 3}
    assert same_look(look, {**look, **changes}) == same


def test_looks_of_other_values_differ():
    look = {"sun_azimuth_deg": 0.0}
    assert not same_look(look, {**look, "drifts": 0.0})
