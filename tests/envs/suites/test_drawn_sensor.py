import numpy as np
import pytest

from envs.suites.drawn_sensor import draw_sensor, same_sensor, sensor_values
from envs.world.eyes import EyesConfig
from marssim.render.sensor import Sensor, SensorConfig


def test_an_environment_draws_the_sensor_of_its_seed(make_env):
    """The record is made without an environment: both must draw the same."""
    eyes = EyesConfig(lens_dust=0.4, temperature=50.0)
    env = make_env(eyes=eyes)
    env.reset(seed=11, options={"scene_seed": 11})
    assert env.perception.sensor == draw_sensor(eyes, 11) != draw_sensor(eyes, 12)


def test_values_are_those_that_are_present():
    sensor = Sensor.draw(SensorConfig(dust=(0.2, 0.2)), np.random.default_rng(0))
    values = sensor_values(sensor)
    assert values["dust"] == 0.2 and values["seed"] == sensor.seed
    assert values["psf"] == pytest.approx(sensor.psf, rel=1e-5)
    assert not values.keys() & {"glare", "jpeg_quality", "fault_chance", "motion_direction_deg"}


@pytest.mark.parametrize(
    ("name", "value", "same"),
    [("psf", 0.4 * 1.00001, True), ("psf", 0.401, False), ("seed", 6, False), ("dust", 0.1, False)],
)
def test_records_of_one_sensor_are_the_same_but_for_rounding(name, value, same):
    one = {"psf": 0.4, "read_noise": 7.0, "seed": 5}
    assert same_sensor(one, {**one, name: value}) is same and same_sensor(one, one)


def test_seeds_that_differ_by_one_are_two_sensors():
    one = {"psf": 0.4, "seed": 4_000_000_000}
    assert not same_sensor(one, {**one, "seed": 4_000_000_001})
