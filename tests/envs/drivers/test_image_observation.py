import gymnasium
import numpy as np
import pytest

from envs.drivers.image_observation import ImageObservation, as_images


def test_images_are_of_their_space_and_lose_no_obstacle(make_env):
    env = ImageObservation(make_env(map_observation=True))
    inner = env.env
    observation, _ = env.reset(seed=2)
    assert observation in env.observation_space
    plain = inner._observation()
    assert ((observation["map"][1] == 255) == (plain["map"][1] > 0.998)).all()
    depth = plain["depth"]
    order = np.argsort(depth[depth > 0].ravel())
    assert (np.diff(observation["depth"][0][depth > 0].ravel()[order].astype(int)) <= 0).all()  # nearer is brighter


def test_ends_of_the_scales():
    observation = {
        "depth": np.array([[0.0, 15.0], [0.3, 0.5]], np.float32), "goal": np.array([5.0, 0.6, 0.8], np.float32),
        "state": np.zeros(6, np.float32),
    }  # fmt: skip
    seen = as_images(observation)
    np.testing.assert_array_equal(seen["depth"], [[[0, 0], [255, 255]]])
    np.testing.assert_allclose(seen["goal"], [0.5, 0.6, 0.8])
    assert observation["goal"][0] == 5.0  # the original is as it was


def test_it_shows_the_environment_itself(make_env):
    for wrong in (ImageObservation(make_env()), gymnasium.make("CartPole-v1")):
        with pytest.raises(ValueError, match=r"^ImageObservation needs the observations of MarsNav-v0, got "):
            ImageObservation(wrong)
