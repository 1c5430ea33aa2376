import sys
import types
import zipfile

import numpy as np
import pytest
import torch

from envs.drivers.by_name import make_driver
from envs.drivers.corridors import HOLD_STEPS, Corridors
from envs.drivers.image_observation import ImageObservation
from envs.drivers.policy_archive import mark_corridors


class Standing:
    def reset(self, env, seed):
        self.seed = seed

    def act(self, env, observation):
        return np.zeros(3, np.float32)


def test_a_class_path_is_a_driver(monkeypatch):
    monkeypatch.setitem(sys.modules, "some_drivers", types.SimpleNamespace(Standing=Standing, Nothing=object))
    assert isinstance(make_driver("some_drivers:Standing"), Standing)
    for name in ("some_drivers:Nothing", "some_drivers:Missing", "no_such_module:Standing"):
        with pytest.raises(ValueError, match=name):
            make_driver(name)


@pytest.mark.parametrize("map_observation", [False, True])
def test_a_trained_policy_drives_as_it_does_in_its_own_library(make_env, tmp_path, map_observation):
    sb3 = pytest.importorskip("stable_baselines3")
    trained_in = ImageObservation(make_env(map_observation=map_observation))
    model = sb3.PPO("MultiInputPolicy", trained_in, n_steps=8, batch_size=8, device="cpu", seed=0)
    model.save(tmp_path / "policy.zip")
    driver = make_driver(str(tmp_path / "policy.zip"))
    assert driver.needs_map == map_observation
    env = make_env(map_observation=True, mast=True)
    observation, _ = env.reset(seed=4)
    driver.reset(env, 4)
    action = driver.act(env, observation)
    images = {key: value for key, value in ImageObservation(env).observation(observation).items()
           if key in trained_in.observation_space.spaces}  # fmt: skip
    np.testing.assert_allclose(action[:2], model.predict(images, deterministic=True)[0], atol=1e-6)
    assert action.shape == (3,) and action[2] == 0 and action in env.action_space
    assert not driver.corridors


def test_a_policy_that_moves_the_mast_sees_where_it_looks(make_env, tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    trained_in = ImageObservation(make_env(mast=True))
    model = sb3.PPO("MultiInputPolicy", trained_in, n_steps=8, batch_size=8, device="cpu", seed=0)
    model.save(tmp_path / "policy.zip")
    driver, env = make_driver(str(tmp_path / "policy.zip")), make_env(map_observation=True, mast=True)
    env.reset(seed=4)
    driver.reset(env, 4)
    observation = env.step(np.array([0.0, 0.0, 0.5], np.float32))[0]
    assert observation["pan"] == pytest.approx([0.5]) and observation["pan"] in env.observation_space["pan"]
    images = {key: trained_in.observation(observation)[key] for key in trained_in.observation_space.spaces}
    action = driver.act(env, observation)
    np.testing.assert_allclose(action, model.predict(images, deterministic=True)[0], atol=1e-6)
    other = driver.act(env, {**observation, "pan": -observation["pan"]})
    assert np.abs(action - other).max() > 1e-6


def test_a_policy_of_corridors_drives_as_it_was_trained(make_env, tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    from envs.drivers.way_policy import WayPolicy

    model = sb3.PPO(WayPolicy, Corridors(make_env(map_observation=True)), n_steps=8, batch_size=8, seed=0)
    with torch.no_grad():
        model.policy.action_net.weight.mul_(100)  # untrained it all but always takes one way, which shows little
    model.save(tmp_path / "policy.zip")
    mark_corridors(tmp_path / "policy.zip")
    driver = make_driver(str(tmp_path / "policy.zip"))
    assert driver.needs_map and driver.corridors
    env, trained_in = make_env(map_observation=True, mast=True), Corridors(make_env(map_observation=True))
    for seed in (4, 5):  # a new drive begins with a new way, though the last one's was not driven to its end
        observation, _ = env.reset(seed=seed)
        seen, _ = trained_in.reset(seed=seed)
        driver.reset(env, seed)
        for _ in range(2):
            for _ in range(HOLD_STEPS):
                observation = env.step(driver.act(env, observation))[0]
            seen = trained_in.step(model.predict(seen, deterministic=True)[0])[0]
            np.testing.assert_allclose(observation["state"], seen[-7:-1], atol=1e-5)
        driver.act(env, observation)
    sb3.PPO.load(tmp_path / "policy.zip")  # still a file of its own library


def test_a_file_that_is_missing_is_not_made_to_be_marked(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"typo\.zip"):
        mark_corridors(tmp_path / "typo.zip")
    assert not any(tmp_path.iterdir())


def test_weights_of_other_sizes_are_named(make_env, tmp_path):
    pytest.importorskip("stable_baselines3")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive, archive.open("policy.pth", "w") as file:
        torch.save({"action_net.weight": torch.zeros(1, 1)}, file)
    mark_corridors(tmp_path / "other.zip")
    with pytest.raises(ValueError, match=r"other\.zip: is no policy for these observations"):
        make_driver(str(tmp_path / "other.zip")).reset(make_env(map_observation=True), 0)


@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 2)])
def test_actions_of_other_sizes_are_named(make_env, tmp_path, shape):
    pytest.importorskip("stable_baselines3")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive, archive.open("policy.pth", "w") as file:
        torch.save({"action_net.weight": torch.zeros(1, 1), "log_std": torch.zeros(shape)}, file)
    with pytest.raises(ValueError, match=r"other\.zip: an action must have 2 or 3 numbers, log_std has the shape"):
        make_driver(str(tmp_path / "other.zip")).reset(make_env(), 0)


def test_files_that_are_no_policies_are_named(tmp_path):
    (tmp_path / "text.zip").write_text("no archive")
    with pytest.raises(ValueError, match=r"text\.zip"):
        make_driver(str(tmp_path / "text.zip"))
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive, archive.open("policy.pth", "w") as file:
        torch.save({"weight": torch.zeros(3)}, file)
    with pytest.raises(ValueError, match=r"other\.zip: holds no policy .* \(policy\.pth has no action_net\.weight\)"):
        make_driver(str(tmp_path / "other.zip"))
    with pytest.raises(FileNotFoundError, match=r"none\.zip"):
        make_driver(str(tmp_path / "none.zip"))
