import zipfile

import pytest

pytest.importorskip("stable_baselines3")

from envs.drivers import make_driver
from envs.train_ppo import TrainConfig, main, train


def test_it_trains_goes_on_and_what_it_saves_drives(tmp_path, make_env):
    config = {"out": tmp_path, "workers": 1, "goal_distance": 3.0, "scene": "utopia"}
    path = train(TrainConfig(**config, max_steps=16), rollout=16)
    first = zipfile.ZipFile(path).read("policy.pth")
    assert train(TrainConfig(**config, max_steps=32), rollout=16) == path
    assert zipfile.ZipFile(path).read("policy.pth") != first
    env = make_env(mast=True, map_observation=True)
    observation, _ = env.reset(seed=0)
    driver = make_driver(str(path))
    driver.reset(env, 0)
    assert driver.needs_map and driver.act(env, observation) in env.action_space


def test_no_time_is_named(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "out"), "--max-minutes", "0"]) == 2
    assert "--max-minutes" in capsys.readouterr().err and not (tmp_path / "out").exists()
