"""The estimator of docs/other_methods.md is a perception of the rover."""

import numpy as np


def test_the_rover_takes_it_by_class_path(make_env, my_stereo):
    env = make_env(perception=my_stereo, goal_distance=4.0)
    observation, info = env.reset(seed=0)
    assert type(env.eyes.estimator).__name__ == "Blocks"
    assert observation in env.observation_space and info["perception_seconds"] > 0
    assert np.isnan(env.sight.depth).any() and np.isfinite(env.sight.depth).mean() > 0.1
    observation, *_ = env.step(np.array([0.5, 0.0]))
    assert observation in env.observation_space
