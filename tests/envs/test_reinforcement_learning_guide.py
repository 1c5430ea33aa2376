"""The lines of docs/guides/reinforcement-learning.md: those for CleanRL log the returns, a reward is as it says."""

import math
import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

from envs import Corridors
from envs.drivers.corridors import AHEAD, WAYS

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "reinforcement-learning.md"
LEFT = 0  # number of the way at 90 deg
DISTANCE = 2 * WAYS  # index of the goal's distance in what Corridors shows


@pytest.fixture(scope="module")
def recipe():
    """The three pieces of Python of the guide's part on CleanRL."""
    part = GUIDE.read_text().split("\n## With CleanRL\n")[1].split("\n## ")[0]
    return re.findall(r"```python\n(.*?)```", part, re.DOTALL)


def test_a_reward_of_ones_own_is_the_share_of_the_way_that_a_step_saves(small_scene):
    (program,) = re.findall(r"```python\n(# hurry\.py\n.*?)```", GUIDE.read_text(), re.DOTALL)
    exec(program, names := {})
    bare = gymnasium.make(
        "envs:MarsNav-v0", perception="ground_truth", dynamics="kinematic", scene=small_scene, goal_distance=3.0, k=0.0
    )
    env = names["Hurry"](bare)
    _, info = env.reset(seed=1)
    assert info["to_go"] == info["shortest"]
    before = info["to_go"]
    _, reward, *_, info = env.step(np.array([1.0, 0.0], np.float32))
    assert info["to_go"] < before - 0.2
    assert reward == pytest.approx((before - info["to_go"]) / info["shortest"] - 0.01)

    way, to_go = bare.unwrapped.way, info["to_go"]
    advance = way.advance

    def lost(place):
        progress = advance(place)
        way.to_go = math.inf
        return progress

    way.advance = lost
    assert env.step(np.array([0.0, 0.0], np.float32))[1] == pytest.approx(-0.01)
    way.advance = advance
    _, reward, *_, info = env.step(np.array([1.0, 0.0], np.float32))
    assert reward == pytest.approx((to_go - info["to_go"]) / info["shortest"] - 0.01)


@pytest.fixture
def vector(recipe, small_scene):
    """Two environments as CleanRL makes them with the guide's lines, but in a small place, with near goals."""
    small = {"scene": small_scene, "goal_distance": 3.0, "k": 0.0}

    def make_env():
        names = {"Corridors": Corridors, "gym": SimpleNamespace(make=made)}
        exec(recipe[0], names)
        return gymnasium.wrappers.RecordEpisodeStatistics(names["env"])

    def made(name, **settings):
        return gymnasium.make(name, **{**settings, **small})

    mode = eval(f"dict({recipe[1]})", {"gym": gymnasium})
    envs = gymnasium.vector.SyncVectorEnv([make_env] * 2, **mode)
    yield envs
    envs.close()


def test_the_return_of_an_episode_is_logged_in_the_step_that_ends_it(recipe, vector, capsys):
    vector.reset(seed=1)
    logged = {}
    writer = SimpleNamespace(add_scalar=lambda name, value, step: logged.update({(name, step): value}))
    total = np.zeros(2)
    for step in range(1, 10):
        seen, rewards, terminated, truncated, infos = vector.step(np.array([AHEAD, LEFT]))
        total += rewards
        exec(recipe[2], {"infos": infos, "writer": writer, "global_step": step, "np": np})
        if terminated.any() or truncated.any():
            break
        assert not logged
    assert terminated.tolist() == [True, False] and not truncated.any()
    assert infos["final_info"]["outcome"].tolist() == ["goal", None]
    assert logged.keys() == {("charts/episodic_return", step), ("charts/episodic_length", step)}
    assert logged["charts/episodic_return", step] == pytest.approx(total[0]) and total[0] > 10
    assert logged["charts/episodic_length", step] == step
    assert capsys.readouterr().out == f"global_step={step}, episodic_return={logged['charts/episodic_return', step]}\n"
    assert seen[0, DISTANCE] > infos["final_obs"][0][DISTANCE]  # the next episode has begun
    assert vector.step(np.array([AHEAD, LEFT]))[1].all()  # and its first action counts
