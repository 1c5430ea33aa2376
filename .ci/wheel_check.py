"""Run from an empty folder with the installed wheel: the environment is made, and a pair of images predicted."""

import subprocess
import sys
from pathlib import Path

import cv2
import gymnasium

from marssim.base.dataset.dataset import StereoDataset

env = gymnasium.make("envs:MarsNav-v0", perception="ground_truth", dynamics="physics")
observation, info = env.reset(seed=1)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
assert env.observation_space.contains(observation), observation
env.close()
print("MarsNav-v0:", info)


def run(*command: str) -> None:
    print("$", *command)
    subprocess.run([sys.executable, *command], check=True)


run("-m", "marssim.generate", "--out", "data", "--pairs", "1", "--renderer", "embree")
sample = StereoDataset("data")[0]
cv2.imwrite("left.png", sample.left[..., ::-1])
cv2.imwrite("right.png", sample.right[..., ::-1])
run("-m", "m3depth.predict", "left.png", "right.png", "--focal", "595.9", "--baseline", "0.27", "--out", "predicted")
assert (Path("predicted") / "depth.npy").is_file()
print("wheel: good")
