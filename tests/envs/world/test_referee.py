from types import SimpleNamespace

import numpy as np
import pytest

from envs.courses.course import EDGE
from envs.world.referee import GOAL_RADIUS, STEPS_PER_METRE, Referee
from marssim.base.rover_spec import ZHURONG
from marssim.physics.state import Contacts

AHEAD = np.array([1, 0], np.float32)


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_a_rock_in_the_way_is_a_collision(on_course, make_scene, make_course, dynamics):
    scene = make_scene(rocks=[(0.0, -0.5, 1.2, 0.9)])
    env = on_course(make_course(scene, start=(-2.0, 0.0, 0.0)), dynamics=dynamics)
    for _ in range(12):
        _, reward, terminated, truncated, info = env.step(AHEAD)
        if terminated:
            break
    assert (terminated, truncated, info["outcome"]) == (True, False, "collision")
    assert -10.1 < reward < -9.4
    # its front was about to touch the rock's outline
    assert -1.7 < env.vehicle.state().position[0] < -1.0
    assert info["min_clearance"] < 0.15


def test_a_goal_is_reached_at_its_radius(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(), start=(2.0, 0.0, 0.0), goal=(2.0 + GOAL_RADIUS, 0.0)))
    assert env.step(np.zeros(2))[4]["outcome"] == "goal"


def test_leaving_the_ground_is_out_of_bounds(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(half=6.0), start=(3.9, 0.0, 0.0), goal=(-3.0, 0.0)))
    assert not env.step(AHEAD)[2]
    assert env.step(AHEAD)[2]
    position = env.vehicle.state().position
    assert env.outcome == "out_of_bounds" and position[0] > 6 - EDGE
    observation, reward, *_ = env.step(AHEAD)  # a learner's mistake, but no crash
    assert observation in env.observation_space and reward < 0


class Bogged:
    """A rover whose wheels spin."""

    def __init__(self, vehicle):
        self.vehicle = vehicle

    def __getattr__(self, name):
        return getattr(self.vehicle, name)

    def drive_twist(self, speed, yaw_rate, seconds):
        pass

    def contacts(self):
        return Contacts()


@pytest.mark.parametrize("drive", [AHEAD, -AHEAD])
def test_five_steps_on_the_spot_are_stuck(on_course, make_scene, make_course, drive):
    env = on_course(make_course(make_scene()))
    env.vehicle = Bogged(env.vehicle)
    turning = [env.step(np.array([0, 1.0]))[4]["outcome"] for _ in range(7)]
    assert set(turning) == {"driving"}
    ends = [env.step(drive)[2:] for _ in range(5)]
    assert [end[2]["outcome"] for end in ends] == ["driving"] * 4 + ["stuck"]
    assert ends[-1][:2] == (True, False)


def test_backing_out_and_returning_is_not_stuck(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene()))
    ends = [env.step(drive)[4]["outcome"] for drive in np.outer([1, 0.5, -0.5, -0.5, -0.5], AHEAD)]
    assert set(ends) == {"driving"}


def test_five_steps_forward_are_not_stuck(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(), goal=(8.0, 0.0)))
    slow = np.array([0.3, 0])  # 0.12 m a step
    assert {env.step(slow)[4]["outcome"] for _ in range(8)} == {"driving"}


def test_time_truncates(make_env):
    env = make_env(goal_distance=3.0)
    env.reset(seed=0)
    ends = [env.step(np.zeros(2))[2:] for _ in range(3 * STEPS_PER_METRE)]
    assert all(not terminated for terminated, _, _ in ends)
    assert [truncated for _, truncated, _ in ends] == [False] * (len(ends) - 1) + [True]
    assert ends[-1][2]["outcome"] == "time"


def test_parts_of_a_metre_count_in_the_time_limit(make_scene, make_course):
    assert Referee(make_course(make_scene()), ZHURONG, 3.26).time_limit == 49  # 48.9 steps


def test_a_steep_slope_is_a_tilt(on_course, make_scene, make_course):
    def ramp(x, y):
        return np.tan(np.deg2rad(36)) * np.maximum(0, x + 1)

    env = on_course(make_course(make_scene(ramp, cell=0.1), start=(-3.0, 0.0, 0.0), goal=(6.0, 0.0)))
    for _ in range(20):
        _, reward, terminated, _, info = env.step(AHEAD)
        if terminated:
            break
    assert info["outcome"] == "tilt" and -10.1 < reward < -9.4
    assert env.vehicle.state().tilt > np.deg2rad(30)


@pytest.mark.parametrize("place", [(5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (0.0, -5.0)])
def test_every_edge_is_out_of_bounds(place):
    course = SimpleNamespace(goal=np.array([3.0, 3.0]), scene=SimpleNamespace(half=4.9 + EDGE), start=np.zeros(3))
    rover = SimpleNamespace(
        state=lambda: SimpleNamespace(position=(*place, 0.0), tilt=0.0),
        contacts=lambda: SimpleNamespace(collision=False),
    )
    assert Referee(course, ZHURONG, 9.0).judge(rover, 0.2, 1) == "out_of_bounds"
