"""Which topics of a bag are a stereo pair, and which of their messages belong together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from marssim.base.bags.messages import SECOND
from marssim.base.bags.reader import Bag, Entry
from marssim.base.files.json_file import DatasetError

IMAGES = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
INFO = "sensor_msgs/CameraInfo"
EYES = (("left", "right"), ("infra1", "infra2"), ("cam0", "cam1"))  # how drivers name the two eyes


@dataclass(frozen=True)
class StereoTopics:
    """The topics of a stereo pair: images, and sensor_msgs/CameraInfo (None where the bag has none beside them)."""

    left: str
    right: str
    left_info: str | None
    right_info: str | None


def find_stereo_topics(
    bag: Bag, images: tuple[str, str] | None = None, infos: tuple[str, str] | None = None
) -> StereoTopics:
    """Return the topics of the rectified pair in a bag.

    Args:
        bag: The bag.
        images: Topics of the left and the right image; None to find them by "left" and "right" in their names.
        infos: Topics of the left and the right CameraInfo; None for those beside the images.

    Raises:
        DatasetError: There is no pair, there are several, or a topic is missing or of another type; the message lists
            the topics that there are.
    """
    left, right = images or _only_pair(bag)
    for topic in (left, right):
        _check_kind(bag, topic, IMAGES)
    for topic in infos or ():
        _check_kind(bag, topic, (INFO,))
    left_info, right_info = infos or (_info_beside(bag, left), _info_beside(bag, right))
    return StereoTopics(left, right, left_info, right_info)


def is_rectified(topic: str) -> bool:
    """Return whether the name of a topic says that its images are rectified, as image_rect or rectified/image does."""
    return re.search(r"(?<![a-z])rect(?![a-hj-z])", topic) is not None


def match_stamps(bag: Bag, topics: StereoTopics, tolerance: float) -> tuple[list[tuple[Entry, Entry]], tuple[int, int]]:
    """Return the messages of both eyes that were taken at one time, in order.

    Two images are a pair if each is the other's nearest in time.

    Args:
        bag: The bag.
        topics: Its stereo pair.
        tolerance: Largest difference of their stamps [s].

    Returns:
        The pairs, and how many left and right images have no partner.

    Raises:
        DatasetError: No two stamps lie that near, or all images of an eye have one stamp.
    """
    entries = bag.entries([topics.left, topics.right])
    left, right = (_of_topic(bag, entries, topic) for topic in (topics.left, topics.right))
    stamps = [np.array([entry.stamp for entry in eye]) for eye in (left, right)]
    partner, back = _nearest(*stamps), _nearest(*stamps[::-1])
    apart = np.abs(stamps[0] - stamps[1][partner]) / SECOND
    mutual = (back[partner] == np.arange(len(left))) & (apart <= tolerance)
    pairs = [(left[i], right[partner[i]]) for i in np.flatnonzero(mutual)]
    if not pairs:
        raise DatasetError(
            f"{bag.path}: no images of {topics.left} and {topics.right} lie within {tolerance:g} s of each other; the "
            f"nearest two are {apart.min():.3g} s apart"
        )
    return pairs, (len(left) - len(pairs), len(right) - len(pairs))


def _nearest(times: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the index of the nearest of the other times (both sorted) for each time."""
    after = np.clip(np.searchsorted(others, times), 1, max(len(others) - 1, 1))
    after = np.minimum(after, len(others) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(others[before] - times) <= np.abs(others[after] - times), before, after)


def _of_topic(bag: Bag, entries: Sequence[Entry], topic: str) -> list[Entry]:
    """Return the messages of a topic in the order of their stamps, one for each stamp."""
    by_stamp = {entry.stamp: entry for entry in entries if entry.topic == topic}
    if not by_stamp:
        raise DatasetError(f"{bag.path}: has lost the images of {topic}, of which its index speaks")
    count = sum(entry.topic == topic for entry in entries)
    if count > 1 and len(by_stamp) == 1:
        raise DatasetError(
            f"{bag.path}: all {count} images of {topic} have the stamp {next(iter(by_stamp)) / SECOND:g} s, so that "
            "nothing says which images belong together"
        )
    return [by_stamp[stamp] for stamp in sorted(by_stamp)]


def _only_pair(bag: Bag) -> tuple[str, str]:
    """Return the image topics of the two eyes: rectified before raw ones, whole before compressed ones."""
    topics = bag.topics_of(*IMAGES)
    pairs = []
    for left in topics:
        for one, other in EYES:
            right = re.sub(rf"(?<![a-z]){one}(?![a-z])", other, left)
            if right != left and right in topics:
                pairs.append((left, right))
    if not pairs:
        lone = [topic for topic in topics if re.search(r"(?<![a-z])left(?![a-z])", topic)]
        what = f"has images of the left eye ({lone[0]}), none of the right one" if lone else "has no stereo pair"
        raise DatasetError(f"{bag.path}: {what}; it has {_listed(bag)}: name two with --left and --right")
    best = min(map(_rank, pairs))
    chosen = [pair for pair in pairs if _rank(pair) == best]
    if len(chosen) > 1:
        several = ", ".join(pair[0] for pair in chosen)
        raise DatasetError(f"{bag.path}: has several stereo pairs ({several}): choose one with --left and --right")
    return chosen[0]


def _rank(pair: tuple[str, str]) -> tuple[bool, bool, bool]:
    name = pair[0]
    return not is_rectified(name), "compressed" in name, "color" not in name and "colour" not in name


def _info_beside(bag: Bag, topic: str) -> str | None:
    """Return the CameraInfo topic of an image topic: /eye/camera_info of /eye/image or of /eye/image/compressed."""
    folder = topic
    for _ in range(2):
        folder = folder.rpartition("/")[0]
        if bag.topics.get(f"{folder}/camera_info") == INFO:
            return f"{folder}/camera_info"
    return None


def _check_kind(bag: Bag, topic: str, kinds: Sequence[str]) -> None:
    if topic not in bag.topics:
        raise DatasetError(f"{bag.path}: has no messages of {topic}; it has {_listed(bag)}")
    if bag.topics[topic] not in kinds:
        raise DatasetError(f"{bag.path}: {topic} is {bag.topics[topic]}, not {' or '.join(kinds)}")


def _listed(bag: Bag) -> str:
    return ", ".join(bag.topics_of(*IMAGES, INFO)) or "no images at all"
