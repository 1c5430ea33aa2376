"""Small stereo samples whose ground truth is known in closed form."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from plane_pairs import plane_sample

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.dataset import write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import StereoSample, write_sample

RIG = StereoRig(PinholeCamera(64, 48, 70.0, 75.0, 30.3, 22.7), baseline=0.27)
NAMES = [f"{scene:05d}/{view:02d}" for scene in range(4) for view in range(2)]  # train, test, val, train


@pytest.fixture(scope="session")
def plane_samples() -> list[StereoSample]:
    return [plane_sample(seed) for seed in range(4)]


@pytest.fixture(scope="session")
def large_samples() -> list[StereoSample]:
    """Pairs of a rig whose disparities are found in reduced pairs, of half the size."""
    return [plane_sample(seed, 128, 192, 800.0) for seed in range(4)]


def plane_frame(seed: int) -> StereoFrame:
    """A textured plane below a sky, with a block that hides part of it."""
    rng = np.random.default_rng(seed)
    camera = RIG.camera
    normal = np.array([0.1, -1.0, -0.3]) / np.linalg.norm([0.1, -1.0, -0.3])
    facing = -(camera.rays() @ normal)
    ground = facing > 0.08
    depth = np.where(ground, 1.2 / np.where(ground, facing, 1), np.inf).astype(np.float32)
    depth[30:40, 20:30] = 1.0  # the block, nearer than the ground behind it
    disparity = RIG.depth_to_disparity(depth)
    right = cv2.GaussianBlur(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8), (0, 0), 1.0)
    u, v = np.meshgrid(np.arange(64, dtype=np.float32), np.arange(48, dtype=np.float32))
    left = cv2.remap(right, u - disparity, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    sky = ~np.isfinite(depth)
    surface = np.where(sky, -1, 0).astype(np.int32)
    normals = np.where(sky[..., None], 0, normal).astype(np.float32)
    occluded = ~sky & ((u - disparity < 0) | ((u > 12) & (u < 20) & (v >= 30) & (v < 40)))
    return StereoFrame(left, right, depth, disparity, normals, surface, occluded, RIG, np.eye(4))


@pytest.fixture(scope="session")
def plane_set(tmp_path_factory) -> Path:
    """A dataset folder of eight pairs."""
    path = tmp_path_factory.mktemp("planes") / "set"
    for number, name in enumerate(NAMES):
        scene, view = map(int, name.split("/"))
        meta = {
            "scene": scene, "view": view, "preset": "gale", "sun": [1.0, 0.0, 0.5], "sun_elevation_deg": 30.0,
            "scene_config": {"rocks": {"k": 0.07}},
        }  # fmt: skip
        write_sample(path / "scenes" / name, plane_frame(number), meta)
    write_index(path, {"seed": 3}, NAMES)
    return path


@pytest.fixture(scope="session")
def large_set(tmp_path_factory, large_samples) -> Path:
    """A dataset folder of eight pairs whose disparities are found in reduced pairs."""
    path = tmp_path_factory.mktemp("large") / "large"
    for number, name in enumerate(NAMES):
        s = large_samples[number % len(large_samples)]
        surface = np.where(np.isfinite(s.depth), 0, -1).astype(np.int32)
        pair = StereoFrame(
            s.left, s.right, s.depth, s.disparity, s.normal, surface, s.occluded, s.rig, np.eye(4)
        )  # fmt: skip
        scene, view = map(int, name.split("/"))
        write_sample(path / "scenes" / name, pair, {"scene": scene, "view": view})
    write_index(path, {"seed": 4}, NAMES)
    return path


@pytest.fixture
def undrawn_rows(monkeypatch) -> None:
    """Let an empty file stand for the picture of a pair's rows, which takes longer than to rectify the pair."""
    monkeypatch.setattr(
        "m3depth.rectification.figure.rows_figure", lambda left, right, pair, path: path.write_bytes(b"")
    )
