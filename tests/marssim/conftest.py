"""A small dataset whose pixels have a closed form: level ground, a board that stands on it, and the sky."""

from pathlib import Path

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.dataset import write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import write_sample
from marssim.base.pose import look_pose

RIG = StereoRig(PinholeCamera(64, 48, 70.0, 75.0, 30.3, 22.7), baseline=0.27)  # principal point off the middle
HEIGHT, PITCH = 1.2, np.deg2rad(12)
BOARD = (
    -0.5,
    0.4,
    3.0,
)  # x from, x to, z [m], camera frame; it reaches from the ground to 0.3 m above the camera's axis
NAMES = [f"{scene:05d}/{view:02d}" for scene in range(4) for view in range(2)]  # train, test, val, train


def look(yaw: float, across: float) -> tuple[np.ndarray, ...]:
    """Return depth, normal, surface and image (H, W, 3) of a camera `across` [m] to the right of the left one."""
    rays = RIG.camera.rays()
    rotation = look_pose(np.zeros(3), yaw, PITCH)[:3, :3]
    down = -rotation[2]  # of the world, in the camera's frame
    slope = rays @ down
    with np.errstate(divide="ignore"):
        ground = np.where(slope > 1e-3, HEIGHT / np.where(slope > 0, slope, 1), np.inf)
    x, y = rays[..., 0] * BOARD[2] + across, rays[..., 1] * BOARD[2]
    board = (x > BOARD[0]) & (x < BOARD[1]) & (y > -0.3) & (ground > BOARD[2])
    depth = np.where(board, BOARD[2], ground)
    sky = ~np.isfinite(depth)
    surface = np.where(board, 1, np.where(sky, -1, 0)).astype(np.int32)
    normal = np.where(board[..., None], [0.0, 0.0, -1.0], -down)
    normal[sky] = 0
    points = rays * np.where(sky, 1, depth)[..., None] + [across, 0, 0]
    shade = 120 + 40 * np.sin(7 * points[..., 0] + yaw) + 30 * np.cos(5 * points[..., 2] + 3 * points[..., 1])
    image = np.where(sky, 200, shade)[..., None] * [1.0, 0.8, 0.6]
    return depth.astype(np.float32), normal.astype(np.float32), surface, np.round(image).astype(np.uint8)


def closed_form_frame(yaw: float = 0.3) -> StereoFrame:
    """Return a stereo pair of the board on the ground."""
    depth, normal, surface, left = look(yaw, 0.0)
    right = look(yaw, RIG.baseline)[3]
    u = np.arange(RIG.camera.width)[None]
    at = u - np.nan_to_num(RIG.depth_to_disparity(depth))
    # behind the board, seen from the right eye: where the line from the ground point to that eye meets z = BOARD z
    points = RIG.camera.rays() * np.where(np.isfinite(depth), depth, 1)[..., None]
    share = BOARD[2] / points[..., 2]
    x = RIG.baseline + (points[..., 0] - RIG.baseline) * share
    y = points[..., 1] * share
    hidden = (surface == 0) & (share < 1) & (x > BOARD[0]) & (x < BOARD[1]) & (y > -0.3)
    occluded = (surface >= 0) & (hidden | (at < -0.5))
    pose = look_pose(np.array([1.0, 2.0, HEIGHT]), yaw, PITCH)
    return StereoFrame(left, right, depth, RIG.depth_to_disparity(depth), normal, surface, occluded, RIG, pose)


@pytest.fixture(scope="session")
def closed_form_set(tmp_path_factory) -> Path:
    """A folder with a dataset of eight pairs. Tests copy it before they break it."""
    path = tmp_path_factory.mktemp("closed-form") / "set"
    for name in NAMES:
        scene, view = map(int, name.split("/"))
        elevation = np.deg2rad(20 + 10 * scene)
        sun = [float(np.cos(elevation)), 0.0, float(np.sin(elevation))]
        meta = {
            "scene": scene, "view": view, "preset": "gale", "sun": sun, "sun_elevation_deg": 20.0 + 10 * scene,
            "scene_config": {"rocks": {"k": 0.07}},
        }  # fmt: skip
        write_sample(path / "scenes" / name, closed_form_frame(0.3 + scene + 0.5 * view), meta)
    write_index(path, {"seed": 3}, NAMES)
    return path
