"""Pairs of a ROS 2 bag: images by their stamps, cameras from CameraInfo, poses from TF or odometry."""

from __future__ import annotations

import sys
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.datasets.image_files import as_pair
from m3depth.datasets.pair_files import CalibrationReader
from m3depth.prediction.masks import read_valid
from m3depth.prediction.options import PredictOptions, Rectify
from m3depth.prediction.sources.raw_eye import RawEye
from marssim.base.bags.camera_info import (
    raw_camera,
    rectified_camera,
    rectifies_to_another_camera,
    shows_raw_images,
)
from marssim.base.bags.images import check_encoding, image_array
from marssim.base.bags.messages import SECOND
from marssim.base.bags.reader import Bag, stamp_of
from marssim.base.bags.stereo_topics import find_stereo_topics, is_rectified, match_stamps
from marssim.base.bags.transform_reader import read_transforms
from marssim.base.bags.transforms import ROVER_FRAMES
from marssim.base.calibration.camera_info import CameraInfo
from marssim.base.calibration.rectified import Calibration, calibration_of_infos
from marssim.base.camera import PinholeCamera
from marssim.base.files.json_file import DatasetError
from marssim.base.pose import FARTHEST


@dataclass(frozen=True)
class _Eye:
    """One eye from a time [ns] on; `raw` rectifies its images, where they are not rectified."""

    stamp: int
    info: CameraInfo
    raw: RawEye | None


class BagPairs:
    """The pairs of a bag, in the order of their stamps. Raw images are rectified.

    Attributes:
        bag: The open bag.
        paths: Its files.
        count: Number of pairs.
        rate: Pairs a second; 0 if there are less than one a second.
        topics: The topics of the pair.
        frame: Frame of the left images.
        rover: Frame of the rover on which the cameras are; None if the bag has none.
        world: Frame of the poses; None if the bag has none.
        transforms: The frames of the bag.
        is_raw: Whether the images are rectified here.

    Args:
        path: The bag.
        images: Topics of the left and the right images; None to find them.
        infos: Topics of their CameraInfo; None for those beside the images.
        tolerance: Largest difference of two stamps of a pair [s].
        needs_infos: Whether the bag must have a CameraInfo of both eyes.
        rectify: Whether images whose CameraInfo has a distortion or a rotation are rectified: auto does so where the
            name of the topic does not say that they are rectified, always whatever it says.
        masks: Masks of the left images, or of both eyes, as they are in the bag; images that are rectified here take
            them with them.

    Raises:
        ImportError: `rosbags` is not installed.
        DatasetError: The bag cannot be read, or lacks something; the message names it.
    """

    def __init__(
        self,
        path: Path,
        images: tuple[str, str] | None = None,
        infos: tuple[str, str] | None = None,
        tolerance: float = 0.01,
        needs_infos: bool = True,
        rectify: Rectify = "auto",
        masks: Sequence[Path] = (),
    ) -> None:
        if not path.exists():
            raise FileNotFoundError(f"{path}: no such file or folder")
        self.bag = Bag(path)
        self.paths = tuple(sorted(path.iterdir())) if path.is_dir() else (path,)
        self.topics = find_stereo_topics(self.bag, images, infos)
        self._pairs, (left, right) = match_stamps(self.bag, self.topics, tolerance)
        if left or right:
            print(
                f"warning: {path}: {left} left and {right} right images have no partner within {tolerance:g} s",
                file=sys.stderr,
            )
        self.count = len(self._pairs)
        steps = np.diff([entry.stamp for entry, _ in self._pairs]) / SECOND
        rate = 1 / float(np.median(steps)) if len(steps) else 0.0
        self.rate = rate if rate >= 1 else 0.0
        t = self.topics
        sides = ((t.left, t.left_info), (t.right, t.right_info)) if needs_infos else ()
        of_eyes = [*masks, None, None]
        self._eyes = [self._read_eyes(*side, rectify, mask) for side, mask in zip(sides, of_eyes)]
        self._of_pairs = self._calibrations() if needs_infos else []
        self.is_raw = any(eye.raw is not None for eyes in self._eyes for eye in eyes)
        if self.is_raw:
            print(f"note: the images of {t.left} and {t.right} are rectified as their CameraInfo say", file=sys.stderr)
        self.transforms = read_transforms(self.bag, t.left)
        first = [self.bag.message(entry) for entry in self._pairs[0]]
        for topic, message in zip((self.topics.left, self.topics.right), first, strict=True):
            try:
                check_encoding(message)  # which is that of all pairs
            except ValueError as error:
                raise DatasetError(f"{path}, {topic}: {error}") from None
        self.frame = str(first[0].header.frame_id)
        self.rover = self.transforms.rover(self.frame)
        if all(self.on_rover(n) is None for n in range(self.count)):
            self.rover = None  # its frames say nothing at any pair, so that --mount counts
        self.world = self._world()

    def stamp(self, number: int) -> int:
        """Return the stamp of the left image of a pair [ns]."""
        return self._pairs[number][0].stamp

    def record(self, number: int) -> dict[str, Any]:
        """Return what prediction.json says of a pair."""
        topics = [self.topics.left, self.topics.right]
        return {"frame": number, "stamp_ns": self.stamp(number), "topics": topics, "rectified_here": self.is_raw}

    def read(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return both images of a pair, uint8, grey or RGB.

        Raises:
            DatasetError: A message cannot be read, or its encoding is not supported; the message names bag and topic.
        """
        images = []
        for side, entry in enumerate(self._pairs[number]):
            eye = self._eye(side, entry.stamp)
            where = f"{self.bag.path}, {entry.topic} at {entry.stamp / SECOND:.3f} s"
            try:
                image = image_array(self.bag.message(entry))
                if image.dtype not in (np.uint8, np.uint16):
                    raise ValueError(f"holds {image.dtype}; images must have 8 or 16 bits")
                images.append((image if eye is None or eye.raw is None else eye.raw.rectified(image), where))
            except DatasetError:
                raise
            except ValueError as error:
                raise DatasetError(f"{where}: {error}") from None
        return as_pair(images[0][0], images[1][0], images[0][1], images[1][1])

    def calibration(self, number: int) -> CalibrationReader:
        """Return what gives the calibration of a pair: by the last CameraInfo of each eye before it, or the first."""
        calibration = self._of_pairs[number]
        return lambda width, height: calibration

    def pose(self, number: int) -> np.ndarray | None:
        """Return the pose of the left camera in the world, (4, 4); None if it is not known."""
        return None if self.world is None else self.transforms.pose(self.frame, self.stamp(number), self.world)

    def on_rover(self, number: int) -> np.ndarray | None:
        """Return the pose of the left camera in the frame of the rover, (4, 4); None if it is not known then."""
        return None if self.rover is None else self.transforms.pose(self.frame, self.stamp(number), self.rover)

    def raw_frame(self, number: int) -> np.ndarray | None:
        """Return the pose of the rectified left camera in the frame of the raw one, (4, 4); None if it is not raw."""
        eye = self._eye(0, self.stamp(number))
        return None if eye is None or eye.raw is None else eye.raw.rectified_to_raw

    def valid(self, number: int) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return where the images of a pair show what the cameras saw, (H, W) bool each; None: everywhere."""
        eyes = (self._eye(side, entry.stamp) for side, entry in enumerate(self._pairs[number]))
        left, right = (None if eye is None or eye.raw is None else eye.raw.shown for eye in eyes)
        return left, right

    def _world(self) -> str | None:
        """Return the frame of the poses, and tell what of the frames cannot be used."""
        if len(self.transforms) and self.transforms.parent(self.frame) is None:
            print(
                f"warning: {self.bag.path}: no frame says where {self.frame!r} is, which is that of {self.topics.left}",
                file=sys.stderr,
            )
        for child, kept, others in self.transforms.other_parents(self.frame):
            print(
                f"warning: {self.bag.path}: {child} is recorded in {kept} and in {', '.join(others)}; {kept} is used",
                file=sys.stderr,
            )
        world = self.transforms.world(self.frame)
        poses = (self.transforms.pose(self.frame, self.stamp(n), world) for n in range(self.count if world else 0))
        if any(pose is not None and np.abs(pose[:3, 3]).max() > FARTHEST for pose in poses):
            print(
                f"warning: {self.bag.path}: the cameras are over {FARTHEST:g} m from the origin of {world}, so there "
                "are no poses; record a frame named map whose origin is near the drive, or give --poses",
                file=sys.stderr,
            )
            return None
        return world

    def _eye(self, side: int, stamp: int) -> _Eye | None:
        """Return an eye (0 is the left one) at a time [ns]: by its last CameraInfo before, or the first."""
        return self._eyes[side][self._place(side, stamp)] if self._eyes else None

    def _place(self, side: int, stamp: int) -> int:
        """Return the place of such an eye in the list of its side."""
        return max(bisect_right(self._eyes[side], stamp, key=lambda eye: eye.stamp) - 1, 0)

    def _calibrations(self) -> list[Calibration]:
        """Return the calibration of each pair.

        Raises:
            DatasetError: The eyes are exchanged, or their CameraInfo have no baseline.
        """
        made: dict[tuple[int, int], Calibration] = {}  # by the places of both eyes in their lists
        calibrations = []
        for entries in self._pairs:
            first, second = (self._place(side, entry.stamp) for side, entry in enumerate(entries))
            if (first, second) not in made:
                left, right = self._eyes[0][first], self._eyes[1][second]
                try:
                    made[first, second] = calibration_of_infos(left.info, right.info)
                except ValueError as error:
                    raise DatasetError(f"{self.bag.path}, {self.topics.left_info}: {error}") from None
            calibrations.append(made[first, second])
        return calibrations

    def _read_eyes(self, image: str, topic: str | None, rectify: Rectify, mask: Path | None) -> list[_Eye]:
        """Return an eye for each CameraInfo that differs from the one before, by their stamps.

        Args:
            image: Topic of the images.
            topic: That of their CameraInfo.
            rectify: See the class.
            mask: Mask of the images.

        Raises:
            DatasetError: There is no CameraInfo, or it holds no calibration that can be used.
        """
        if topic is None:
            raise DatasetError(
                f"{self.bag.path}: has no sensor_msgs/CameraInfo beside {image}; name two topics with --camera-info, "
                "or give a calibration file with --calib"
            )
        eyes: list[_Eye] = []
        last: tuple[Any, ...] = ()
        for _, message in self.bag.messages([topic]):
            content = _content(message)
            if content == last:
                continue
            last = content
            try:
                info, raw = rectified_camera(message), None
                is_asked = rectify == "always" or (rectify == "auto" and not is_rectified(image))
                differs = shows_raw_images(message) or (rectify == "always" and rectifies_to_another_camera(message))
                if is_asked and differs:
                    p = info.projection
                    assert info.size is not None
                    ideal = PinholeCamera(*info.size, p[0, 0], p[1, 1], p[0, 2], p[1, 2])
                    raw = RawEye(raw_camera(message), ideal, read_valid(None, mask, info.size[::-1]))
            except ValueError as error:
                raise DatasetError(f"{self.bag.path}, {topic}: {error}") from None
            eyes.append(_Eye(stamp_of(message), info, raw))
        if not eyes:
            raise DatasetError(f"{self.bag.path}: has lost the messages of {topic}, of which its index speaks")
        return sorted(eyes, key=lambda eye: eye.stamp)


def check_result_bag(options: PredictOptions, bag: BagPairs) -> None:
    """Raise ValueError if the bag of results would lack the frame of its clouds, or its maps cannot tell the sky."""
    if "bag" in options.write and not {"npy", "tiff"} & set(options.map_format):
        raise ValueError(
            f"--map-format {' '.join(options.map_format)}: the bag of the results is made of the maps, and these do "
            "not tell sky from unknown; add npy, or leave bag out of --write"
        )
    if not {"bag", "cloud"} <= set(options.write):
        return
    if options.poses is not None and options.cloud_frame == "world":
        raise ValueError(
            f"--cloud-frame world: the clouds would be in the world of {options.poses}, which is no frame of the bag; "
            "leave bag out of --write, or --poses"
        )
    if options.cloud_frame == "rover" and bag.rover is None and bag.transforms.parent(bag.frame) is not None:
        raise ValueError(
            f"--cloud-frame rover: {bag.frame} of {bag.bag.path} is not known in a frame of a rover "
            f"({', '.join(ROVER_FRAMES)}); take camera or world, or leave bag out of --write"
        )


def _content(message: Any) -> tuple[Any, ...]:
    """Return what a CameraInfo says about its camera and its images."""
    values = b"".join(np.asarray(x, float).tobytes() for x in (message.p, message.k, message.d, message.r))
    roi = message.roi
    return (
        values, message.distortion_model, message.width, message.height, message.binning_x, message.binning_y,
        roi.x_offset, roi.y_offset, roi.width, roi.height,
    )  # fmt: skip
