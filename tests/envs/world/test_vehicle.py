import numpy as np
import pytest

from envs.world.vehicle import CHECK_EVERY, make_vehicle
from marssim.base.rover_spec import ZHURONG
from marssim.physics.state import rotation


@pytest.fixture
def put_down(make_scene):
    made = []

    def put(dynamics, *place, rocks=()):
        made.append(make_vehicle(dynamics, make_scene(rocks=rocks, half=6.0), ZHURONG, *place))
        return made[-1]

    yield put
    for vehicle in made:
        vehicle.close()
        vehicle.close()


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_a_vehicle_stands_where_it_was_put(put_down, dynamics):
    state = put_down(dynamics, 1.0, -2.0, 0.7).state()
    np.testing.assert_allclose(state.position, [1, -2, 0], atol=0.02)
    assert state.yaw == pytest.approx(0.7, abs=0.02) and state.tilt < 0.01


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.2, 0.0), (-0.2, 0.0), (0.2, 0.1), (0.0, 0.25), (0.0, -0.25)])
def test_a_vehicle_moves_as_it_is_commanded(put_down, dynamics, speed, yaw_rate):
    vehicle = put_down(dynamics, 0.0, 0.0, 0.0)
    for _ in range(2):
        vehicle.drive_twist(speed, yaw_rate, 2.0)
    state = vehicle.state()
    assert not vehicle.contacts().collision
    angle = 4 * yaw_rate
    expected = 4 * speed * np.array([np.sinc(angle / np.pi), np.sinc(angle / 2 / np.pi) * np.sin(angle / 2)])
    # wheels steer first, then roll: the physical rover falls short by that, and slips a little
    np.testing.assert_allclose(state.position[:2], expected, atol=0.01 if dynamics == "kinematic" else 0.12)
    assert state.yaw == pytest.approx(angle, abs=0.01 if dynamics == "kinematic" else 0.25)
    assert np.sign(state.yaw if yaw_rate else state.position[0]) == np.sign(yaw_rate or speed)


def test_no_wheel_steers_beyond_its_stop_in_either_dynamics(put_down):
    """Curves about a point near a wheel cannot be steered; both dynamics drive the same curve instead."""
    ends = []
    for dynamics in ("kinematic", "physics"):
        vehicle = put_down(dynamics, 0.0, 0.0, 0.0)
        for _ in range(3):
            vehicle.drive_twist(0.12, 0.2, 2.0)  # turns about a point 0.6 m to the left, the left wheels' line
        ends.append(vehicle.state())
    assert abs(ends[0].yaw - ends[1].yaw) < 0.25
    np.testing.assert_allclose(ends[0].position[:2], ends[1].position[:2], atol=0.15)


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_a_vehicle_stops_at_a_rock(put_down, dynamics):
    vehicle = put_down(dynamics, 0.0, 0.0, 0.0, rocks=[(1.6, 0.6, 0.8, 0.8)])
    for _ in range(8):
        vehicle.drive_twist(0.2, 0.0, 2.0)
        if vehicle.contacts().collision:
            break
    assert vehicle.contacts().collision
    assert 0.2 < vehicle.state().position[0] < 0.8  # the left front wheel, 0.8 m ahead, at the rock's outline


def test_physics_goes_no_further_than_to_the_next_look_at_the_contacts(put_down):
    """The wheels would dig at a rock for the rest of the step. It lies 5 cm ahead of the left front wheel."""
    vehicle = put_down("physics", 0.0, 0.0, 0.0, rocks=[(0.8 + 0.05 + 0.4, 0.6, 0.8, 0.8)])
    seen, world = [], vehicle.world
    world.watch(lambda: False, lambda: seen.append(vehicle.contacts().collision))
    vehicle.drive_twist(0.2, 0.0, 2.0)
    assert seen[-1] and 0.1 < seen.index(True) * world.time_step < 1.0
    assert (len(seen) - seen.index(True)) * world.time_step <= CHECK_EVERY


def test_physics_goes_no_further_than_to_the_next_look_at_the_tilt(make_scene):
    """Over a short ridge, the tilt is more than 30 deg for a moment only, which a step of 2 s may drive past."""
    slope = np.tan(np.deg2rad(38.0))
    ridge = make_scene(lambda x, y: np.clip(np.minimum(slope * (x - 1.2), slope * (2.8 - x)), 0, None), 6.0, 0.1)
    vehicle = make_vehicle("physics", ridge, ZHURONG, -0.2, 0.0, 0.0)
    tilts = []
    vehicle.world.watch(lambda: False, lambda: tilts.append(vehicle.state().tilt))
    while not vehicle.contacts().collision and vehicle.state().tilt <= ZHURONG.max_tilt and len(tilts) < 5000:
        vehicle.drive_twist(0.2, 0.0, 2.0)
    beyond = np.array(tilts) > ZHURONG.max_tilt
    assert vehicle.state().tilt > ZHURONG.max_tilt
    assert beyond.sum() * vehicle.world.time_step <= CHECK_EVERY
    vehicle.close()


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_the_parts_of_a_vehicle_stand_where_it_stands(put_down, dynamics):
    vehicle = put_down(dynamics, 1.0, 2.0, 0.5)
    parts = vehicle.mesh(0.4)
    points = np.concatenate([p.vertices @ p.pose[:3, :3].T + p.pose[:3, 3] for p in parts])
    np.testing.assert_allclose(points.mean(axis=0)[:2], [1, 2], atol=0.5)
    assert points[:, 2].min() == pytest.approx(0, abs=0.03) and points[:, 2].max() > 1.1  # wheels and mast


def test_the_parts_turn_with_the_rover_and_the_head_with_the_mast(put_down):
    vehicle = put_down("kinematic", 1.0, 2.0, 0.5)
    other = put_down("kinematic", 1.0, 2.0, 0.9)
    for part, turned in zip(vehicle.mesh(), other.mesh(), strict=True):
        np.testing.assert_allclose(turned.pose[:3, :3], rotation(0.0, 0.0, 0.4) @ part.pose[:3, :3], atol=1e-6)
    ahead, panned = vehicle.mesh(), vehicle.mesh(0.4)
    moved = [part for part, after in zip(ahead, panned, strict=True) if not np.allclose(part.pose, after.pose)]
    assert len(moved) == 3  # the head and its two lenses
    for part, after in zip(ahead, panned, strict=True):
        if any(part is head for head in moved):
            np.testing.assert_allclose(after.pose[:3, 3], part.pose[:3, 3])
            np.testing.assert_allclose(after.pose[:3, :3], part.pose[:3, :3] @ rotation(0.0, 0.0, 0.4), atol=1e-9)
