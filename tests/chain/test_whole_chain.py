"""The whole chain, small: generate, train, score, predict, navigate, drive. `make quick` runs it."""

import json

import gymnasium
import numpy as np
import pytest

from m3depth import M3Depth
from m3depth import evaluate as evaluate_command
from m3depth import predict as predict_command
from m3depth import train as train_command
from marssim import generate as generate_command
from marssim.base.right_image import image_disparity
from marssim.dataset import StereoDataset
from nav import Navigator

RIG = ["--rig.width", "128", "--rig.height", "128", "--rig.focal", "149"]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    out = tmp_path_factory.mktemp("chain") / "data"
    scenes = ["--pairs", "3", "--views-per-scene", "1", "--workers", "1", "--renderer", "scan"]
    assert generate_command.main(["--out", str(out), *scenes, *RIG]) == 0
    return out


@pytest.fixture(scope="module")
def sample(data):
    return StereoDataset(data, split="test")[0]


def test_a_dataset_has_the_three_splits_and_exact_disparity(data):
    dataset = StereoDataset(data)
    assert [len(StereoDataset(data, split=split)) for split in ("train", "val", "test")] == [1, 1, 1]
    for sample in dataset:
        known = np.isfinite(sample.depth)
        expected = image_disparity(sample.rig, sample.depth, np.array(sample.meta["right_rotation"]))
        assert np.allclose(sample.disparity[known], expected[known], rtol=1e-5)
        assert (sample.normal[known] * sample.rig.camera.rays()[known]).sum(axis=-1).max() < 0


def test_two_steps_of_training_give_weights_that_are_scored(data, tmp_path):
    run, score = tmp_path / "run", tmp_path / "score"
    steps = ["--max-steps", "2", "--batch", "1", "--crop", "64", "64", "--validate-samples", "1", "--device", "cpu"]
    assert train_command.main(["--data", str(data), "--out", str(run), *steps]) == 0
    weights = ["--weights", str(run / "weights.safetensors"), "--baselines", "sgbm"]
    assert evaluate_command.main(["--data", str(data), "--out", str(score), *weights]) == 0
    assert len(json.loads((score / "results.json").read_text())["methods"]) == 2


def test_the_shipped_weights_see_the_ground(sample):
    prediction = M3Depth.from_pretrained().infer(sample.left, sample.right, sample.rig)
    visible = sample.valid & ~sample.occluded
    error = np.abs(prediction.depth[visible] - sample.depth[visible]) / sample.depth[visible]
    assert np.median(error) < 0.05
    normals = (prediction.normal * sample.normal).sum(axis=-1)[visible]
    assert np.median(normals) > np.cos(np.radians(30))


def test_a_prediction_is_written(data, tmp_path):
    folder = data / "scenes" / "00001" / "00"
    images = [str(folder / "left.png"), str(folder / "right.png")]
    out = tmp_path / "prediction"
    assert predict_command.main([*images, "--calib", str(folder / "sample.json"), "--out", str(out)]) == 0
    assert np.load(out / "depth.npy").shape == (128, 128)


def test_the_navigator_drives_towards_the_goal_on_true_depth(sample):
    pose = np.eye(4)
    command = Navigator().step(sample.depth, np.ones_like(sample.depth), sample.rig, pose, (8.0, 0.0))
    assert np.isfinite([command.speed, command.yaw_rate]).all()


def test_an_episode_of_mars_nav_begins_and_goes_on():
    env = gymnasium.make("envs:MarsNav-v0", perception="ground_truth", dynamics="kinematic", renderer="scan")
    observation, _ = env.reset(seed=1, options={"goal_distance": 6.0})
    distance = float(observation["goal"][0])
    for _ in range(3):
        observation, reward, terminated, _, _ = env.step(np.array([1.0, 0.0], dtype=np.float32))
        assert env.observation_space.contains(observation) and np.isfinite(reward) and not terminated
    assert float(observation["goal"][0]) != distance
    env.close()
