import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG, RoverSpec
from nav.controller import crab, point_turn, steerable, tightest_radius, wheel_command

HUBS = ZHURONG.wheel_positions[:, :2]
speeds = st.floats(-0.3, 0.3)
rates = st.floats(-0.4, 0.4)


def hub_velocities(command):
    """(6, 2) velocity at which each wheel rolls, from its angle and speed alone."""
    direction = np.stack([np.cos(command.angles), np.sin(command.angles)], axis=1)
    return direction * (command.speeds * ZHURONG.wheel_radius)[:, None]


@given(speeds, rates)
def test_all_wheels_roll_along_one_rigid_motion(speed, yaw_rate):
    command = wheel_command(*steerable(speed, yaw_rate))
    v = hub_velocities(command)
    # The rigid motion that fits best, found by least squares from the wheels; it must fit exactly.
    rows = np.concatenate(
        [np.stack([np.ones(6), 0 * HUBS[:, 0], -HUBS[:, 1]], 1), np.stack([np.zeros(6), np.ones(6), HUBS[:, 0]], 1)]
    )
    motion, *_ = np.linalg.lstsq(rows, np.concatenate([v[:, 0], v[:, 1]]), rcond=None)
    np.testing.assert_allclose(rows @ motion, np.concatenate([v[:, 0], v[:, 1]]), atol=1e-9)
    # Each hub's velocity is perpendicular to the axle.
    axle = np.stack([-np.sin(command.angles), np.cos(command.angles)], axis=1)
    hub = motion[:2] + motion[2] * np.stack([-HUBS[:, 1], HUBS[:, 0]], axis=1)
    np.testing.assert_allclose((hub * axle).sum(1), 0, atol=1e-9)
    assert abs(motion[1]) < 1e-9


@given(speeds, rates)
def test_limits_hold_for_any_wish(speed, yaw_rate):
    v, w = steerable(speed, yaw_rate)
    assert abs(v) <= ZHURONG.max_speed + 1e-9 and abs(w) <= ZHURONG.max_yaw_rate + 1e-9
    command = wheel_command(v, w)
    assert np.abs(command.angles).max() <= ZHURONG.max_steer + 1e-9
    assert np.abs(command.speeds).max() <= ZHURONG.max_wheel_speed + 1e-9


@given(st.floats(-0.2, 0.2), st.floats(-0.25, 0.25))
def test_steerable_leaves_feasible_motions_alone(speed, yaw_rate):
    assume(abs(speed) >= 0.9 * abs(yaw_rate))
    assert steerable(speed, yaw_rate) == (speed, yaw_rate)


@given(st.floats(0.3, 1.2), st.floats(0.6, 2.0), st.floats(0.7, 1.3))
def test_the_tightest_curve_turns_one_wheel_as_far_as_it_goes(axle, track, max_steer):
    spec = RoverSpec(wheel_x=(axle, 0.0, -axle), track=track, max_steer=max_steer)
    radius = tightest_radius(spec)
    assert np.abs(wheel_command(0.05, 0.05 / radius, spec).angles).max() == pytest.approx(max_steer)
    for side in (1, -1):
        speed, yaw_rate = steerable(0.05, side * 0.05 / (0.95 * radius), spec)
        assert speed / yaw_rate == pytest.approx(side * radius)
        assert steerable(0.05, side * 0.05 / (1.05 * radius), spec) == (0.05, side * 0.05 / (1.05 * radius))


def test_straight_turn_and_crab():
    straight = wheel_command(0.15, 0.0)
    np.testing.assert_allclose(straight.angles, 0)
    np.testing.assert_allclose(straight.speeds, 1.0)
    turn = hub_velocities(point_turn(0.2))
    np.testing.assert_allclose(turn, 0.2 * np.stack([-HUBS[:, 1], HUBS[:, 0]], 1), atol=1e-12)
    sideways = crab(0.1, np.deg2rad(30))
    np.testing.assert_allclose(sideways.angles, np.deg2rad(30))
    np.testing.assert_allclose(hub_velocities(crab(0.1, np.deg2rad(150))), 0.1 * np.array([[-np.sqrt(3) / 2, 0.5]] * 6))


def test_without_motion_wheels_stand_straight_and_at_rest():
    command = wheel_command(0.0, 0.0)
    assert not command.angles.any() and not command.speeds.any()


def test_impossible_motions_are_refused():
    with pytest.raises(ValueError, match="steering"):
        crab(0.1, np.deg2rad(85))
    with pytest.raises(ValueError, match="steering"):
        wheel_command(0.1, 0.1 / 0.6)
    with pytest.raises(ValueError, match="finite"):
        wheel_command(np.nan, 0.0)


def test_a_turn_about_a_place_just_inside_a_wheel_becomes_a_tighter_turn():
    speed, yaw_rate = steerable(0.1, 0.2)
    assert yaw_rate == 0.2 and 0 < speed < 0.1
