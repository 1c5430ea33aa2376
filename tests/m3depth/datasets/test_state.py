"""The digest of a split changes with every file that its samples are read from."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.open import open_pairs
from m3depth.datasets.state import state_of_files, state_of_pairs
from marssim.base.dataset.dataset import StereoDataset


def image(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.zeros((20, 30), np.uint16))
    return path


def test_a_changed_calibration_or_mask_of_a_benchmark_is_other_data(tmp_path: Path) -> None:
    for folder in ("image_2", "image_3", "disp_occ_0", "disp_noc_0"):
        image(tmp_path / f"training/{folder}/000000_10.png")
    calib = tmp_path / "training/calib_cam_to_cam/000000.txt"
    calib.parent.mkdir()
    states = []
    for content in ("P2: 1", "P2: 10"):
        calib.write_text(content)
        states.append(state_of_pairs(open_pairs(tmp_path, "all")))
    with (tmp_path / "training/disp_noc_0/000000_10.png").open("ab") as file:
        file.write(b"0")
    states.append(state_of_pairs(open_pairs(tmp_path, "all")))
    assert all(a != b for a, b in pairwise(states))


def test_data_without_such_files_keep_their_digest(tmp_path: Path, plane_set: Path) -> None:
    files = [image(tmp_path / f"{name}/0.png") for name in ("left", "right", "depth")]
    config = DataConfig(left="left/*.png", right="right/*.png", depth="depth/*.png", focal=40.0, baseline=0.2)
    assert state_of_pairs(open_pairs(tmp_path, "all", config)) == state_of_files(files)
    assert state_of_pairs(open_pairs(plane_set, "all")) == StereoDataset(plane_set).digest
