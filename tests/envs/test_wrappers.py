import numpy as np

from envs.drivers import StraightDriver
from envs.wrappers import ImageObservation, StraightResidual, as_images


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


def test_nought_added_to_straight_is_straight(make_env):
    plain, residual, driver = make_env(), StraightResidual(make_env()), StraightDriver()
    seen, _ = plain.reset(seed=3)
    corrected, _ = residual.reset(seed=3)
    for _ in range(6):
        seen = plain.step(driver.act(plain, seen)[:2])[0]
        corrected = residual.step(np.zeros(2, np.float32))[0]
        np.testing.assert_array_equal(seen["state"], corrected["state"])
        np.testing.assert_array_equal(seen["goal"], corrected["goal"])


def test_a_correction_turns_away_from_straight_within_the_bounds(make_env):
    env = StraightResidual(make_env())
    observation, _ = env.reset(seed=3)
    base = StraightDriver().act(env.unwrapped, observation)[:2]
    added = np.array([-0.5, 1.0], np.float32)
    observation = env.step(added)[0]
    np.testing.assert_allclose(observation["state"][-2:], np.clip(base + added, -1, 1), atol=1e-6)
