"""The rover's figures: friction of wheels on ground 0.9, gravity of Mars."""

import numpy as np
import pytest

p = pytest.importorskip("pybullet")

from marssim.physics.kinematics import settle  # noqa: E402
from marssim.physics.linkage import WHEELS, Linkage  # noqa: E402
from marssim.physics.rover import Rover  # noqa: E402
from marssim.physics.world import PhysicsWorld  # noqa: E402
from marssim.rover_spec import ZHURONG  # noqa: E402

STRAIGHT = np.zeros(6)
HUBS = ZHURONG.wheel_positions


def roll(speed):
    return np.full(6, speed / ZHURONG.wheel_radius)


def slope(degrees, azimuth=0.0):
    rise = np.tan(np.deg2rad(degrees))
    return lambda x, y: rise * (np.cos(azimuth) * x + np.sin(azimuth) * y)


def test_weighs_what_the_specification_says_and_draws_where_it_is(make_scene):
    with PhysicsWorld(make_scene(slope(8.0, 0.7))) as world:
        rover = Rover(world, 0.5, -0.3, 1.0)
        links = range(-1, p.getNumJoints(rover._body, physicsClientId=world.client))
        masses = [p.getDynamicsInfo(rover._body, link, physicsClientId=world.client)[0] for link in links]
        assert sum(masses) == pytest.approx(ZHURONG.mass)
        poses = Linkage.of(ZHURONG).link_poses(rover.state().pose, rover.joints())
        for name, link in zip(WHEELS, rover._wheels):
            state = p.getLinkState(rover._body, link, computeForwardKinematics=1, physicsClientId=world.client)
            np.testing.assert_allclose(poses[f"wheel_{name}"][:3, 3], state[4], atol=2e-3)
        for part in rover.mesh(pan=0.4):
            assert part.faces.max() < len(part.vertices) and np.isfinite(part.pose).all()


def test_drives_two_metres_straight(make_scene):
    with PhysicsWorld(make_scene()) as world:
        rover = Rover(world, -1.0, 0.0, 0.0)
        start = rover.state()
        rover.drive(roll(0.2), STRAIGHT)
        world.step(10.0)
        state = rover.state()
        assert np.linalg.norm(state.position - start.position) == pytest.approx(2.0, rel=0.05)
        assert abs(state.position[1]) < 0.02 and abs(state.yaw) < np.deg2rad(0.5)
        assert state.velocity[0] == pytest.approx(0.2, rel=0.1)
        assert not rover.contacts().collision


def test_turns_on_the_spot(make_scene):
    rate = 0.25
    vx, vy = -rate * HUBS[:, 1], rate * HUBS[:, 0]
    side = np.where(vx >= 0, 1.0, -1.0)
    with PhysicsWorld(make_scene()) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        rover.drive(side * np.hypot(vx, vy) / ZHURONG.wheel_radius, np.arctan2(vy * side, vx * side))
        world.step(np.pi / 2 / rate + 0.7)  # steering comes first
        state = rover.state()
        assert state.yaw == pytest.approx(np.pi / 2, abs=np.deg2rad(8)) and state.yaw_rate == pytest.approx(
            rate, rel=0.1
        )
        assert np.linalg.norm(state.position[:2]) < 0.05


@pytest.mark.parametrize("azimuth", [0.0, np.pi / 2])
def test_parks_on_15_degrees(make_scene, azimuth):
    with PhysicsWorld(make_scene(slope(15.0, azimuth))) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        world.step(0.5)
        start = rover.state()
        assert np.rad2deg(start.tilt) == pytest.approx(15.0, abs=0.5)
        world.step(60.0)
        state = rover.state()
        assert np.linalg.norm(state.position - start.position) < 0.005
        assert abs(state.yaw - start.yaw) < np.deg2rad(0.2)


def test_slides_where_friction_ends(make_scene):
    with PhysicsWorld(make_scene(slope(np.rad2deg(np.arctan(0.9)) + 3.0, np.pi))) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        start = rover.state()
        world.step(2.0)
        assert np.linalg.norm(rover.state().position - start.position) > 0.05


def test_climbs_a_step_of_20_cm_but_not_of_60(make_scene):
    reached = []
    for height in (0.2, 0.6):
        with PhysicsWorld(make_scene(lambda x, y, h=height: h * (x > 0.7), cell=0.03, half=2.4)) as world:
            rover = Rover(world, -0.3, 0.0, 0.0)
            rover.drive(roll(0.2), STRAIGHT)
            for _ in range(13 if height < 0.5 else 5):
                world.step(1.0)
                if rover.state().position[0] > 1.45:  # the rear wheels are up
                    break
            reached.append(rover.state().position)
    assert reached[0][0] > 1.45 and reached[0][2] == pytest.approx(0.2, abs=0.03)
    assert reached[1][0] < 0.7


def test_a_rover_outside_is_refused_and_leaves_nothing_behind(make_scene):
    with PhysicsWorld(make_scene(half=2.0)) as world:
        bodies = world.bullet.getNumBodies(physicsClientId=world.client)
        with pytest.raises(ValueError, match="outside"):
            Rover(world, 3.0, 0.0, 0.0)
        assert world.bullet.getNumBodies(physicsClientId=world.client) == bodies
        world.step(0.1)


def test_a_wheel_feels_the_obstacle(make_scene):
    scene = make_scene(balls=[(0.6, -0.6, 0.05, 0.15), (1.5, 0.6, 0.2, 0.4)])  # one to climb on the way
    with PhysicsWorld(scene) as world:
        rover = Rover(world, -0.6, 0.0, 0.0)
        rover.drive(roll(0.2), STRAIGHT)
        world.step(3.0)
        assert not rover.contacts().collision
        world.step(4.0)
        contacts = rover.contacts()
        assert contacts.obstacle and contacts.collision


def test_rests_where_kinematics_says_and_repeats_itself(make_scene):
    scene = make_scene(lambda x, y: 0.08 * np.sin(2 * x) * np.cos(1.5 * y), balls=[(0.7, 0.6, -0.02, 0.15)])
    ends = []
    for _ in range(2):
        with PhysicsWorld(scene) as world:
            rover = Rover(world, 0.0, 0.0, 0.2)
            place, state = settle(world.support, ZHURONG, 0.0, 0.0, 0.2), rover.state()
            assert abs(state.roll - place.roll) < np.deg2rad(2) and abs(state.pitch - place.pitch) < np.deg2rad(2)
            assert abs(state.position[2] - place.pose[2, 3]) < 0.03
            rover.drive(roll(0.2), np.deg2rad([10, 10, 0, 0, -10, -10]))
            world.step(2.0)
            ends.append(rover.state().pose)
    np.testing.assert_array_equal(ends[0], ends[1])


def test_bad_commands_are_refused(make_scene):
    with PhysicsWorld(make_scene(half=2.0)) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        with pytest.raises(ValueError, match="6 finite"):
            rover.drive(np.zeros(5), STRAIGHT)
        with pytest.raises(ValueError, match="6 finite"):
            rover.drive(np.full(6, np.nan), STRAIGHT)
