"""The estimator of docs/guides/own-estimator.md is the rover's perception; the driver of own-driver.md drives it."""

import json

import numpy as np
import pytest

from envs.evaluate import main
from envs.world.eyes import EyesConfig

pytestmark = pytest.mark.usefixtures("undrawn_figures")


def test_the_rover_takes_it_by_class_path(make_env, my_stereo):
    env = make_env(perception=my_stereo, goal_distance=4.0, eyes=EyesConfig())
    observation, info = env.reset(seed=0)
    assert type(env.perception.estimator).__name__ == "Blocks"
    assert observation in env.observation_space and info["perception_seconds"] > 0
    matched = env.sight.confidence == 1  # the rest is filled, with a confidence of 0
    assert 0.1 < matched.mean() < 1 and set(np.unique(env.sight.confidence)) == {0, 1}
    assert np.isfinite(env.sight.depth[matched]).all() and np.isfinite(env.sight.depth[~matched]).any()
    observation, *_ = env.step(np.array([0.5, 0.0]))
    assert observation in env.observation_space


def test_the_driver_drives_by_its_class_path(guide_program, tmp_path, monkeypatch, capsys):
    (tmp_path / "my_driver.py").write_text(guide_program("my_driver.py"))
    monkeypatch.syspath_prepend(str(tmp_path))
    flags = ["--perception", "ground_truth", "--dynamics", "kinematic", "--goal-distance", "5", "--k", "0.01"]
    flags += ["--episodes", "1", "--no-videos"]
    assert main(["--driver", "my_driver:Wary", "--out", str(tmp_path / "out"), *flags]) == 0
    (row,) = json.loads((tmp_path / "out" / "results.json").read_text())["results"]
    assert row["outcomes"] == {"goal": 1} and "my_driver:Wary" in capsys.readouterr().out
