"""Samples of a RockWorld as a dataset holds them, with exact depth, rock numbers and the camera's pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rock_world import RockWorld

from marssim.base.camera import NATECAM, StereoRig
from marssim.base.dataset.sample import StereoSample
from marssim.base.pose import look_pose

RIG = NATECAM.resized(256, 256)
HEIGHT, PITCH = 1.2, np.deg2rad(20.0)
DOMES = (  # distance ahead, to the left, radius, height [m]
    (3.0, -0.5, 0.3, 0.25), (5.0, 0.6, 0.5, 0.4), (9.0, -1.5, 0.6, 0.55), (2.5, 0.5, 0.25, 0.12),
)  # fmt: skip


def domes_on_a_plain(slope: tuple[float, float] = (0.0, 0.0)) -> RockWorld:
    """DOMES on a plain of a slope along x and y."""
    domes = [(*ahead(distance, aside), radius, height) for distance, aside, radius, height in DOMES]
    return RockWorld(domes=np.array(domes), slope=slope)


def rock_sample(world: RockWorld, rig: StereoRig = RIG, yaw: float = 0.4) -> StereoSample:
    """What a camera at (0, 0), 1.2 m above the plain, sees; the images are noise and the normals none."""
    pose = look_pose(np.array([0.0, 0.0, HEIGHT]), yaw, PITCH)
    depth = world.depth(rig, pose)
    rock = np.zeros(depth.shape, np.int32)
    plain = RockWorld(slope=world.slope).depth(rig, pose)
    for i in range(len(world.domes)):
        alone = replace(world, domes=world.domes[i : i + 1], boxes=np.zeros((0, 5))).depth(rig, pose)
        rock[(alone == depth) & (alone < plain)] = i + 1
    for i in range(len(world.boxes)):
        alone = replace(world, domes=np.zeros((0, 4)), boxes=world.boxes[i : i + 1]).depth(rig, pose)
        rock[(alone == depth) & (alone < plain)] = len(world.domes) + i + 1
    image = np.random.default_rng(0).integers(0, 255, (*depth.shape, 3), dtype=np.uint8)
    return StereoSample(
        image, image, depth, rig.depth_to_disparity(depth), np.zeros((*depth.shape, 3), np.float32),
        (depth >= 0.5) & (depth <= 15), np.zeros(depth.shape, bool), rock, rig, {"pose": pose.tolist()},
    )  # fmt: skip


def ahead(distance: float, aside: float, yaw: float = 0.4) -> tuple[float, float]:
    """Place (x, y) [m] so far ahead of the camera, and so far to its left."""
    c, s = np.cos(yaw), np.sin(yaw)
    return float(c * distance - s * aside), float(s * distance + c * aside)


def without_rocks(sample: StereoSample, keep: tuple[int, ...] = ()) -> np.ndarray:
    """(H, W) the sample's depth with the rocks melted into the plain, but for those numbers."""
    pose = np.array(sample.meta["pose"])
    plain = RockWorld().depth(sample.rig, pose)
    return np.where((sample.rock > 0) & ~np.isin(sample.rock, keep), plain, sample.depth)
