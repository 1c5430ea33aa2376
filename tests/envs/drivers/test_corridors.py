import gymnasium
import numpy as np
import pytest
from gymnasium.utils import env_checker
from gymnasium.wrappers import FlattenObservation, OrderEnforcing
from hypothesis import given
from hypothesis import strategies as st

from envs.drivers.corridors import AHEAD, HOLD_STEPS, REACH, WAYS, Corridors, as_corridors, look_along, steer
from envs.drivers.image_observation import ImageObservation
from envs.observation.map_view import CELL, PIXELS
from envs.world.action import ActionError
from marssim.base.rover_spec import ZHURONG

angles = st.floats(-np.pi, np.pi)


def centre_of(row, column):
    """(ahead, left) [m] of a cell of the map."""
    return np.array([(PIXELS / 2 - row - 0.5) * CELL, (PIXELS / 2 - column - 0.5) * CELL])


@given(st.integers(8, PIXELS - 9), st.integers(8, PIXELS - 9), angles, st.floats(0.3, 1.2))
def test_a_way_ends_where_its_corridor_meets_the_obstacle(row, column, bearing, half_width):
    cost = np.zeros((PIXELS, PIXELS), np.float32)
    cost[row, column] = 1.0
    forward = np.array([np.cos(bearing), np.sin(bearing)])
    (x, y), at = forward, centre_of(row, column)
    ahead, aside = forward @ at, abs(x * at[1] - y * at[0])
    free = look_along(cost, np.array([bearing]), half_width)[0][0]
    unsure = 2 * CELL  # the obstacle is a square, and the way is looked at cell by cell
    if np.hypot(ahead, aside) < half_width + unsure:
        return  # the rover stands beside it: see below
    if ahead < 0 or aside > half_width + unsure:
        assert free == REACH
    elif aside < half_width - unsure:
        meets = ahead - np.sqrt(half_width**2 - aside**2)
        steep = half_width / np.sqrt(half_width**2 - aside**2)  # how far along one cell aside counts
        assert abs(free - min(meets, REACH)) <= unsure * steep


def test_beside_an_obstacle_the_ways_that_lead_away_from_it_are_free():
    cost = np.zeros((PIXELS, PIXELS), np.float32)
    cost[:, PIXELS // 2 - 5] = 1.0  # a wall 0.9 m to the left
    left, along, right = look_along(cost, np.array([np.pi / 2, 0, -np.pi / 2]), 1.2)[0]
    assert left < 0.3 and along == right == REACH


@pytest.mark.parametrize("beside", [False, True])
def test_an_obstacle_beside_the_rover_does_not_open_a_gap_that_is_too_narrow(beside):
    cost = np.zeros((PIXELS, PIXELS), np.float32)
    cost[14:18, :29] = cost[14:18, 35:] = 1.0  # a wall 2.8 m ahead, with a gap of 1.2 m
    if beside:
        cost[32:34, 34:36] = 1.0  # 0.4 m to the right
    free = look_along(cost, np.array([0.0]), 0.6)[0][0]
    assert free == pytest.approx(2.6, abs=CELL)


def test_what_the_map_shows_under_the_rover_is_no_obstacle():
    cost = np.zeros((PIXELS, PIXELS), np.float32)
    cost[20, :] = 1.0  # a wall 2.3 m ahead
    goal, state = np.array([5.0, 0.0, 1.0], np.float32), np.zeros(6, np.float32)
    expected = as_corridors({"map": np.stack([cost] * 3), "goal": goal, "state": state}, ZHURONG)
    cost[30:34, 30:34] = 1.0
    np.testing.assert_array_equal(
        as_corridors({"map": np.stack([cost] * 3), "goal": goal, "state": state}, ZHURONG), expected
    )


@given(st.floats(0.5, 1.4), st.floats(0.2, 4.0))
def test_room_is_the_distance_from_what_lies_beside_the_first_metres(aside, ahead):
    row, column = int(PIXELS / 2 - ahead / CELL), int(PIXELS / 2 + aside / CELL)
    cost = np.zeros((PIXELS, PIXELS), np.float32)
    cost[row, column] = 1.0  # to the right
    x, y = centre_of(row, column)
    past = max(x - 2.0, 0.0)
    expected = min(np.hypot(past, y) - CELL / 2, 1.5)
    room = look_along(cost, np.array([0.0, np.pi]), 0.6)[1]
    assert room[0] == pytest.approx(expected, abs=0.75 * CELL)
    assert room[1] >= room[0] - 0.75 * CELL


def test_open_ground_is_free_everywhere():
    free, room = look_along(np.zeros((PIXELS, PIXELS), np.float32), np.linspace(-3, 3, 7), 0.7)
    assert (free == REACH).all() and (room == 1.5).all()


@given(angles)
def test_ways_turn_with_the_goal(bearing):
    cost = np.zeros((PIXELS, PIXELS), np.float32)
    cost[PIXELS // 2 - 11, PIXELS // 2 - 1 : PIXELS // 2 + 1] = 1.0  # 2.1 m ahead
    state = np.zeros(6, np.float32)
    goal = np.array([5.0, np.sin(bearing), np.cos(bearing)], np.float32)
    seen = as_corridors({"map": np.stack([cost, cost, cost]), "goal": goal, "state": state}, ZHURONG)
    offsets = np.linspace(90, -90, WAYS)
    blocked = seen[:WAYS] < 1
    from_rock = np.abs((np.rad2deg(bearing) + offsets + 180) % 360 - 180)
    assert blocked[from_rock < 15].all() and not blocked[from_rock > 40].any()
    assert seen[2 * WAYS] == pytest.approx(0.5)


@given(angles, st.integers(0, WAYS - 1))
def test_steering_turns_towards_the_way_and_arrives_on_it(bearing, way):
    left = bearing + np.deg2rad(90 - 15 * way)
    for _ in range(12):  # half a turn at 0.5 rad a step, and some more
        speed, yaw_rate, pan = steer(np.array([7.0, np.sin(bearing), np.cos(bearing)]), way, ZHURONG)
        off = (left + np.pi) % (2 * np.pi) - np.pi
        assert abs(yaw_rate) <= 1 and pan == 0 and speed == (abs(off) < 0.5)
        left -= yaw_rate * 0.25 * 2.0
        bearing -= yaw_rate * 0.25 * 2.0
    assert abs((left + np.pi) % (2 * np.pi) - np.pi) < 1e-3 and speed == 1


@pytest.mark.parametrize("mast", [False, True])
def test_a_way_is_kept_for_some_steps_and_their_rewards_are_added(make_env, mast):
    env = Corridors(make_env(map_observation=True, mast=mast))
    plain = make_env(map_observation=True)
    seen, _ = env.reset(seed=3)
    observation, _ = plain.reset(seed=3)
    last = AHEAD
    for way in (2, 6):
        assert seen in env.observation_space and seen.dtype == np.float32
        np.testing.assert_array_equal(seen, as_corridors(observation, ZHURONG, last))
        assert seen[-1] == pytest.approx(1 - last / AHEAD)
        last = way
        total = 0.0
        for _ in range(HOLD_STEPS):
            observation, reward, *_ = plain.step(steer(observation["goal"], way, ZHURONG)[:2])
            total += reward
        seen, summed, *_ = env.step(way)
        assert summed == pytest.approx(total)


def test_it_ends_with_the_drive_and_not_later(make_env):
    env = Corridors(make_env(map_observation=True))
    env.reset(seed=3, options={"goal_distance": 3.0, "k": 0.0})
    ended = False
    while not ended:
        seen, reward, ended, cut, info = env.step(AHEAD)
        assert not cut
    assert info["outcome"] == "goal" and reward > 9 and seen in env.observation_space


def test_it_needs_the_map_of_the_environment_itself(make_env):
    needed = "^Corridors needs the observations of MarsNav-v0 made with map_observation=True, got "
    mapped = make_env(map_observation=True)
    for wrong in (make_env(), ImageObservation(mapped), FlattenObservation(mapped), gymnasium.make("CartPole-v1")):
        with pytest.raises(ValueError, match=needed):
            Corridors(wrong)
    assert isinstance(Corridors(OrderEnforcing(mapped)), Corridors)


@pytest.mark.filterwarnings("ignore:.*WARN")
def test_gymnasium_accepts_it(make_env):
    env_checker.check_env(Corridors(make_env(map_observation=True)), skip_render_check=True, skip_close_check=True)


@pytest.mark.parametrize("wrapper", [Corridors, ImageObservation])
def test_gymnasium_makes_it_again_from_its_spec(small_scene, wrapper):
    """As its checker does, and a vector environment of a spec."""
    settings = {"goal_distance": 3.0, "map_observation": True, "perception": "ground_truth", "dynamics": "kinematic"}
    env = wrapper(gymnasium.make("envs:MarsNav-v0", scene=small_scene, **settings))
    again = gymnasium.make(env.spec)
    assert type(again) is wrapper and again.observation_space == env.observation_space
    assert again.unwrapped.map_view is not None
    for each in (env, again):
        each.close()


@pytest.mark.parametrize("action", [-1, WAYS, 3.0, 12.7, np.nan, "left"])
def test_a_way_that_does_not_exist_is_named(make_env, action):
    env = Corridors(make_env(map_observation=True))
    env.reset(seed=0)
    with pytest.raises(ActionError, match=rf"^action must be the number of a way, 0 to {WAYS - 1}, got {action!r}$"):
        env.step(action)
    env.step(np.int64(AHEAD))
