"""Score a stereo method of your own beside M3Depth and SGBM, from Python.

    python -m marssim.generate --out data/small --pairs 12 --views-per-scene 4 --seed 1 --renderer scan
    python examples/own_estimator.py

The same class drives the rover and is scored by the commands:

    cd examples
    python -m m3depth.evaluate --data ../data/small --out out/own --estimator own_estimator:Blocks
    python -m envs.evaluate --perception own_estimator:Blocks --dynamics kinematic --episodes 1 --out out/own_drive
"""

from pathlib import Path

import cv2
import numpy as np
import tyro

from m3depth import Prediction, load_estimator
from m3depth.stereo.classical import fill_background
from marssim import StereoDataset, StereoRig


class Blocks:
    """OpenCV's block matcher: fast, and blind where it sees no texture and in the left 192 columns."""

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Return the maps of the left image.

        Args:
            left: (H, W) or (H, W, 3) uint8, RGB, rectified.
            right: The same of the right eye.
            rig: The cameras of these images.
        """
        grey = [cv2.cvtColor(eye, cv2.COLOR_RGB2GRAY) if eye.ndim == 3 else eye for eye in (left, right)]
        disparity = cv2.StereoBM.create(192, 15).compute(*grey).astype(np.float32) / 16  # [px]
        disparity[disparity <= 0] = np.nan  # NaN: unknown
        confidence = np.isfinite(disparity).astype(np.float32)  # 1: matched, 0: filled
        disparity = fill_background(disparity)
        return Prediction(rig.fb / disparity, disparity, None, confidence)  # depth [m]; None: no normals


def main(data: Path = Path("data/small"), pairs: int = 4) -> None:
    """Print each method's mean error of disparity, and its share of confident pixels, where both eyes see the ground.

    Args:
        data: Dataset folder.
        pairs: Number of pairs to score.
    """
    if not data.is_dir():
        settings = "--pairs 12 --views-per-scene 4 --seed 1 --renderer scan"
        raise SystemExit(f"{data}: no such folder; make it with: python -m marssim.generate --out {data} {settings}")
    methods = {"Blocks": Blocks(), "SGBM": load_estimator("sgbm"), "M3Depth": load_estimator("m3depth")}
    samples = StereoDataset(data)
    chosen = [samples[n] for n in range(min(pairs, len(samples)))]
    print(f"{'method':8} {'error [px]':>10} {'trusted':>8}")
    for name, method in methods.items():
        errors, trusted = [], []
        for sample in chosen:
            scored = sample.valid & ~sample.occluded
            prediction = method.infer(sample.left, sample.right, sample.rig)
            trusted.append((prediction.confidence[scored] >= 0.5).mean())
            errors.append(np.abs(prediction.disparity - sample.disparity)[scored].mean())
        print(f"{name:8} {np.mean(errors):10.2f} {np.mean(trusted):8.0%}")


if __name__ == "__main__":
    tyro.cli(main)
