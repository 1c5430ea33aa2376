import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from marssim.physics.kinematics import KinematicRover, collides, settle
from marssim.physics.slipping_rover import SlippingRover
from marssim.physics.state import Contacts
from marssim.physics.support import SupportMap
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene


@settings(max_examples=25, deadline=None)
@given(slope=st.floats(0, 20), azimuth=st.floats(-3, 3), yaw=st.floats(-3, 3))
def test_on_a_plane_the_rover_stands_square(slope, azimuth, yaw):
    gradient = np.tan(np.deg2rad(slope)) * np.array([np.cos(azimuth), np.sin(azimuth)])
    grid = np.arange(-60, 61) * 0.05
    x, y = np.meshgrid(grid, grid)
    height = gradient[0] * x + gradient[1] * y
    clear = np.zeros(height.shape, bool)
    support = SupportMap(height, height, height, clear, -3.0, -3.0, 0.05)
    settled = settle(support, ZHURONG, 0.3, -0.2, yaw)
    normal = np.array([-gradient[0], -gradient[1], 1.0]) / np.sqrt(1 + gradient @ gradient)
    # the wheel cylinders do not roll with the body here: on side slopes they stand on an edge, alike on all wheels
    assert np.rad2deg(np.arccos(np.clip(settled.pose[:3, 2] @ normal, -1, 1))) < 0.5
    drop = settled.pose[2, 3] - gradient @ (0.3, -0.2)
    across = abs(gradient @ (-np.sin(yaw), np.cos(yaw)))
    assert -0.005 < drop < across * ZHURONG.wheel_width / 2 + 0.005
    assert settled.residual < 1e-3 and not settled.belly_contact


def test_one_wheel_on_a_block(make_scene):
    def block(x, y):
        return 0.15 * ((np.abs(x - 0.65) < 0.12) & (np.abs(y - 0.6) < 0.15))

    settled = settle(make_scene(block, cell=0.02, half=2.0), ZHURONG, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(settled.wheel_heights - ZHURONG.wheel_radius, [0.15, 0, 0, 0, 0, 0], atol=2e-3)
    assert settled.pitch == pytest.approx(-0.15 / 0.975 / 2, abs=0.01)  # the mean of two rockers, nose up
    assert settled.roll == pytest.approx(0.05 / 1.2, abs=0.01)  # a side's height is the mean of its wheels


def test_a_place_outside_the_scene_is_refused(make_scene):
    with pytest.raises(ValueError, match="outside"):
        settle(make_scene(), ZHURONG, 5.0, 0.0, 0.0)


def test_collision_is_of_the_oriented_wheels_and_chassis(make_scene):
    scene = make_scene(balls=[(1.0, 0.0, 0.3, 0.3)])
    support = SupportMap.from_scene(scene, ZHURONG.obstacle_height)
    assert collides(support, ZHURONG, 0.0, 0.0, 0.0) == Contacts()  # between the front wheels, ahead of the chassis
    assert collides(support, ZHURONG, 0.3, 0.0, 0.0) == Contacts(chassis=True)
    assert collides(support, ZHURONG, 0.0, -0.6, 0.0) == Contacts(obstacle=True)  # the left front wheel
    assert collides(support, ZHURONG, 1.0, 0.0, 1.5) == Contacts(chassis=True)  # under its middle, whatever the heading
    assert collides(support, ZHURONG, 1.0, 0.3, 0.0) == Contacts(chassis=True, obstacle=True)  # right middle wheel too
    assert collides(support, ZHURONG, -0.9, 0.0, 0.0) == Contacts()


def test_a_drive_ends_at_the_rock_and_can_go_back(make_scene):
    rover = KinematicRover(make_scene(balls=[(2.0, 0.6, 0.3, 0.3)]), ZHURONG, 0.0, 0.0, 0.0)
    state = rover.drive_twist(0.2, 0.0, 10.0)
    assert rover.contacts().obstacle and rover.contacts().collision
    assert state.position[0] == pytest.approx(2.0 - 0.3 - 0.8, abs=0.08) and state.velocity[0] == 0
    assert rover.drive_twist(-0.2, 0.0, 2.0).position[0] == pytest.approx(state.position[0] - 0.4, abs=1e-6)
    assert not rover.contacts().collision


@pytest.mark.parametrize(("seconds", "expected"), [(1.5, 0.2), (1.6, 0.0), (1.9, 0.0), (2.0, 0.0), (2.4, 0.0)])
def test_a_belly_stop_is_a_stop_in_whichever_substep(make_scene, seconds, expected):
    """The chassis, half 1.1 m long, comes to a ridge at x = 0.86 m between 1.5 and 1.6 s: the first look there is at
    the end, or half a second later."""
    ridge = make_scene(lambda x, y: 0.5 * ((x > 0.85) & (np.abs(y) < 0.3)), cell=0.02, half=2.0)
    rover = KinematicRover(ridge, ZHURONG, 0.0, 0.0, 0.0)
    state = rover.drive_twist(0.2, 0.0, seconds)
    assert state.velocity[0] == expected and rover.contacts() == Contacts(chassis=expected == 0)


@pytest.mark.parametrize("seconds", [0.05, 0.9, 1.8, 2.0])
def test_a_free_drive_of_any_length_ends_moving(seconds):
    """0.9 s and 1.8 s times n over n, in n substeps, are a little less than they were."""
    level = np.zeros((121, 121))
    rover = KinematicRover(None, ZHURONG, 0.0, 0.0, 0.0, SupportMap(level, level, level, level > 0, -3.0, -3.0, 0.05))
    assert rover.drive_twist(0.2, 0.1, seconds).velocity[0] == 0.2 and rover.state().yaw_rate == 0.1


@settings(max_examples=20, deadline=None)
@given(speed=st.floats(-0.2, 0.2), yaw_rate=st.floats(-0.25, 0.25), seconds=st.floats(0.1, 4))
def test_arcs_are_exact_on_level_ground(speed, yaw_rate, seconds):
    level = np.zeros((121, 121))
    support = SupportMap(level, level, level, level > 0, -3.0, -3.0, 0.05)
    rover = KinematicRover(None, ZHURONG, 0.0, 0.0, 0.5, support)
    state = rover.drive_twist(speed, yaw_rate, seconds)
    t = np.linspace(0, seconds, 4001)
    heading = 0.5 + yaw_rate * t
    path = np.trapezoid(speed * np.stack([np.cos(heading), np.sin(heading)]), t, axis=1)
    np.testing.assert_allclose(state.position[:2], path, atol=1e-5)
    assert state.yaw == pytest.approx(0.5 + yaw_rate * seconds, abs=1e-9)
    assert state.position[2] == pytest.approx(0, abs=1e-3)


def test_on_rough_ground_every_wheel_stands_on_something():
    scene = build_scene(preset("gale", size=12.0, cell=0.1, horizon=12.0), np.random.default_rng(2))
    support = SupportMap.from_scene(scene, ZHURONG.obstacle_height)
    rng = np.random.default_rng(3)
    places = [settle(support, ZHURONG, *rng.uniform(-4, 4, 2), rng.uniform(-3, 3)) for _ in range(60)]
    assert np.median([place.residual for place in places]) < 1e-3
    assert np.median([place.clearance for place in places]) > 0.15


@pytest.mark.parametrize("kind", [KinematicRover, SlippingRover])
@pytest.mark.parametrize(
    "drive", [(np.nan, 0.0, 2.0), (0.1, np.inf, 2.0), (0.1, 0.0, np.nan), (0.1, 0.0, -2.0), (0.0, 0.0, 2.0, np.nan)]
)
def test_drives_that_are_not_finite_or_take_negative_time_are_refused(make_scene, kind, drive):
    rover = kind(make_scene(half=3.0), ZHURONG, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"^drive_twist needs finite speeds and a finite time of 0 or more"):
        rover.drive_twist(*drive)
    np.testing.assert_array_equal(rover.state().position[:2], 0)
    assert np.isfinite(rover.joints().spin).all()


def test_a_heading_that_is_not_finite_is_refused(make_scene):
    with pytest.raises(ValueError, match=r"^yaw must be finite"):
        KinematicRover(make_scene(half=3.0), ZHURONG, 0.0, 0.0, np.nan)
