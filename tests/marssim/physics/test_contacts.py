"""What touched what: the same words from either dynamics."""

import numpy as np
import pytest

from marssim.physics.kinematics import KinematicRover
from marssim.physics.rover import Rover
from marssim.physics.state import Contacts
from marssim.physics.world import PhysicsWorld
from marssim.rover_spec import ZHURONG

ROLL = np.full(6, 0.2 / ZHURONG.wheel_radius)


def forward(dynamics, scene, seconds, y=0.0):
    """Contacts, x [m] and speed [m/s] after a drive straight ahead from the origin at 0.2 m/s."""
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
    scene = make_scene(balls=[(1.3, 0.0, 0.2, 0.35)], half=3.0)
    contacts, x, _ = forward(dynamics, scene, 4.0, y)
    assert contacts == expected
    if expected.chassis:
        assert x == pytest.approx(1.3 - 0.35 - ZHURONG.chassis_size[0] / 2, abs=0.15)
