"""Many pairs against as many calls of infer, and the memory that the run holds.

PREDICT_PAIRS sets the number of pairs, PREDICT_METHOD the method.
"""

import os
import resource
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
import pytest

from m3depth.datasets.image_files import read_pair
from m3depth.estimator import load_estimator
from m3depth.predict import predict
from m3depth.prediction.options import PredictOptions
from m3depth.stereo.classical import SGBM
from marssim.base.camera import NATECAM

pytestmark = pytest.mark.benchmark
PAIRS = int(os.environ.get("PREDICT_PAIRS", "100"))
METHOD = os.environ.get("PREDICT_METHOD", "m3depth")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Pairs of 512 x 512 of a plane with the texture of smoothed noise, 20 px farther left in the right eye."""
    root, rng = tmp_path_factory.mktemp("pairs"), np.random.default_rng(0)
    for number in range(PAIRS):
        noise = cv2.GaussianBlur(rng.standard_normal((512, 552, 3)).astype(np.float32), (0, 0), 1.5)
        wall = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        for eye, first in (("left", 0), ("right", 20)):
            (root / eye).mkdir(exist_ok=True)
            cv2.imwrite(str(root / eye / f"{number:03d}.png"), wall[:, first : first + 512])
    return root


@pytest.fixture(scope="module")
def estimator():
    return SGBM() if METHOD == "sgbm" else load_estimator(METHOD)


@pytest.mark.parametrize("everything", [False, True])
def test_many_pairs_and_as_many_calls_of_infer(folder, estimator, tmp_path, capsys, everything):
    """The figures to reach: 1.3 with depth and confidence as npy, 2.5 with every output, at constant memory."""
    left, right = read_pair(folder / "left/000.png", folder / "right/000.png")
    estimator.infer(left, right, NATECAM)
    start = perf_counter()
    for _ in range(PAIRS):
        estimator.infer(left, right, NATECAM)
    alone = perf_counter() - start
    chosen = {} if everything else {"write": ("depth", "confidence"), "map_format": ("npy",)}
    patterns = {"left": "left/*.png", "right": "right/*.png"}
    options = PredictOptions((folder,), tmp_path, calib=(Path("natecam"),), video=everything, **patterns, **chosen)
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    start = perf_counter()
    batch = predict(options, estimator)
    together = perf_counter() - start
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - held
    with capsys.disabled():
        what = "every output" if everything else "depth and confidence as npy"
        print(
            f"\n{PAIRS} pairs, {what}: {together:.1f} s, {together / alone:.2f} times {PAIRS} infer ({alone:.1f} s); "
            f"peak memory grew by {grown:.0f} MiB"
        )
    assert len(batch.done) == PAIRS and (tmp_path / "000/depth.npy").is_file()
