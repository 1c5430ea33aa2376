"""The rover's figures, with a friction of wheels on ground of 0.9 and the gravity that test_world.py measures."""

import os
import subprocess
import sys

import numpy as np
import pytest

p = pytest.importorskip("pybullet")

from settling_errors import settling_errors  # noqa: E402

from marssim.base.rover_spec import ZHURONG  # noqa: E402
from marssim.physics.linkage import WHEELS, Linkage  # noqa: E402
from marssim.physics.rover import WHEEL_FRICTION, Rover  # noqa: E402
from marssim.physics.world import GROUND_FRICTION, PhysicsWorld  # noqa: E402
from marssim.scene.presets import preset  # noqa: E402
from marssim.scene.scene import build_scene  # noqa: E402

STRAIGHT = np.zeros(6)
HUBS = ZHURONG.wheel_positions


def roll(speed):
    return np.full(6, speed / ZHURONG.wheel_radius)


def slope(degrees, azimuth=0.0):
    rise = np.tan(np.deg2rad(degrees))
    return lambda x, y: rise * (np.cos(azimuth) * x + np.sin(azimuth) * y)


def test_the_rover_has_its_mass_and_its_parts_lie_at_its_links(make_scene):
    with PhysicsWorld(make_scene(slope(8.0, 0.7))) as world:
        rover = Rover(world, 0.5, -0.3, 1.0)
        links = range(-1, p.getNumJoints(rover._body, physicsClientId=world.client))
        masses = [p.getDynamicsInfo(rover._body, link, physicsClientId=world.client)[0] for link in links]
        assert sum(masses) == pytest.approx(ZHURONG.mass)
        poses = Linkage.from_spec(ZHURONG).link_poses(rover.state().pose, rover.joints())
        for name, link in zip(WHEELS, rover._wheels):
            state = p.getLinkState(rover._body, link, computeForwardKinematics=1, physicsClientId=world.client)
            np.testing.assert_allclose(poses[f"wheel_{name}"][:3, 3], state[4], atol=2e-3)
        for part in rover.mesh(pan=0.4):
            assert part.faces.max() < len(part.vertices) and np.isfinite(part.pose).all()


def test_drives_two_metres_straight(make_scene):
    with PhysicsWorld(make_scene(cell=0.2)) as world:
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
    with PhysicsWorld(make_scene(cell=0.2)) as world:
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


@pytest.mark.parametrize(("beyond", "slides"), [(-3.0, False), (3.0, True)])
def test_slides_where_friction_ends(make_scene, beyond, slides):
    """The friction angle is that of the coefficients' product; within 3 deg of it the rover lets go."""
    angle = np.rad2deg(np.arctan(WHEEL_FRICTION * GROUND_FRICTION)) + beyond
    with PhysicsWorld(make_scene(slope(angle, np.pi), half=2.0)) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        world.step(0.5)
        start = rover.state()
        world.step(2.0)
        went = np.linalg.norm(rover.state().position - start.position)
        assert went > 0.05 if slides else went < 0.01


@pytest.mark.parametrize(("height", "crosses"), [(0.2, True), (0.6, False)])
def test_climbs_a_step_of_20_cm_but_not_of_60(make_scene, height, crosses):
    """The step is a vertical face across the path, with friction 0.9; all six wheels have to climb it."""
    with PhysicsWorld(make_scene(cell=0.2, half=3.2)) as world:
        p, client = world.bullet, world.client
        block = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1.2, 1.5, height / 2], physicsClientId=client)
        face = 0.7
        step = p.createMultiBody(0, block, basePosition=[face + 1.2, 0, height / 2], physicsClientId=client)
        p.changeDynamics(step, -1, lateralFriction=GROUND_FRICTION, restitution=0, physicsClientId=client)
        rover = Rover(world, face - 0.85, 0.0, 0.0)
        rover.drive(roll(0.2), STRAIGHT)
        for _ in range(14 if crosses else 6):
            world.step(1.0)
            if rover.state().position[0] > 1.6:  # the rear wheels are up
                break
        state = rover.state()
        if crosses:
            assert state.position[0] > 1.6 and state.position[2] == pytest.approx(height, abs=0.03)
        else:
            assert state.position[0] < face


@pytest.mark.parametrize("kind", ["ackermann", "crab"])
def test_drives_curves_and_sideways(make_scene, kind):
    """An arc of 0.8 m radius to the left and a path at 30 deg to the heading are those of rolling without slip."""
    speed, rate, lateral = (0.16, 0.2, 0.0) if kind == "ackermann" else (0.2 * np.cos(0.5), 0.0, 0.2 * np.sin(0.5))
    vx, vy = speed - rate * HUBS[:, 1], lateral + rate * HUBS[:, 0]
    with PhysicsWorld(make_scene(half=3.2, cell=0.2)) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        steering = np.arctan2(vy, vx)
        rover.drive(np.zeros(6), steering)
        world.step(1.5)
        start = rover.state()
        rover.drive(np.hypot(vx, vy) / ZHURONG.wheel_radius, steering)
        world.step(5.0)
        state = rover.state()
        x, y = state.position[:2] - start.position[:2]
        if kind == "ackermann":
            assert state.yaw - start.yaw == pytest.approx(rate * 5.0, rel=0.1)  # wide wheels scrub a little
            np.testing.assert_allclose([x, y], 0.8 * np.array([np.sin(1.0), 1 - np.cos(1.0)]), atol=0.08)
        else:
            assert abs(state.yaw) < np.deg2rad(1) and np.hypot(x, y) == pytest.approx(1.0, rel=0.05)
            assert np.arctan2(y, x) == pytest.approx(0.5, abs=0.03)


def test_a_rover_outside_is_refused_and_leaves_nothing_behind(make_scene):
    with PhysicsWorld(make_scene(half=2.0)) as world:
        bodies = world.bullet.getNumBodies(physicsClientId=world.client)
        with pytest.raises(ValueError, match="outside"):
            Rover(world, 3.0, 0.0, 0.0)
        with pytest.raises(ValueError, match="ground 'mud' is unknown"):
            Rover(world, 0.0, 0.0, 0.0, "mud")
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


def test_rests_where_kinematics_says():
    """Gale's relief and rocks, ten places; tests/benchmarks/test_physics_accuracy.py has two hundred."""
    scene = build_scene(preset("gale", size=12.0, cell=0.1, horizon=12.0), np.random.default_rng(2))
    errors = settling_errors(scene, 10, np.random.default_rng(3))
    assert np.median(errors[:, 0]) < 2 and np.median(errors[:, 1]) < 2 and np.median(errors[:, 2]) < 0.03


CHILD = """
import hashlib
import numpy as np
from marssim.physics.rover import Rover
from marssim.physics.world import PhysicsWorld
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene
scene = build_scene(preset("gale", size=8.0, cell=0.2, horizon=8.0), np.random.default_rng(5))
with PhysicsWorld(scene) as world:
    rover = Rover(world, 0.0, 0.0, 0.2)
    rover.drive(np.full(6, 1.3), np.deg2rad([10, 10, 0, 0, -10, -10]))
    world.step(2.0)
    print(hashlib.sha256(rover.state().pose.tobytes()).hexdigest())
"""


def test_the_same_drive_again_and_in_another_process(capsys):
    exec(CHILD, {})
    exec(CHILD, {})
    first, again = capsys.readouterr().out.split()
    environment = {**os.environ, "PYTHONHASHSEED": "1"}
    run = subprocess.run([sys.executable, "-c", CHILD], env=environment, capture_output=True, text=True, check=True)
    assert len(first) == 64 and first == again == run.stdout.strip()


def test_bad_commands_are_refused(make_scene):
    with PhysicsWorld(make_scene(half=2.0)) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        with pytest.raises(ValueError, match="6 finite"):
            rover.drive(np.zeros(5), STRAIGHT)
        with pytest.raises(ValueError, match="6 finite"):
            rover.drive(np.full(6, np.nan), STRAIGHT)
