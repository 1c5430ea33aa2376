from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.courses.course import CLEAR_RADIUS
from envs.drivers.builtin import NavigatorDriver, RandomDriver, StraightDriver
from envs.drivers.by_name import DRIVERS, make_driver
from envs.drivers.steering import head_for
from envs.observation.map_view import MapView
from marssim.base.rover_spec import ZHURONG
from nav.config import NavigatorConfig


def observe(bearing, distance=5.0):
    return {"goal": np.array([distance, np.sin(bearing), np.cos(bearing)], np.float32)}


@pytest.mark.parametrize("name", DRIVERS)
def test_every_driver_acts_within_the_space(make_env, name):
    env = make_env(mast=True, goal_distance=4.0)
    driver = make_driver(name)
    observation, _ = env.reset(seed=1)
    driver.reset(env, 1)
    for _ in range(3):
        action = driver.act(env, observation)
        assert action in env.action_space
        observation, *_ = env.step(action)


def test_an_unknown_driver_is_named():
    with pytest.raises(
        ValueError, match=r"'magic' is unknown; choose from navigator, oracle, straight, random, FILE\.zip"
    ):
        make_driver("magic")


def test_straight_turns_to_the_goal_before_it_drives(make_env):
    env, driver = make_env(mast=True), StraightDriver()
    np.testing.assert_array_equal(driver.act(env, observe(0.0)), [1, 0, 0])
    speed, turn, _ = driver.act(env, observe(2.0))
    assert speed == 0 and turn == 1
    speed, turn, _ = driver.act(env, observe(-0.2))
    assert speed == 1 and turn == pytest.approx(-0.4)  # 0.2 rad in 2 s is 0.4 of 0.25 rad/s


@given(st.floats(-np.pi, np.pi), st.floats(0.05, 1.0))
def test_heading_for_a_bearing_arrives_on_it_and_drives_only_then(bearing, within):
    for _ in range(8):  # half a turn at 0.5 rad a step, and some more
        speed, yaw_rate, pan = head_for(bearing, within, ZHURONG)
        assert speed == (abs(bearing) < within) and abs(yaw_rate) <= 1 and pan == 0
        bearing -= yaw_rate * 0.25 * 2.0
    assert abs(bearing) < 1e-6 and speed == 1


def test_no_more_is_taken_for_clear_than_every_course_is():
    assert NavigatorDriver().navigator.config.clear_radius <= CLEAR_RADIUS


def test_straight_reaches_a_goal_on_empty_ground(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(), start=(0.0, 0.0, 2.5), goal=(3.0, -2.0)), mast=True)
    driver = StraightDriver()
    observation = env._observation()
    for _ in range(25):
        observation, _, terminated, _, info = env.step(driver.act(env, observation))
        if terminated:
            break
    assert info["outcome"] == "goal" and info["path_length"] < 1.1 * np.hypot(3, 2)


def test_random_is_a_function_of_its_seed(make_env):
    env, driver = make_env(mast=True), RandomDriver()
    runs = []
    for seed in (1, 1, 2):
        driver.reset(env, seed)
        runs.append([driver.act(env, observe(0)) for _ in range(3)])
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    assert not np.array_equal(runs[0][0], runs[0][1])


def test_the_navigator_goes_round_a_rock(on_course, make_scene, make_course):
    scene = make_scene(rocks=[(0.0, 0.0, 1.6, 0.9)])
    env = on_course(make_course(scene, start=(-3.5, 0.0, 0.0), goal=(3.0, 0.0)), mast=True)
    driver = NavigatorDriver()
    driver.reset(env, 0)
    observation, sideways = env._observation(), 0.0
    for _ in range(60):
        observation, _, terminated, _, info = env.step(driver.act(env, observation))
        sideways = max(sideways, abs(env.vehicle.state().position[1]))
        if terminated:
            break
    assert info["outcome"] == "goal"
    assert sideways > 1.0 and info["min_clearance"] > 0.05


def what_a_rover_knows(env):
    """An environment without the truth: no vehicle, no rocks, and of a look no true depth and no true pose."""
    sight = replace(env.sight, true_depth=None, pose=np.full((4, 4), np.nan))
    course = SimpleNamespace(goal=env.course.goal, area=env.course.area)
    gaze = SimpleNamespace(pan=env.gaze.pan, fresh=env.gaze.fresh)
    return SimpleNamespace(rover_spec=ZHURONG, sight=sight, gaze=gaze, believed_pose=env.believed_pose, course=course)


def test_navigator_and_map_are_given_nothing_of_the_truth(make_env):
    env = make_env(mast=True, map_observation=True, disparity_noise=1.0, drift=0.2, yaw_drift_deg=5.0)
    observation, _ = env.reset(seed=3, options={"k": 0.15})
    driver, blindfolded, map_view = NavigatorDriver(), NavigatorDriver(), MapView(ZHURONG)
    driver.reset(env, 0)
    blindfolded.reset(what_a_rover_knows(env), 0)
    map_view.start(env.believed_pose)
    for _ in range(3):
        known = what_a_rover_knows(env)
        np.testing.assert_array_equal(map_view.update(known.sight, known.believed_pose), observation["map"])
        action = driver.act(env, observation)
        np.testing.assert_array_equal(blindfolded.act(known, {}), action)
        observation, *_, info = env.step(action)
    assert info["position_error"] > 0 and (env.sight.depth != env.sight.true_depth).any()  # the truth would differ


def test_the_navigator_takes_other_settings(make_env, guide_program):
    exec(guide_program("patient.py"), names := {})
    env, driver = make_env(mast=True, goal_distance=4.0), names["Patient"]()
    observation, _ = env.reset(seed=1)
    driver.reset(env, 1)
    driver.act(env, observation)
    assert driver.navigator.config == replace(NavigatorConfig.of_rover(env.rover_spec), risk_levels=())


def test_the_navigator_forgets_with_its_reset(make_env):
    env, driver = make_env(mast=True, goal_distance=4.0), NavigatorDriver()
    actions = []
    for seed in (1, 2, 1):
        observation, _ = env.reset(seed=seed)
        driver.reset(env, seed)
        actions.append(driver.act(env, observation))
    np.testing.assert_array_equal(actions[0], actions[2])
    assert driver.navigator.spec is env.rover_spec
