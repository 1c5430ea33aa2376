import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG
from marssim.physics.soil.balance import balanced_motion
from marssim.physics.soil.loads import CENTRE_OF_MASS, wheel_loads
from marssim.physics.soil.soils import SOIL_NAMES
from marssim.physics.soil.tables import wheel_table
from marssim.physics.world import GRAVITY

HUBS = np.ascontiguousarray(ZHURONG.wheel_positions[:, :2])
WEIGHT = ZHURONG.mass * GRAVITY
AHEAD = np.tile([0.2, 0.0], (6, 1))


def grip(soil, load=WEIGHT / 6, side=1.0):
    pull = table(soil).at(np.full(6, load))[0]
    return np.maximum.accumulate(pull - pull[:, :1], axis=1), np.full(6, side), np.maximum(-pull[:, 0], 0)


def table(soil):
    return wheel_table(soil, ZHURONG.wheel_radius, ZHURONG.wheel_width, WEIGHT)


def motion_under(push, rims=AHEAD, soil="sand", side=1.0):
    grip_of = grip(soil, side=side)
    return balanced_motion(HUBS, rims, *grip_of, np.asarray(push, float), np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("side", [1.0, 1.4])
@pytest.mark.parametrize("soil", SOIL_NAMES)
@pytest.mark.parametrize("push", [(0, 0, 0), (-150, 0, 0), (120, 30, 0), (-60, -110, 40)])
def test_the_forces_of_the_soil_balance_the_push(soil, push, side):
    rims = AHEAD @ np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    _, _, force = motion_under(push, rims, soil, side)
    moment = HUBS[:, 0] * force[:, 1] - HUBS[:, 1] * force[:, 0]
    np.testing.assert_allclose([*force.sum(axis=0), moment.sum()], -np.array(push, float), atol=0.05)


def test_a_push_from_behind_loses_way_as_the_table_says():
    """The six wheels are alike, so each bears a sixth, at the slip where its drawbar pull is that."""
    pull, slips = table("sand").at(np.array([WEIGHT / 6]))[0][0], table("sand").slips
    for push in (0.0, -60.0, -150.0):
        motion, slip, _ = motion_under((push, 0, 0))
        assert 1 - motion[0] / 0.2 == pytest.approx(np.interp(-push / 6, pull, slips), abs=1e-3)
        np.testing.assert_allclose(slip, 1 - motion[0] / 0.2, atol=1e-4)
        assert abs(motion[1]) < 1e-9 and abs(motion[2]) < 1e-9


def test_a_push_from_the_side_slides_the_rover_and_costs_it_little_way():
    motion, _, _ = motion_under((0, -150, 0))
    assert -0.1 < motion[1] < -0.02 and 0.17 < motion[0] < 0.2
    mirrored, _, _ = motion_under((0, 150, 0))
    np.testing.assert_allclose(mirrored * (1, -1, -1), motion, atol=1e-6)


def test_a_soil_that_holds_more_across_holds_a_push_from_the_side_by_that_factor():
    """The slide that a push of 150 N gives is that of 150 N times the factor, in any heading of the wheels."""
    for angle in (0.0, 0.7):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        left = np.array([0.0, 1.0]) @ turn
        plain = motion_under((*-100 * left, 0), AHEAD @ turn)[0]
        held = motion_under((*-140 * left, 0), AHEAD @ turn, side=1.4)[0]
        np.testing.assert_allclose(held, plain, atol=1e-6)


def test_what_soil_holds_across_matters_to_no_wheel_that_drives_straight():
    np.testing.assert_allclose(motion_under((-150, 0, 0), side=1.4)[0], motion_under((-150, 0, 0))[0], atol=1e-9)


def test_a_rover_slides_back_where_the_soil_cannot_hold_it():
    motion, slip, _ = motion_under((-600, 0, 0))
    assert motion[0] < 0 and (slip > 1).all()


def test_braked_wheels_hold_the_rover_on_a_slope():
    motion, _, _ = motion_under((-150, 0, 0), rims=np.zeros((6, 2)))
    assert -0.01 < motion[0] < 0


def test_wheels_on_rock_pull_those_in_sand_along():
    sand, rock = grip("sand"), grip("bedrock")
    pull, side, resistance = (part.copy() for part in sand)
    pull[:2], resistance[:2] = rock[0][:2], rock[2][:2]
    push = np.array([-200.0, 0.0, 0.0])
    mixed = balanced_motion(HUBS, AHEAD, pull, side, resistance, push, np.zeros(3), np.zeros(3))[0]
    assert motion_under(push)[0][0] < mixed[0] < motion_under(push, soil="bedrock")[0][0]
    left = pull.copy(), side, resistance.copy()
    left[0][1], left[2][1] = sand[0][1], sand[2][1]  # only the left front wheel stands on rock: the rover turns right
    assert balanced_motion(HUBS, AHEAD, *left, push, np.zeros(3), np.zeros(3))[0][2] < -1e-3


def test_inertia_keeps_the_motion_for_a_short_time():
    heavy = np.array([1e9, 1e9, 1e9])
    start = np.array([0.05, 0.01, 0.02])
    np.testing.assert_allclose(
        balanced_motion(HUBS, AHEAD, *grip("sand"), np.zeros(3), heavy, start)[0], start, atol=1e-4
    )


def test_loads_add_up_to_the_weight_and_move_downhill():
    level = wheel_loads(ZHURONG, np.array([0.0, 0.0, -WEIGHT]))
    np.testing.assert_allclose(level, WEIGHT / 6)
    up = wheel_loads(ZHURONG, WEIGHT * np.array([-np.sin(0.3), 0.0, -np.cos(0.3)]))
    assert up.sum() == pytest.approx(WEIGHT * np.cos(0.3)) and up[4] > up[0]
    right_down = wheel_loads(ZHURONG, WEIGHT * np.array([0.0, -np.sin(0.2), -np.cos(0.2)]))
    assert (right_down[1::2] > right_down[::2]).all()
    assert (wheel_loads(ZHURONG, WEIGHT * np.array([-0.99, 0.0, -0.1])) > 0).all()


@pytest.mark.parametrize("tilt", [(0.1, 0.0), (0.0, -0.15), (-0.08, 0.12)])
def test_the_moments_of_the_loads_balance_that_of_the_weight(tilt):
    """About the point on the ground below the body's origin, which the wheels stand around."""
    weight = WEIGHT * np.array([*np.sin(tilt), -np.sqrt(1 - np.sum(np.sin(tilt) ** 2))])
    loads = wheel_loads(ZHURONG, weight)
    np.testing.assert_allclose(loads @ HUBS, CENTRE_OF_MASS * weight[:2], rtol=1e-9, atol=1e-9)
