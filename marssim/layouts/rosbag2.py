"""ROS 2 bags of a dataset: one of each scene, in marssim.base.bags' frames and topics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from marssim.base.bags.messages import SECOND
from marssim.base.bags.reader import METADATA
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.dataset.sample import recorded_mount, recorded_time
from marssim.base.files.json_file import DatasetError
from marssim.base.pose import recorded_pose
from marssim.base.rover_spec import ZHURONG
from marssim.layouts.layout import Item

ABOUT = """\
ROS 2 bags (MCAP), one of each scene, as `SPLIT/SCENE`. `ros2 bag play SPLIT/SCENE` plays one; `rosbags` and `mcap` read
it without ROS. The topics are `/stereo/left/image_rect` and `/stereo/right/image_rect` (rgb8) with `camera_info` beside
each, `/stereo/depth/image_rect` (32FC1 [m], left eye; inf in the sky), `/ground_truth/pose` (of `base_link` in `map`),
`/odom`, `/tf` and `/tf_static`. Stamps begin at 1 s. Those of a drive are the times of its views; other views are 1 s
apart. `base_link` is the rover, where the dataset records its place: in a drive (`--trajectory`), and where it is in
view (`--view.rover 1 1`). Elsewhere it is where a rover like Zhurong would be whose mast holds the left camera 1.2 m
high and 20 deg down: it lies above or below the ground, and tilted, where the cameras have another height, pitch or
roll.
"""


def write_scene_bag(out: Path, items: Sequence[Item]) -> None:
    """Write the bag of a scene, unless it is there.

    Args:
        out: Folder of the export.
        items: The views of the scene, in order.

    Raises:
        DatasetError: A file of a view is missing or broken; the message names it.
        ImportError: `rosbags` is not installed.
        OSError: The bag cannot be written.
    """
    path = out / items[0].split / items[0].name.partition("/")[0]
    if (path / METADATA).is_file():
        return
    with StereoBagWriter(path) as bag:
        for number, item in enumerate(items):
            _write_view(bag, Item(item.folder, item.name, item.split, item.number), number)


def _write_view(bag: StereoBagWriter, item: Item, number: int) -> None:
    for name in ("left.png", "right.png"):
        item.image(name)  # raises DatasetError if it is not the recorded one
    sample = item.sample
    file = item.folder / "sample.json"
    try:
        stamp = round((1 + recorded_time(sample.meta, number)) * SECOND)
        camera = recorded_pose(sample.meta.get("pose"))
        mount = recorded_mount(sample.meta)
        body = _rover_at(camera, sample.rig.baseline) if mount is None else camera @ np.linalg.inv(mount)
    except ValueError as error:
        raise DatasetError(f"{file}: {error}") from None
    bag.write_images(stamp, sample.left, sample.right, sample.rig)
    bag.write_depth(stamp, sample.depth, sample.rig.camera)
    bag.write_pose(stamp, body, camera, sample.rig.baseline)


def _rover_at(camera: np.ndarray, baseline: float) -> np.ndarray:
    """Return the pose of a rover, (4, 4) body to world, whose mast looks ahead from a camera's pose.

    The mount is fixed, so the rover is on the ground and level with it only if the camera is 1.2 m high, looks 20 deg
    down and has no roll.
    """
    return np.asarray(camera @ np.linalg.inv(ZHURONG.mount.left_eye(baseline)))
