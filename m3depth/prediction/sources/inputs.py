"""The pairs that m3depth.predict is given: two files, patterns, a folder, a dataset, a list, a video or a bag."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.folders import names_of_list, numbers_by_value, partners, read_list, warn_of_lone_rights
from m3depth.datasets.image_files import read_pair
from m3depth.datasets.open import PairList, detect, open_pairs, sensors_are_named
from m3depth.datasets.rigs import NATECAM_NAME, FileRig
from m3depth.datasets.state import state_of_files
from m3depth.prediction.masks import is_valid_mask, valid_mask
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.bag_pairs import BagPairs, check_result_bag
from m3depth.prediction.sources.calibration import note_rig_beside
from m3depth.prediction.sources.pair_input import PairInput, ReadPair
from m3depth.prediction.sources.poses import given_rover_pose, read_poses, rolled, rover_pose, sample_mount, sample_pose
from m3depth.prediction.sources.raw_pairs import RawPairs, find_products, must_be_rectified
from m3depth.prediction.sources.recording import Recording
from m3depth.prediction.sources.video_frames import SUFFIXES, VideoFrames
from m3depth.rectification.files import RIG_FILE, rig_beside
from m3depth.rectification.product_names import is_product, right_of
from marssim.base.bags.reader import is_bag
from marssim.base.camera import StereoRig
from marssim.base.command.input_file import check_file
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.json_file import DatasetError


@dataclass(frozen=True)
class Inputs:
    """All pairs, in order.

    Attributes:
        pairs: The pairs.
        single: Whether it is one pair whose results lie in --out itself.
        recording: The video or the bag that the pairs are in, if they are in one.
        rectification: Rectifies the pairs, if they are raw.
        flag_files: The calibration, the masks and the poses that the flags name.
    """

    pairs: tuple[PairInput, ...]
    single: bool = False
    recording: Recording | None = None
    rectification: RawPairs | None = None
    flag_files: tuple[Path, ...] = ()

    def read(self, pair: PairInput) -> ReadPair:
        """Return a pair with both images; a raw pair is rectified.

        Raises:
            FileNotFoundError, ValueError: As m3depth.datasets.image_files.read_pair, or RawPairs.read.
            EndOfVideo: The video ends before this pair.
        """
        images = None if self.recording is None else self.recording.read(pair.number)
        if self.rectification is not None:
            return self.rectification.read(pair, self.labels(pair), images)
        if self.recording is None or images is None:
            return ReadPair(pair, *read_pair(pair.left, pair.right))
        return ReadPair(pair, *images, self.recording.valid(pair.number))

    def remaining(self, options: PredictOptions) -> PredictOptions:
        """Return the flags for pairs that are read: what rectifies them has used up calibration and masks."""
        if self.rectification is not None:
            return replace(options, calib=(), mask=())
        if isinstance(self.recording, BagPairs) and self.recording.is_raw:
            return replace(options, mask=())
        return options

    def files(self, pair: PairInput) -> tuple[Path, Path] | None:
        """Return the image files of a pair, beside which masks and the rig may lie; None if there are none."""
        is_new = self.rectification is not None and not self.rectification.keeps_geometry
        return None if self.recording is not None or is_new else pair.given

    def labels(self, pair: PairInput) -> tuple[str, str]:
        """Return what messages call the two images of a pair."""
        if self.recording is None:
            return str(pair.given[0]), str(pair.given[1])
        return f"the left image of {pair.name}", f"the right image of {pair.name}"

    def has_pose(self, pair: PairInput) -> bool:
        """Return whether the pose of the left camera in a world is known."""
        return pair.pose is not None or (pair.sample is not None and sample_pose(pair.sample) is not None)

    def pose(self, pair: PairInput, rig: StereoRig, options: PredictOptions) -> np.ndarray | None:
        """Return the pose of the left camera, (4, 4) camera to a world with z up; None if it is unknown.

        Those of --poses are of the left camera as it was given. A pair that was raw has now the axes of the rectified
        camera. The frames of a bag belong to the rectified camera, as stereo_image_proc has it, and are not turned.

        Args:
            pair: The pair, as it is read.
            rig: Its cameras.
            options: The command's flags.

        Raises:
            DatasetError: A file records something else than a pose; the message names it.
        """
        if pair.pose is None:
            return None if pair.sample is None else sample_pose(pair.sample)
        if options.poses is None:
            return pair.pose
        pose = pair.pose if pair.raw_frame is None else pair.pose @ pair.raw_frame
        if options.pose_axes == "z-up":
            return pose
        start = self._first
        world = self.on_rover(start, rig, options)
        return np.asarray(world @ (pose if start.raw_frame is None else np.linalg.inv(start.raw_frame) @ pose))

    def is_mount_assumed(self, pair: PairInput, options: PredictOptions) -> bool:
        """Return whether nothing says where the camera is on the rover, so that on_rover is a guess.

        Zhurong's cameras by name are of the rover whose place is assumed.
        """
        if self.lacks_frames(pair):
            return True
        if options.calib == (NATECAM_NAME,):
            return False
        return given_rover_pose(options, pair.given[0], 1.0, _recorded_on_rover(pair)) is None

    def on_rover(self, pair: PairInput, rig: StereoRig, options: PredictOptions) -> np.ndarray:
        """Return the pose of the left camera on the rover, (4, 4) camera to rover.

        What the frames of a bag say holds even beside --mount: the bag of the results has these frames too.

        Args:
            pair: The pair, as it is read.
            rig: Its cameras.
            options: The command's flags.

        Raises:
            DatasetError: As rover_pose.
        """
        if isinstance(self.recording, BagPairs) and pair.on_rover is not None:
            return pair.on_rover
        if self.lacks_frames(pair):
            options = replace(options, mount=None)
        recorded = _recorded_on_rover(pair)
        pose = rover_pose(options, pair.given[0], rig.baseline, recorded)
        is_known = options.mount is None and (recorded is not None or not self.is_mount_assumed(pair, options))
        return pose if is_known or pair.raw_frame is None else rolled(pose, rig.baseline, pair.raw_frame)

    def lacks_frames(self, pair: PairInput) -> bool:
        """Return whether a bag has a frame of the rover, but does not say where it is at the time of a pair."""
        return isinstance(self.recording, BagPairs) and self.recording.rover is not None and pair.on_rover is None

    @cached_property
    def _first(self) -> PairInput:
        """The first pair with its frames, also where it cannot be used."""
        return self.pairs[0] if self.rectification is None else self.rectification.placed(self.pairs[0])

    def state(self) -> dict[str, Any]:
        """Return what identifies the files that the results depend on, by which a run recognises its inputs."""
        files = (p for pair in self.pairs for p in (*pair.given, pair.sample) if p is not None)
        state: dict[str, Any] = {}
        if isinstance(self.recording, BagPairs):
            state.update(left=self.recording.topics.left, right=self.recording.topics.right)
        others = [path for path in self.flag_files if path != NATECAM_NAME]
        if NATECAM_NAME in self.flag_files:
            state["calib"] = str(NATECAM_NAME)
        for pair in self.pairs:
            if isinstance(pair.calibration, FileRig):
                others.append(pair.calibration.file)
            beside = (rig_beside(pair.given[0]), *map(valid_mask, self.files(pair) or ()))
            others += [path for path in beside if path.is_file()]
        return {
            **state,
            "images": state_of_files(files if self.recording is None else self.recording.paths),
            "calibration, masks and poses": state_of_files(dict.fromkeys(others)),
        }


def find_inputs(options: PredictOptions) -> Inputs:
    """Return the pairs that the flags name.

    Raises:
        DatasetError: A source holds no pairs, or an image lacks its partner; the message names it.
        FileNotFoundError: A file is missing.
        ImportError: A bag, and `rosbags` is not installed.
        ValueError: A source cannot be used, or the poses are not as many as the pairs.
    """
    for mask in options.mask:
        check_file(mask, "mask")
    other = _without_layout(options)
    inputs = other or Inputs(tuple(_numbered(_dataset(options.images[0], options))))
    is_bag_alone = isinstance(inputs.recording, BagPairs) and not options.calib
    if options.every > 1 and inputs.recording is None:
        raise ValueError("--every is for videos and bags: it takes every n-th pair")
    if options.split != "all" and other is not None:
        raise ValueError("--split is for datasets: it takes a part of one")
    if options.format not in ("auto", "list", "folder") and other is not None:
        raise ValueError(f"--format {options.format} is for datasets: it is the layout of one; leave it out")
    if isinstance(inputs.recording, BagPairs):
        check_result_bag(options, inputs.recording)
    elif options.camera_info:
        raise ValueError("--camera-info is for ROS 2 bags: it names topics")
    elif options.stamp_tolerance != PredictOptions.stamp_tolerance:
        raise ValueError("--stamp-tolerance is for ROS 2 bags: it pairs their images")
    if isinstance(inputs.recording, BagPairs) and options.mount and inputs.recording.rover is not None:
        where = f"the frames of {options.images[0]} say where the cameras are on the rover"
        print(f"warning: {where}; --mount is not used, also for pairs at which they do not", file=sys.stderr)
    if not inputs.pairs:
        raise DatasetError(f"{' '.join(map(str, options.images)) or options.left}: names no pair of images")
    if options.poses is not None:
        poses = read_poses(options.poses, options.pose_axes)
        if len(poses) != len(inputs.pairs):
            raise ValueError(
                f"{options.poses}: holds {counted(len(poses), 'pose')} for {counted(len(inputs.pairs), 'pair')}"
            )
        pairs = tuple(replace(pair, pose=pose) for pair, pose in zip(inputs.pairs, poses, strict=True))
        inputs = replace(inputs, pairs=pairs)
    first = inputs.pairs[0]
    is_rectified = first.calibration is not None and inputs.recording is None  # as those of datasets are
    if options.rectify == "never" and is_product(first.left):
        raise ValueError(f"--rectify never: {first.left} is a product of a rover, and these are raw; leave it out")
    asked = options.rectify == "always" or options.raw.align
    if not is_bag_alone and must_be_rectified(options, first.left) and (asked or not is_rectified):
        inputs = _rectified(inputs, options)
    if inputs.rectification is None:
        if first.calibration is None:
            note_rig_beside(options, first.left)
        for name, value in vars(options.raw).items():
            if value:
                raise ValueError(f"--{name} is of raw images: give the calibration of their cameras with --calib")
    names = [pair.name for pair in inputs.pairs]
    if len(set(names)) < len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise ValueError(f"two pairs have the name {twice}, so their results would be one; rename an image")
    files = (*options.calib, *options.mask, *([] if options.poses is None else [options.poses]))
    return replace(inputs, flag_files=files)


def _rectified(inputs: Inputs, options: PredictOptions) -> Inputs:
    """Return raw pairs as pairs that are rectified when they are read. Raises ValueError as RawPairs.from_options."""
    rectification = RawPairs.from_options(options, inputs.pairs[0].left)
    pairs = tuple(rectification.named(pair, options.out) for pair in inputs.pairs)
    return replace(inputs, pairs=pairs, rectification=rectification)


def _without_layout(options: PredictOptions) -> Inputs | None:
    """Return the pairs of any source but a dataset whose layout tells its pairs; None for that."""
    if len(options.images) == 2:
        left, right = options.images
        if left.suffix.lower() in SUFFIXES:
            return _video(options)
        if options.left is not None:
            raise ValueError("--left and --right take one folder that they start from, or none")
        return Inputs((PairInput("", left, right),), single=True)
    if len(options.images) == 1 and is_bag(options.images[0]):
        return _bag(options)
    named = len(options.images) == 1 and sensors_are_named(options.images[0], options.left, options.right)
    if options.left is not None and options.right is not None and options.format in ("auto", "folder") and not named:
        return Inputs(tuple(_numbered(_patterns(options))))
    if not options.images:
        raise ValueError(f"--format {options.format} needs the dataset's folder before --left and --right")
    (source,) = options.images
    if not source.exists():
        raise FileNotFoundError(f"{source}: no such file or folder")
    if source.is_file():
        if source.suffix.lower() in SUFFIXES:
            return _video(options)
        if is_product(source):
            return Inputs((PairInput("", source, right_of(source)),), single=True)
        if source.suffix.lower() != ".txt":
            raise ValueError(
                f"{source}: is one file; give the right image too, or a folder, a .txt list, a video or a bag"
            )
        return Inputs(tuple(_numbered(_listed(source))))
    if (source / "left.png").is_file() and (source / "right.png").is_file():
        return Inputs((PairInput("", source / "left.png", source / "right.png"),), single=True)
    if options.format == "auto" and any(source.glob(f"*/{RIG_FILE}")) and any(source.glob("*/left.png")):
        images = sorted(partners(source, ("*/left.png", "*/right.png")), key=numbers_by_value)
        pairs = (PairInput(a.parent.name, a, b) for a, b in images)
        return Inputs(tuple(_numbered(pairs)))
    if options.format == "auto" and (products := find_products(source)):
        return Inputs(tuple(_numbered(PairInput(left.stem, left, right) for left, right in products)))
    return None


def _numbered(pairs: Iterable[PairInput]) -> Iterator[PairInput]:
    return (replace(pair, number=number) for number, pair in enumerate(pairs))


def _patterns(options: PredictOptions) -> Iterator[PairInput]:
    """Yield the pairs of two patterns; their names leave out the folders that the left pattern begins with."""
    assert options.left is not None and options.right is not None
    root, patterns = options.images[0] if options.images else Path(), [options.left, options.right]
    if not root.is_dir():
        raise DatasetError(f"{root}: is not a folder; --left and --right start from a folder")
    if Path(options.left).anchor or Path(options.right).anchor:
        paths = [(root / pattern).resolve() for pattern in patterns]
        root = Path(paths[0].anchor)
        patterns = [path.relative_to(root).as_posix() for path in paths]
    fixed = root
    for part in Path(patterns[0]).parts[:-1]:
        if "*" in part or "?" in part:
            break
        fixed = fixed / part
    warn_of_lone_rights(root, patterns[0], patterns[1], is_valid_mask)
    for left, right in sorted(partners(root, patterns, left_out=is_valid_mask), key=numbers_by_value):
        name = left.relative_to(fixed).with_suffix("").as_posix()
        yield _with_calibration(PairInput(name, left, right), root / "calib.txt")


def _listed(file: Path) -> Iterator[PairInput]:
    """Yield the pairs of a list, whose paths start from its folder."""
    rows = read_list(file, (2, 3))
    for words, name in zip(rows, names_of_list(file.parent, [words[0] for words in rows]), strict=True):
        left, right = (file.parent / word for word in words[:2])
        for path in (left, right):
            if not path.is_file():
                raise DatasetError(f"{path}: no such file; {file} names it")
        yield _with_calibration(PairInput(name, left, right), file.parent / "calib" / f"{left.stem}.txt")


def _with_calibration(pair: PairInput, file: Path) -> PairInput:
    """Return the pair with the calibration of a file; without one if there is no such file."""
    return replace(pair, calibration=FileRig(file, pair.left)) if file.is_file() else pair


def _recorded_on_rover(pair: PairInput) -> np.ndarray | None:
    """Return what the bag, the label or the sample of a pair says of the left camera on the rover, (4, 4), or None."""
    return pair.on_rover if pair.sample is None else sample_mount(pair.sample)


def _dataset(path: Path, options: PredictOptions) -> Iterator[PairInput]:
    """Yield the pairs of a dataset's split."""
    calib = options.calib[0] if options.calib else None  # the flag replaces what is read of the pairs
    given = calib is None and options.focal is not None and options.baseline is not None
    config = DataConfig(
        options.format, options.left, options.right, calib=calib,
        focal=options.focal if given else None, baseline=options.baseline if given else None,
    )  # fmt: skip
    try:
        layout = detect(path, config)
    except DatasetError as error:
        raise DatasetError(
            str(error).replace("--left, --right, --disparity or --depth", "--left and --right")
        ) from None
    if layout == "folder":
        raise ValueError(f"{path}: layout folder needs --left and --right, patterns such as 'left/*.png'")
    pairs = open_pairs(path, options.split, config if layout != "marssim" else None)
    if not len(pairs):
        raise DatasetError(f"{path}: split {options.split} holds no pairs; choose another --split, or all")
    if isinstance(pairs, StereoDataset):
        for name in pairs.names:
            folder = path / "scenes" / name
            sample = folder / "sample.json"
            yield PairInput(
                name, folder / "left.png", folder / "right.png", FileRig(sample, folder / "left.png"), sample=sample
            )
    elif isinstance(pairs, PairList):
        for pair in pairs.pairs:
            yield PairInput(pair.name, pair.left, pair.right, pair.calibration)


def _video(options: PredictOptions) -> Inputs:
    """Return the frames of one video or of two."""
    video = VideoFrames(options.images)
    left, right = options.images[0], options.images[-1]
    numbers = range(0, video.count, options.every)
    return Inputs(tuple(PairInput(f"frame_{n:06d}", left, right, number=n) for n in numbers), recording=video)


def _bag(options: PredictOptions) -> Inputs:
    """Return the pairs of a ROS 2 bag."""
    (path,) = options.images
    images = None if options.left is None or options.right is None else (options.left, options.right)
    bag = BagPairs(
        path, images, options.camera_info, options.stamp_tolerance, needs_infos=not options.calib,
        rectify=options.rectify, masks=options.mask,
    )  # fmt: skip
    pairs = (
        PairInput(
            f"frame_{n:06d}", path, path, None if options.calib else bag.calibration(n), number=n, pose=bag.pose(n),
            on_rover=bag.on_rover(n), raw_frame=bag.raw_frame(n),
        )
        for n in range(0, bag.count, options.every)
    )  # fmt: skip
    return Inputs(tuple(pairs), recording=bag)
