import re
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium import spaces

pytest.importorskip("stable_baselines3")

from envs.drivers.by_name import make_driver
from envs.drivers.corridors import AHEAD, WAYS, corridor_space
from envs.drivers.way_policy import WayPolicy, WayScores


def random_vectors(number, seed=0):
    """(number, 36) of what Corridors may show: ways, room, goal, state, last way."""
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(-np.pi, np.pi, (number, 1))
    ways, goal = (
        rng.uniform(0, 1, (number, 2 * WAYS)),
        [rng.uniform(0, 1, (number, 1)), np.sin(bearing), np.cos(bearing)],
    )
    return np.concatenate([ways, *goal, np.zeros((number, 6)), rng.uniform(-1, 1, (number, 1))], axis=1)


@pytest.fixture
def policy():
    torch.manual_seed(0)
    return WayPolicy(corridor_space(), spaces.Discrete(WAYS), lambda _: 1e-3)


def test_a_new_policy_drives_at_the_goal_and_tries_what_lies_beside_it(policy):
    shown = random_vectors(50).astype(np.float32)
    ways = policy.predict(shown, deterministic=True)[0]
    assert np.abs(ways - AHEAD).max() <= 1 and np.mean(ways == AHEAD) > 0.5
    tried = np.concatenate([policy.predict(shown)[0] for _ in range(40)])
    assert 1.5 < np.std(tried) < 2.5


def test_a_way_is_scored_by_itself_and_its_neighbours_only():
    shown = torch.tensor(random_vectors(4), dtype=torch.float32)
    scores = WayScores()
    before = scores.forward_actor(shown)
    shown[:, 3] = 0.0
    shown[:, WAYS + 3] = 0.0
    changed = (scores.forward_actor(shown) != before).any(dim=0)
    assert changed[2:5].all() and not changed[:2].any() and not changed[5:].any()


def test_it_learns_which_way_is_free():
    """By the gradient of a policy: 200 steps on one choice each."""
    torch.manual_seed(1)
    policy = WayPolicy(corridor_space(), spaces.Discrete(WAYS), lambda _: 3e-3)
    shown = torch.tensor(random_vectors(256, 3), dtype=torch.float32)
    free = shown[:, :WAYS]
    for _ in range(200):
        way = policy.get_distribution(shown)
        drawn = way.sample()
        gain = free.gather(1, drawn[:, None])[:, 0]
        loss = -((gain - gain.mean()) * way.log_prob(drawn)).mean()
        policy.optimizer.zero_grad()
        loss.backward()
        policy.optimizer.step()
    other = torch.tensor(random_vectors(256, 4), dtype=torch.float32)
    taken = policy.get_distribution(other).distribution.probs.argmax(dim=1)
    assert other[:, :WAYS].gather(1, taken[:, None]).mean() > 0.8  # 0.5 by chance, 0.93 at best


def test_the_policy_of_the_guides_recipe_is_one_that_evaluate_drives(tmp_path, monkeypatch, make_env):
    """The script of the guide in one process, without the training."""
    from stable_baselines3 import PPO

    guide = Path(__file__).parents[3] / "docs" / "guides" / "reinforcement-learning.md"
    scripts = re.findall(r"^```python\n(.*?)^```", guide.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    (recipe,) = (script for script in scripts if "PPO(" in script)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(PPO, "learn", lambda self, steps: None)
    exec(recipe.replace("SubprocVecEnv", "DummyVecEnv"), {"__name__": "__main__"})
    driver = make_driver(str(tmp_path / "policy.zip"))
    env = make_env(map_observation=True)
    driver.reset(env, 0)
    observation, _ = env.reset(seed=0)
    assert driver.corridors and env.action_space.contains(driver.act(env, observation)[: env.action_space.shape[0]])
