"""Feed recorded images to the navigator: depth from any estimator, poses from the recording.

    python -m marssim.generate --out data/drive --trajectory --pairs 20 --views-per-scene 20 --renderer scan
    python examples/replay_navigator.py
    python examples/replay_navigator.py --estimator m3depth

`python -m nav.replay` does the same with the true depth.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro

from m3depth import Estimator, load_estimator
from marssim import StereoDataset, StereoSample
from marssim.base.dataset.sample import recorded_mount
from marssim.base.rover_spec import ZHURONG, CameraMount
from nav.replay import Frame, replay


def predicted(dataset: StereoDataset, estimator: Estimator) -> Iterator[Frame]:
    """Yield each image of the drive with the depth that the estimator predicts for it."""
    for sample in dataset:
        depth = estimator.infer(sample.left, sample.right, sample.rig)
        pan = mount_and_pan(sample)[1]
        yield Frame(depth.depth, depth.confidence, sample.rig, np.array(sample.meta["pose"]), pan)


def mount_and_pan(sample: StereoSample) -> tuple[CameraMount, float]:
    """Return where the cameras are on the rover, and the pan of the mast [rad], as the dataset has recorded them."""
    recorded = recorded_mount(sample.meta)
    if recorded is None:
        raise SystemExit("the dataset does not say where the cameras are on the rover")
    return CameraMount.of_left_eye(recorded, sample.rig.baseline)


def main(data: Path = Path("data/drive"), estimator: str = "sgbm", ahead: float = 20.0) -> None:
    """Print the navigator's command for each image.

    Args:
        data: Dataset of one recorded drive.
        estimator: Name of the method that predicts depth: m3depth, sgbm or package.module:Class.
        ahead: Distance of the goal, straight ahead of the first image [m].
    """
    if not data.is_dir():
        settings = "--trajectory --pairs 20 --views-per-scene 20 --renderer scan"
        raise SystemExit(f"{data}: no such folder; make it with: python -m marssim.generate --out {data} {settings}")
    dataset = StereoDataset(data)
    eye = np.array(dataset[0].meta["pose"])  # (4, 4) camera to world
    forward = eye[:2, 2] / np.hypot(*eye[:2, 2])
    goal = eye[:2, 3] + ahead * forward
    rover = replace(ZHURONG, mount=mount_and_pan(dataset[0])[0])
    for number, command in enumerate(replay(predicted(dataset, load_estimator(estimator)), goal, rover)):
        print(f"image {number}: {command.status}, {command.speed:.2f} m/s, {command.yaw_rate:.2f} rad/s")


if __name__ == "__main__":
    tyro.cli(main)
