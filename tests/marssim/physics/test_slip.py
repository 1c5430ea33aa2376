"""The whole rover on soil, in both dynamics."""

import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG
from marssim.engines.bullet import pybullet_is_installed
from marssim.physics.kinematics import KinematicRover, settle
from marssim.physics.rover import Rover
from marssim.physics.slipping_rover import SlippingRover
from marssim.physics.soil.loads import wheel_loads
from marssim.physics.soil.soil_map import SoilMap
from marssim.physics.soil.soils import SOIL_NAMES, SOILS
from marssim.physics.soil.traction import Traction
from marssim.physics.soil.wheel import sinkage_under_load, wheel_forces
from marssim.physics.support import SupportMap
from marssim.physics.world import GRAVITY, PhysicsWorld
from marssim.scene.ground.cover import CELL
from nav.controller import wheel_command

needs_bullet = pytest.mark.skipif(not pybullet_is_installed(), reason="PyBullet is not installed here")
SPEED, SECONDS = 0.2, 2.0


@pytest.fixture
def slope(make_scene):
    def make(degrees):
        rise = np.tan(np.deg2rad(degrees))
        return make_scene(lambda x, y: rise * x, half=5.0)

    return make


def settled_drive(scene, soil, yaw, turn=0.0):
    """Return the way (3,) and the turn of a rover without dynamics, and what it cost."""
    rover = SlippingRover(scene, ZHURONG, 0.0, 0.0, yaw, ground=soil)
    start = rover.state()
    rover.drive_twist(SPEED, turn, SECONDS)
    return rover.state().position - start.position, rover.state().yaw - start.yaw, rover.slippage()


def bullet_drive(scene, soil, yaw, turn=0.0):
    """Return the same of a rover in PyBullet that drives already."""
    command = wheel_command(SPEED, turn)
    with PhysicsWorld(scene, ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, yaw, soil)
        rover.drive(command.speeds, command.angles)
        world.step(1.0)
        start = rover.state()
        rover.drive(command.speeds, command.angles)
        world.step(SECONDS)
        end = rover.state()
        return end.position - start.position, end.yaw - start.yaw, rover.soil.slippage


def test_a_rover_climbs_sand_with_the_slip_of_its_wheels(slope):
    """As docs/results/slip.md shows it: what the model gave, not what a rover was measured to do."""
    slips = [settled_drive(slope(degrees), "sand", 0.0)[2].slip for degrees in (0, 5, 10, 15, 20)]
    np.testing.assert_allclose(slips, [0.04, 0.10, 0.19, 0.33, 0.67], atol=0.03)


def test_a_rover_slides_down_where_it_drives_across(slope):
    for degrees, least, most in ((5, 2, 5), (10, 5, 10), (15, 9, 18)):
        way, _, slippage = settled_drive(slope(degrees), "sand", np.pi / 2)
        angle = np.rad2deg(np.arctan2(slippage.sideways, way[1]))
        assert least < angle < most
        downhill = -way[0] / np.cos(np.deg2rad(degrees))
        assert downhill == pytest.approx(slippage.sideways, abs=2e-3)
    assert settled_drive(slope(15), "bedrock", np.pi / 2)[2].sideways < 0.01


@pytest.mark.parametrize("soil", ["sand", "crust"])
def test_across_a_slope_the_stresses_under_the_wheels_hold_the_rover(slope, soil):
    """Those of six wheels that slide sideways as it does bear the weight's part down the slope."""
    angle = np.deg2rad(10)
    way, _, slippage = settled_drive(slope(10), soil, np.pi / 2)
    size, slide = (ZHURONG.wheel_radius, ZHURONG.wheel_width), slippage.sideways / way[1]
    weight = ZHURONG.mass * GRAVITY
    loads = wheel_loads(ZHURONG, weight * np.array([0, np.sin(angle), -np.cos(angle)]))
    sinkage = sinkage_under_load(SOILS[soil], *size, loads, 0.0, slide)
    held = wheel_forces(SOILS[soil], *size, sinkage, 0.0, slide).side.sum()
    assert held == pytest.approx(weight * np.sin(angle), rel=0.07)


def test_a_rover_that_drives_down_slides_further_than_its_wheels_turn(slope):
    way, _, slippage = settled_drive(slope(10), "sand", np.pi)
    assert slippage.slip < -0.02 and way[0] < -SPEED * SECONDS * np.cos(np.deg2rad(10))


def test_a_drive_costs_less_the_steeper_it_goes_down(slope):
    """The slope pushes, so the wheels thrust less, and slide forwards without torque in the end."""
    level, gentle, steep = (settled_drive(slope(degrees), "sand", np.pi)[2].energy for degrees in (0, 5, 10))
    assert level > 1.2 * gentle > 1.2 * 1.2 * steep > 0


def test_on_level_bedrock_the_rover_moves_as_without_slip(slope):
    for yaw_rate in (0.0, 0.1):
        rover = KinematicRover(slope(0), ZHURONG, 0.0, 0.0, 0.3)
        rover.drive_twist(SPEED, yaw_rate, SECONDS)
        other = SlippingRover(slope(0), ZHURONG, 0.0, 0.0, 0.3, ground="bedrock")
        other.drive_twist(SPEED, yaw_rate, SECONDS)
        np.testing.assert_allclose(other.state().pose, rover.state().pose, atol=1e-5)
        assert abs(other.slippage().slip) < 1e-5 and other.slippage().sinkage == 0


def test_a_rover_does_not_get_up_sand_of_24_deg(slope):
    way, _, slippage = settled_drive(slope(24), "sand", 0.0)
    assert way[0] < 0.0 and slippage.slip > 1.0


def test_a_climb_costs_the_weights_work_and_more(slope):
    way, _, slippage = settled_drive(slope(10), "sand", 0.0)
    lifted = ZHURONG.mass * 3.72076 * way[2]
    assert slippage.energy > 2 * lifted > 0
    assert settled_drive(slope(0), "sand", 0.0)[2].energy > settled_drive(slope(0), "bedrock", 0.0)[2].energy > 0
    assert slippage.seconds == pytest.approx(SECONDS) and 0.01 < slippage.sinkage < 0.03


def test_the_way_that_the_wheels_rolled_is_the_true_way_and_the_slip(slope):
    way, _, slippage = settled_drive(slope(10), "sand", 0.0)
    np.testing.assert_allclose(slippage.rolled[0] * (1 - slippage.slip), way[0], atol=2e-3)


def test_a_rover_that_stands_slips_nowhere(slope):
    rover = SlippingRover(slope(15), ZHURONG, 0.0, 0.0, 0.0, ground="sand")
    start = rover.state().pose
    rover.drive_twist(0.0, 0.0, SECONDS)
    np.testing.assert_array_equal(rover.state().pose, start)
    assert rover.slippage().slip == rover.slippage().energy == 0


def test_a_turning_rover_turns_less_in_sand_and_slides_down(slope):
    rover = SlippingRover(slope(10), ZHURONG, 0.0, 0.0, 0.0, ground="sand")
    rover.drive_twist(0.0, 0.25, SECONDS)
    assert 0.4 < rover.state().yaw < 0.49 and -0.1 < rover.state().position[0] < -0.02


@pytest.mark.parametrize("drive", [settled_drive, pytest.param(bullet_drive, marks=needs_bullet)])
def test_a_wheel_on_a_rock_does_not_sink(make_scene, drive):
    """A low dome lies under one wheel of six, and bears what it bore."""
    hub = ZHURONG.wheel_positions[0]
    dome = (hub[0] + 0.3, hub[1], -2.92, 3.0)
    sand, rock = (drive(make_scene(half=5.0, balls=balls), "sand", 0.0)[2].sinkage for balls in ([], [dome]))
    assert rock / sand == pytest.approx(5 / 6, abs=0.05)


@needs_bullet
def test_a_rover_on_rocks_alone_does_not_sink(make_scene):
    domes = [(x, y, -2.9, 3.0) for x, y, _ in ZHURONG.wheel_positions]
    with PhysicsWorld(make_scene(half=5.0, balls=domes), ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, 0.0, "sand")
        world.step(1.0)
        rover.drive(np.full(6, 0.1), np.zeros(6))
        world.step(0.5)
        assert rover.soil.slippage.seconds > 0 and rover.soil.slippage.sinkage < 1e-4


def test_a_wheel_on_the_edge_of_a_rock_stands_on_the_rock(make_scene):
    hub = ZHURONG.wheel_positions[0]
    sinkage = []
    for balls in ([], [(hub[0] + 0.16, hub[1], 0.0, 0.08)]):
        rover = SlippingRover(make_scene(half=5.0, balls=balls), ZHURONG, 0.0, 0.0, 0.0, ground="sand")
        rover.drive_twist(0.02, 0.0, 0.5)
        sinkage.append(rover.slippage().sinkage)
    assert 0.78 < sinkage[1] / sinkage[0] < 0.88


def test_a_wheel_touches_a_rock_before_it_is_above_it(make_scene):
    hub = ZHURONG.wheel_positions[0]
    place = make_scene(half=5.0, balls=[(hub[0] + 0.16, hub[1], 0.0, 0.08)])
    support = SupportMap.from_scene(place, ZHURONG.obstacle_height)
    rest = settle(support, ZHURONG, 0.0, 0.0, 0.0)
    ahead = rest.wheel_contacts - ZHURONG.wheel_positions[:, :2]
    assert 0.05 < ahead[0, 0] < 0.15 and np.abs(ahead[1:, 0]).max() < 0.01
    traction = Traction(place, ZHURONG, support, "sand")
    soils = traction.soils_under(rest.wheel_middles, rest.wheel_contacts)
    np.testing.assert_array_equal(soils, [[0, 0, 1]] + [[1, 0, 0]] * 5)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 0.7])
def test_the_soil_is_that_under_the_middles_of_the_wheels(slope, yaw):
    rest = settle(SupportMap.from_scene(slope(5), ZHURONG.obstacle_height), ZHURONG, 0.0, 0.0, yaw)
    hubs = (ZHURONG.wheel_positions @ rest.pose[:3, :3].T)[:, :2]
    beside = (rest.wheel_middles - hubs) @ [-np.sin(yaw), np.cos(yaw)]
    np.testing.assert_allclose(beside, 0, atol=0.01)
    reach = np.abs((rest.wheel_contacts - rest.wheel_middles) @ [np.cos(yaw), np.sin(yaw)])
    np.testing.assert_allclose(reach, 0, atol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_a_place_and_its_mirror_image_are_driven_alike(slope, turn, monkeypatch):
    """Sand lies from the inner part of the left or of the right wheels on outwards, and bedrock between."""
    motions = []
    for side in (1, -1):
        sand = np.broadcast_to(side * (np.arange(101) * CELL - 5.0) > 0.52, (101, 101)).T
        soils = SoilMap(np.stack([sand, np.zeros_like(sand), ~sand], axis=-1).astype(float), -5.0)
        monkeypatch.setattr(SoilMap, "from_scene", lambda *_, soils=soils: soils)
        way, yaw, slippage = settled_drive(slope(0), "scene", 0.0, side * turn)
        motions.append([way[0], side * way[1], side * yaw, slippage.slip, slippage.sinkage])
    np.testing.assert_allclose(motions[0], motions[1], atol=1e-6)
    assert motions[0][-1] > 2e-3


@needs_bullet
@pytest.mark.parametrize("soil", SOIL_NAMES)
def test_both_dynamics_lose_the_same_way(slope, soil):
    """Up and across the slope, and in sand, in which most is lost, also down."""
    scene = slope(12)
    for yaw in (0.0, np.pi / 2, np.pi)[: 3 if soil == "sand" else 2]:
        settled, bullet = settled_drive(scene, soil, yaw), bullet_drive(scene, soil, yaw)
        np.testing.assert_allclose(bullet[0], settled[0], atol=0.02)
        assert bullet[2].slip == pytest.approx(settled[2].slip, abs=0.02)
        assert bullet[2].sideways == pytest.approx(settled[2].sideways, abs=0.01)
        assert bullet[2].energy == pytest.approx(settled[2].energy, rel=0.1, abs=5)


@needs_bullet
def test_both_dynamics_turn_alike_on_a_slope(slope):
    settled, bullet = settled_drive(slope(10), "sand", 0.0, 0.1), bullet_drive(slope(10), "sand", 0.0, 0.1)
    assert bullet[1] == pytest.approx(settled[1], abs=0.03)


@needs_bullet
def test_braked_wheels_hold_the_rover_in_sand(slope):
    with PhysicsWorld(slope(15), ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, 0.0, "sand")
        world.step(3.0)
        start = rover.state().position
        world.step(10.0)
        np.testing.assert_allclose(rover.state().position, start, atol=1e-4)


@needs_bullet
def test_physics_on_soil_is_deterministic_and_can_be_removed(slope):
    first, again = (bullet_drive(slope(8), "sand", 0.2)[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)
    with PhysicsWorld(slope(0), ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, 0.0, "sand")
        rover.remove()
        world.step(0.1)


@needs_bullet
def test_the_yaw_inertia_is_that_of_the_rover_that_turns_freely(slope):
    with PhysicsWorld(slope(0), ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, 0.5, "sand")
        stated, p, client = rover.soil._yaw_inertia(), world.bullet, world.client
        rover.soil.remove()
        body = rover.soil._body
        at, turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
        p.resetBasePositionAndOrientation(body, [at[0], at[1], at[2] + 5], turn, physicsClientId=client)
        for joint in range(p.getNumJoints(body, physicsClientId=client)):  # no leg swings
            angle = p.getJointState(body, joint, physicsClientId=client)[0]
            p.setJointMotorControl2(body, joint, p.POSITION_CONTROL, angle, force=1e4, physicsClientId=client)
        for _ in range(20):
            p.applyExternalTorque(body, -1, [0, 0, 20.0], p.WORLD_FRAME, physicsClientId=client)
            p.stepSimulation(physicsClientId=client)
        rate = p.getBaseVelocity(body, physicsClientId=client)[1][2]
        assert stated == pytest.approx(20.0 * 20 * world.time_step / rate, rel=0.02)


@needs_bullet
def test_a_step_in_which_the_wheels_only_brake_has_no_slip(slope):
    with PhysicsWorld(slope(0), ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, 0.0, "sand")
        for speed, least, most in ((SPEED, 0.02, 0.2), (0.0, 0.0, 0.0)):
            command = wheel_command(speed, 0.0)
            rover.drive(command.speeds, command.angles)
            world.step(SECONDS)
            assert rover.soil.slippage.turned > 0
            assert least <= rover.soil.slippage.slip <= most


@needs_bullet
@pytest.mark.parametrize("grounds", [(None, "sand"), ("sand", None)])
def test_a_rover_that_slips_and_one_that_does_not_cannot_share_a_world(slope, grounds):
    with PhysicsWorld(slope(0), ZHURONG) as world:
        first = Rover(world, 0.0, 0.0, 0.0, grounds[0])
        bodies = world.bullet.getNumBodies(physicsClientId=world.client)
        with pytest.raises(ValueError, match=r"^all rovers of one PhysicsWorld slip, or none"):
            Rover(world, 3.0, 0.0, 0.0, grounds[1])
        assert world.bullet.getNumBodies(physicsClientId=world.client) == bodies
        first.remove()
        Rover(world, 3.0, 0.0, 0.0, grounds[1])


@needs_bullet
def test_without_the_rover_that_slips_the_ground_has_friction_again(slope):
    with PhysicsWorld(slope(8), ZHURONG) as world:
        first, second = (Rover(world, x, 0.0, 0.0, "sand") for x in (0.0, 4.0))
        for slipping, friction in ((first, 0.0), (second, 1.0)):
            slipping.remove()
            assert world.bullet.getDynamicsInfo(world.ground, -1, physicsClientId=world.client)[1] == friction
        rover = Rover(world, 0.0, 0.0, 0.0)
        world.step(2.0)
        start = rover.state().position
        world.step(4.0)
        np.testing.assert_allclose(rover.state().position, start, atol=1e-2)
