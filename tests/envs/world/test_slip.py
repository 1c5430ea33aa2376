from types import SimpleNamespace

import numpy as np
import pytest

from envs.world.slip import SlipConfig, SlipGauge, checked_slip
from marssim.physics.soil.slippage import Slippage

AHEAD = np.array([1, 0], np.float32)
KEYS = {"slip", "sideways", "sinkage", "energy", "drive_seconds"}


@pytest.fixture
def hill(make_scene, make_course):
    """A course that leads up 10 deg."""
    rise = np.tan(np.deg2rad(10))
    return make_course(make_scene(lambda x, y: rise * x))


def drive(env, steps=4):
    """Return the info of every step, the true places (n, 2) and those that the rover believes."""
    infos, places, believed = [], [], []
    for _ in range(steps):
        infos.append(env.step(AHEAD)[4])
        places.append(env.vehicle.state().position[:2])
        believed.append(env.believed_pose[:2, 3])
    return infos, np.array(places), np.array(believed)


def test_without_slip_the_info_and_the_belief_are_as_ever(on_course, hill):
    infos, places, believed = drive(on_course(hill))
    assert not KEYS & infos[-1].keys()
    np.testing.assert_array_equal(places, believed)


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_the_odometrys_error_is_the_slip_that_was_not_measured(on_course, hill, dynamics):
    """Uphill, along x: the wheels' way in plan less the true way."""
    errors = {}
    for measured in (0.0, 0.6, 1.0):
        infos, places, believed = drive(on_course(hill, slip=SlipConfig("sand", measured), dynamics=dynamics))
        errors[measured] = (believed - places)[-1, 0]
        assert infos[-1]["position_error"] == pytest.approx(abs(errors[measured]), abs=1e-3)
    way = places[-1, 0] + 3.0
    slip = np.mean([info["slip"] for info in infos])
    assert errors[1.0] == pytest.approx(0, abs=1e-9) and errors[0.6] == pytest.approx(0.4 * errors[0.0], rel=1e-6)
    assert errors[0.0] == pytest.approx(way * slip / (1 - slip), rel=0.05)


def test_sand_costs_more_way_energy_and_time_than_bedrock(on_course, hill):
    (sand, far), (rock, farther) = (drive(on_course(hill, slip=soil))[:2] for soil in ("sand", "bedrock"))
    assert far[-1, 0] < farther[-1, 0] - 0.2
    per_metre = [info[-1]["energy"] / (way[-1, 0] + 3.0) for info, way in ((sand, far), (rock, farther))]
    assert per_metre[0] > 1.5 * per_metre[1]
    assert sand[-1]["drive_seconds"] == pytest.approx(8.0) and 0.01 < sand[-1]["sinkage"] < 0.03
    assert rock[-1]["slip"] < 0.02 and sand[-1]["slip"] > 0.1


def test_energy_and_time_are_counted_from_the_start_of_each_episode(on_course, hill):
    env = on_course(hill, slip="sand")
    first = [info["energy"] for info in drive(env)[0]]
    assert (np.diff(first) > 0).all()
    _, info = env.reset(seed=0)
    assert {name: info[name] for name in KEYS} == dict.fromkeys(KEYS, 0.0)
    assert [info["energy"] for info in drive(env)[0]] == first


def test_a_rover_that_does_not_get_up_is_stuck(on_course, make_scene, make_course):
    steep = np.tan(np.deg2rad(21))
    env = on_course(make_course(make_scene(lambda x, y: steep * x)), slip="sand")
    outcomes = []
    while not outcomes or outcomes[-1] == "driving":
        outcomes.append(env.step(AHEAD)[4]["outcome"])
    assert outcomes[-1] == "stuck"


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_slip_draws_nothing_and_is_a_function_of_the_seed(make_env, dynamics):
    """The course of a seed, and its noise, are those without slip; a seed is an episode."""
    settings = {"drift": 0.02, "yaw_drift_deg": 1.0, "disparity_noise": 0.3, "dynamics": dynamics}
    plain, slipping = make_env(**settings), make_env(slip="scene", **settings)
    first, second = plain.reset(seed=4)[0], slipping.reset(seed=4)[0]
    np.testing.assert_allclose(second["goal"], first["goal"], atol=0.02)  # it may come to rest some mm apart
    np.testing.assert_array_equal(plain.course.start, slipping.course.start)
    np.testing.assert_array_equal(plain.course.scene.bodies.centre, slipping.course.scene.bodies.centre)
    assert plain.np_random.bit_generator.state == slipping.np_random.bit_generator.state
    drives = []
    for _ in range(2):
        slipping.reset(seed=4)
        infos, places, believed = drive(slipping, 1)
        drives.append((infos[-1]["slip"], infos[-1]["energy"], places, believed))
    assert drives[0][:2] == drives[1][:2]
    np.testing.assert_array_equal(drives[0][2:], drives[1][2:])
    assert slipping.reset()[1]["energy"] == 0.0


def test_settings_are_checked():
    assert checked_slip(None) is None and checked_slip("crust") == SlipConfig("crust", 0.0)
    with pytest.raises(ValueError, match="slip 'mud' is unknown; choose from scene, sand, crust, bedrock"):
        checked_slip("mud")
    for share in (-0.1, 1.1, True, "half", float("nan")):
        with pytest.raises(ValueError, match=r"measured share of the slip must lie in \[0, 1\]"):
            SlipConfig("sand", share)


class Sliding:
    """A rover that stands while its wheels roll 0.4 m to its left."""

    def state(self):
        return SimpleNamespace(position=np.zeros(3))

    def slippage(self):
        return Slippage(rolled=np.array([0.0, 0.4]))


def test_the_excess_speed_is_that_of_the_wheels_along_the_heading():
    gauge = SlipGauge(SlipConfig("sand"), Sliding(), True)
    gauge.update(Sliding())
    assert gauge.excess_speed(np.pi / 2, 2.0) == pytest.approx(0.2)
    assert gauge.excess_speed(0.0, 2.0) == pytest.approx(0.0)
