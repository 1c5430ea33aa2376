"""The bag of a prediction: depth, disparity and points of the pairs of another bag, with their stamps and frames.

It is made of the files of the pairs, so that it does not depend on how often a run was stopped.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.prediction.files import CLOUD, RECORD, read_cloud
from m3depth.prediction.options import CloudFrame
from m3depth.prediction.sources.bag_pairs import BagPairs
from marssim.base.bags.library import new_message
from marssim.base.bags.messages import SECOND, frames_message
from marssim.base.bags.names import BASE_LINK
from marssim.base.bags.reader import stamp_of
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.bags.transform_reader import FRAMES_KIND, frame_topics
from marssim.base.camera import StereoRig
from marssim.base.dataset.map_file import find_map, read_map_file
from marssim.base.files.json_file import read_json
from marssim.base.images.pointcloud import FAR
from marssim.base.pose import ROVER_KEY

BAG = "bag"  # folder in --out
MARGIN = 10 * SECOND  # [ns] before the first pair and after the last one in which moving frames are kept, as tf2 does


def write_bag(out: Path, source: BagPairs, names: Sequence[str], cloud_frame: CloudFrame) -> None:
    """Write the bag: what the folders of the pairs hold, and the frames of the source.

    Args:
        out: The folder of the results.
        source: The pairs that they are of.
        names: Folders of the pairs in it, in order.
        cloud_frame: Frame of their clouds.

    Raises:
        OSError: The bag cannot be written.
    """
    records = {name: read_json(out / name / RECORD) for name in names}
    stamps = [int(record["stamp_ns"]) for record in records.values()] or [0]
    frames = {"camera": source.frame, "rover": source.rover or BASE_LINK, "world": source.world or ""}
    fixed: dict[str, Any] = {}
    stands_alone = source.rover is None and source.transforms.parent(source.frame) is None
    if cloud_frame == "rover" and stands_alone and records:  # only --mount says where it is
        mount = np.array(next(iter(records.values()))[ROVER_KEY])
        fixed[source.frame] = frames_message(stamps[0], [(BASE_LINK, source.frame, mount)]).transforms[0]
    farthest = 0.0
    with StereoBagWriter(out / BAG, replace=True) as bag:
        _write_frames(bag, source, fixed, stamps)
        for name, record in records.items():
            stamp, rig = record["stamp_ns"], StereoRig.from_dict(record["rig"])
            path = find_map(out / name, "depth")
            assert path is not None  # --write bag needs depth
            depth = read_map_file(path, "depth")
            bag.write_depth(stamp, depth, rig.camera, source.frame)
            bag.write_disparity(stamp, depth, rig, source.frame)
            if (out / name / CLOUD).is_file():
                points, colours = read_cloud(out / name / CLOUD)
                farthest = max(farthest, float(np.abs(points).max(initial=0)))
                bag.write_cloud(stamp, points, colours, frames[cloud_frame])
    if farthest > FAR:
        print(
            f"warning: {out / BAG}: points are up to {farthest:.0f} m from the origin of {frames[cloud_frame]}, where "
            f"the 32-bit numbers of its clouds are {1000 * np.spacing(np.float32(farthest)):.0f} mm apart; .ply files "
            "have 64 bits",
            file=sys.stderr,
        )


def _write_frames(bag: StereoBagWriter, source: BagPairs, fixed: dict[str, Any], stamps: Sequence[int]) -> None:
    """Write the frames of the source.

    Fixed frames come at the first pair, since their own stamps may be 0, or of another clock: a bag that began or
    ended there would be played for decades.

    Args:
        bag: The bag.
        source: The pairs.
        fixed: More of the fixed frames, by their names; those of the source are added.
        stamps: Times of the pairs [ns].
    """
    moving_topic, fixed_topic = frame_topics(source.bag, source.topics.left)
    begin = min(stamps)
    start, end = max(begin - MARGIN, 0), max(stamps) + MARGIN
    for _, message in source.bag.messages([fixed_topic]):
        fixed.update({item.child_frame_id: item for item in message.transforms})
    if fixed:
        message = new_message(FRAMES_KIND, transforms=list(fixed.values()))
        bag.write(fixed_topic, begin, message, latched=True)
    for _, message in source.bag.messages([moving_topic]):
        if message.transforms and start <= (stamp := stamp_of(message.transforms[0])) <= end:
            bag.write(moving_topic, stamp, message)
    for child in sorted(source.transforms.odometry):
        parent = source.transforms.parent(child)
        assert parent is not None
        for stamp, pose in source.transforms.moves(child).items():
            if start <= stamp <= end:
                bag.write(moving_topic, stamp, frames_message(stamp, [(parent, child, pose)]))
