"""The bag of a prediction: depth, disparity and points of the pairs of another bag, with their stamps and frames.

It is made of the files of the pairs, so that it does not depend on how often a run was stopped.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m3depth.prediction.files import CLOUD, RECORD, read_cloud
from m3depth.prediction.options import CloudFrame
from m3depth.prediction.sources.bag_pairs import BagPairs
from marssim.base.bags.names import BASE_LINK, MOVING_FRAMES, STATIC_FRAMES
from marssim.base.bags.reader import stamp_of
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.camera import StereoRig
from marssim.base.dataset.map_file import find_map, read_map_file
from marssim.base.files.json_file import read_json

BAG = "bag"  # folder in --out


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
    # fixed frames often have the stamp 0; a bag that began there would be played for decades before its first image
    begin = min((int(record["stamp_ns"]) for record in records.values()), default=0)
    frames = {"camera": source.frame, "rover": BASE_LINK, "world": source.world or ""}
    with StereoBagWriter(out / BAG, replace=True) as bag:
        for topic, message in source.bag.messages([STATIC_FRAMES, MOVING_FRAMES]):
            if message.transforms:
                stamp, fixed = stamp_of(message.transforms[0]), topic == STATIC_FRAMES
                bag.write(topic, max(stamp, begin) if fixed else stamp, message, latched=fixed)
        for name, record in records.items():
            stamp, rig = record["stamp_ns"], StereoRig.from_dict(record["rig"])
            path = find_map(out / name, "depth")
            assert path is not None  # --write bag needs depth
            depth = read_map_file(path, "depth")
            bag.write_depth(stamp, depth, rig.camera, source.frame)
            bag.write_disparity(stamp, depth, rig, source.frame)
            if (out / name / CLOUD).is_file():
                bag.write_cloud(stamp, *read_cloud(out / name / CLOUD), frames[cloud_frame])
