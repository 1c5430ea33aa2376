"""Both dynamics report the same contacts."""

import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG
from marssim.physics.kinematics import KinematicRover, settle
from marssim.physics.rover import Rover
from marssim.physics.state import Contacts
from marssim.physics.world import PhysicsWorld

ROLL = np.full(6, 0.2 / ZHURONG.wheel_radius)


def forward(dynamics, scene, seconds, y=0.0):
    """Return contacts, x [m] and speed [m/s] after a drive straight ahead from the origin at 0.2 m/s."""
    if dynamics == "kinematic":
        rover = KinematicRover(scene, ZHURONG, 0.0, y, 0.0)
        state = rover.drive_twist(0.2, 0.0, seconds)
        return rover.contacts(), state.position[0], state.velocity[0]
    pytest.importorskip("pybullet")
    with PhysicsWorld(scene) as world:
        rover = Rover(world, 0.0, y, 0.0)
        rover.drive(ROLL, np.zeros(6))
        world.step(seconds)
        state = rover.state()
        return rover.contacts(), state.position[0], state.velocity[0]


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
@pytest.mark.parametrize(
    ("y", "expected"),
    [(0.0, Contacts(chassis=True)), (-0.6, Contacts(obstacle=True)), (-1.2, Contacts())],
    ids=["between the wheels", "before the left wheels", "beside the way"],
)
def test_a_rock_is_met_by_what_runs_into_it(make_scene, dynamics, y, expected):
    scene = make_scene(balls=[(1.1, 0.0, 0.2, 0.35)], half=2.5)
    contacts, x, _ = forward(dynamics, scene, 2.5, y)
    assert contacts == expected
    if expected.chassis:
        assert x == pytest.approx(1.1 - 0.35 - ZHURONG.chassis_size[0] / 2, abs=0.15)


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
@pytest.mark.parametrize(("height", "expected"), [(0.2, Contacts()), (0.45, Contacts(chassis=True))])
def test_the_chassis_meets_a_hump_between_the_wheels_that_is_higher_than_its_clearance(
    make_scene, dynamics, height, expected
):
    """The hump is ground, not rock, and half as wide as the gap between the wheels. The chassis clears 0.32 m."""
    assert 0.2 < ZHURONG.belly_clearance < 0.45

    def hump(x, y):
        return height * ((x > 0.7) & (np.abs(y) < 0.25))

    contacts, x, speed = forward(dynamics, make_scene(hump, half=2.5, cell=0.05), 2.5)
    assert contacts == expected
    if expected.chassis:
        assert x < 0.7 - ZHURONG.chassis_size[0] / 2 + 0.15 and abs(speed) < 0.1
    else:
        assert x > 0.4 and speed == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize(("height", "clearance"), [(0.30, 0.02), (0.33, -0.01)])
def test_put_down_over_a_hump_the_chassis_rests_on_it_or_does_not(make_scene, height, clearance):
    pytest.importorskip("pybullet")
    scene = make_scene(lambda x, y: height * ((np.abs(x) < 0.3) & (np.abs(y) < 0.3)), half=2.0, cell=0.05)
    place, expected = settle(scene, ZHURONG, 0.0, 0.0, 0.3), Contacts(chassis=clearance < 0)
    assert place.clearance == pytest.approx(clearance, abs=2e-3) and place.belly_contact == expected.chassis
    assert KinematicRover(scene, ZHURONG, 0.0, 0.0, 0.3).contacts() == expected
    with PhysicsWorld(scene) as world:
        rover = Rover(world, 0.0, 0.0, 0.3)
        assert rover.contacts() == expected
        assert rover.state().position[2] == pytest.approx(max(-clearance, 0.0), abs=2e-3)  # it is lifted by as much


@pytest.mark.parametrize("late", range(8))
def test_the_shortest_contact_is_noticed(make_scene, late):
    """A ball that bounces off the chassis touches it for three steps or fewer, at any of eight times."""
    p = pytest.importorskip("pybullet")
    with PhysicsWorld(make_scene(half=2.0)) as world:
        rover = Rover(world, 0.0, 0.0, 0.0)
        rover.drive(ROLL, np.zeros(6))
        world.step(0.1)
        client, speed = world.client, 10.0
        front = rover.state().position[0] + ZHURONG.chassis_size[0] / 2
        place = [front + 0.1 + (0.2 + late * world.time_step) * speed, 0.0, ZHURONG.belly_clearance + 0.2]
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=client)
        ball = p.createMultiBody(0.01, shape, basePosition=place, physicsClientId=client)
        p.resetBaseVelocity(ball, [-speed, 0, 0.2 * 3.72], physicsClientId=client)
        for body in (ball, rover._body):
            p.changeDynamics(body, -1, restitution=1.0, physicsClientId=client)
        touched = []
        world.watch(lambda: False, lambda: touched.append(bool(p.getContactPoints(ball, physicsClientId=client))))
        world.step(0.5)
        assert 0 < sum(touched) <= 3  # near it, at least; a force may act in fewer
        assert rover.contacts() == Contacts(chassis=True)
