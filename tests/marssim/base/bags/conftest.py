"""A bag of three looks of a turning rover whose odometry errs, and readers of it by two projects."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from marssim.base.bags.messages import SECOND
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.rover_spec import ZHURONG

RIG = StereoRig(PinholeCamera(16, 12, 20.0, 21.0, 7.3, 5.9), baseline=0.27)
STAMPS = [SECOND + 500_000_001, 2 * SECOND, 3 * SECOND]


@dataclass
class Drive:
    """What the bag was made of."""

    path: Path
    rig: StereoRig = RIG
    stamps: list[int] = field(default_factory=lambda: STAMPS)
    left: list[np.ndarray] = field(default_factory=list)
    right: list[np.ndarray] = field(default_factory=list)
    depth: list[np.ndarray] = field(default_factory=list)
    body: list[np.ndarray] = field(default_factory=list)
    believed: list[np.ndarray] = field(default_factory=list)
    camera: list[np.ndarray] = field(default_factory=list)


def pose(x: float, y: float, yaw: float, tilt: float = 0.0) -> np.ndarray:
    """Return a (4, 4) pose of a rover."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("zy", [yaw, tilt]).as_matrix()
    out[:3, 3] = x, y, 0.1
    return out


@pytest.fixture(scope="session")
def drive(tmp_path_factory) -> Drive:
    """Do not change its files."""
    made, rng = Drive(tmp_path_factory.mktemp("bags") / "drive"), np.random.default_rng(0)
    with StereoBagWriter(made.path) as bag:
        for number, stamp in enumerate(STAMPS):
            made.left.append(rng.integers(0, 256, (12, 16, 3)).astype(np.uint8))
            made.right.append(rng.integers(0, 256, (12, 16, 3)).astype(np.uint8))
            depth = rng.uniform(1, 9, (12, 16)).astype(np.float32)
            depth[0], depth[1] = np.inf, np.nan
            made.depth.append(depth)
            made.body.append(pose(2.0 * number, 1.0, 0.4 * number, 0.05))
            made.believed.append(pose(2.1 * number, 1.1, 0.38 * number, 0.05))
            made.camera.append(made.body[-1] @ ZHURONG.mount.left_eye(RIG.baseline, pan=0.3 * number))
            bag.write_images(stamp, made.left[-1], made.right[-1], RIG)
            bag.write_depth(stamp, depth, RIG.camera)
            bag.write_disparity(stamp, depth, RIG)
            seen = np.isfinite(depth)
            points = (RIG.camera.rays() * np.where(seen, depth, 0)[..., None])[seen]
            bag.write_cloud(stamp, points, made.left[-1][seen])
            bag.write_pose(stamp, made.body[-1], made.camera[-1], RIG.baseline, made.believed[-1])
            bag.write_command(stamp, 0.1 * number, -0.05)
            bag.write_status(stamp, "drive")
            bag.write_path(stamp, np.array([[0.0, 0, 0], [1, 1, 0]]))
            bag.write_goal(stamp, np.array([9.0, 8, 0]))
    return made


@dataclass(frozen=True)
class Read:
    """A message as a reader of another project gives it."""

    topic: str
    kind: str
    recorded: int
    message: Any


def by_rosbags(path: Path) -> list[Read]:
    """Read a bag with `rosbags`, which wrote it; metadata.yaml included."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return [
            Read(c.topic, c.msgtype.replace("/msg/", "/"), time, reader.deserialize(raw, c.msgtype))
            for c, time, raw in reader.messages()
        ]


def by_mcap(path: Path) -> list[Read]:
    """Read a bag's file with Foxglove's `mcap`, by the message definitions in the file alone."""
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    (file,) = path.glob("*.mcap")
    with file.open("rb") as stream:
        messages = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()], validate_crcs=True)
        return [
            Read(channel.topic, schema.name.replace("/msg/", "/"), message.log_time, content)
            for schema, channel, message, content in messages.iter_decoded_messages()
        ]


@pytest.fixture(params=[by_rosbags, by_mcap], ids=["rosbags", "mcap"])
def read_all(request):
    """A function that returns all messages of a bag, by each of the two projects."""
    return request.param
