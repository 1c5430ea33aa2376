"""A bag of textured planes, with anything in it replaced or left out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from marssim.base.bags.messages import SECOND
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.rover_spec import ZHURONG

STAMPS = [3 * SECOND // 2, 2 * SECOND, 5 * SECOND // 2, 3 * SECOND]


class Changed(StereoBagWriter):
    """A bag whose messages pass through `change(topic, message)`, which returns None to leave one out."""

    change: Callable = staticmethod(lambda topic, message: message)

    def write(self, topic, stamp, message, latched=False):
        message = self.change(topic, message)
        if message is not None:
            super().write(topic, stamp, message, latched)


def pose_of(number: int) -> np.ndarray:
    """Return the (4, 4) pose of the rover at a pair."""
    body = np.eye(4)
    body[:3, 3] = number, 0.5, 0.1
    return body


def write_planes(path: Path, samples, change=None) -> Path:
    """Write a bag of samples that a rover takes on its way along x."""
    with Changed(path) as bag:
        if change is not None:
            bag.change = change
        for number, (sample, stamp) in enumerate(zip(samples, STAMPS)):
            body, rig = pose_of(number), sample.rig
            bag.write_images(stamp, sample.left, sample.right, rig)
            bag.write_pose(stamp, body, body @ ZHURONG.mount.left_eye(rig.baseline), rig.baseline)
    return path
