"""The flags of m3depth.predict."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from m3depth.datasets.config import Format, Split
from m3depth.estimator import M3DEPTH
from m3depth.network.device import DeviceName
from m3depth.rectification.options import RawOptions
from m3depth.runtimes.choice import RuntimeChoice
from m3depth.stereo.pairs import LEAST_PIXELS
from marssim.base.dataset.map_file import MAP_KINDS, MapFormat, MapKind
from marssim.base.rover_spec import CameraMount

CloudFrame = Literal["camera", "rover", "world"]
Rectify = Literal["auto", "always", "never"]

NEAREST_LIMITS = (0.01, 1000.0)  # [m]
SMALLEST_VOXEL = 0.001  # [m]; 2^20 of them in each direction reach over 1 km


@dataclass(frozen=True)
class PredictOptions:
    """Predict depth, normals and point clouds of rectified stereo pairs.

    Raises:
        ValueError: A value that cannot work; the message names the field.
    """

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LEFT RIGHT | SOURCE")]
    """Left and right image of one pair, of 8 or 16 bits; the left product of a rover alone, whose name tells the right
    one; or left and right video; or one source of many pairs: a folder, a list (.txt with lines of "left right"), a ROS
    2 bag, or a video that shows both eyes side by side, the left one on the left. With --left and --right, the folder
    that the patterns start from; without it, they start here."""
    out: Path
    """Folder to write the results to. Many pairs have a folder each in it, and the same command continues after it was
    stopped or killed."""
    left: str | None = None
    """Pattern of the left images, such as 'left/*.png'. With --format oaisys: name of the left sensor. For a bag: topic
    of the left images; without it, the command finds the topics itself."""
    right: str | None = None
    """Pattern of the right images; two images are a pair if * stands for the same text in both names. With --format
    oaisys: name of the right sensor. For a bag: topic of the right images."""
    camera_info: tuple[str, str] | None = None
    """Topics of the CameraInfo of the left and the right eye in a bag. Without it, those beside the images."""
    stamp_tolerance: float = 0.01
    """Largest difference of the stamps of two images in a bag that are a pair [s], 0 to 10."""
    format: Format = "auto"
    """Layout of a dataset's folder; auto recognises it by the files in it."""
    split: Split = "all"
    """Part of a dataset to predict."""
    every: int = 1
    """Take every n-th frame of a video or pair of a bag, 1 or more."""
    focal: float | None = None
    """Focal length of the rectified images [px], above 0. Without it, that of the calibration file."""
    baseline: float | None = None
    """Distance of the two cameras [m], above 0: at least 0.001 and at most 10. Without it, that of the calibration
    file."""
    calib: tuple[Path, ...] = ()
    """Calibration file of the pairs, or "natecam" for Zhurong's cameras; --focal, --baseline, --cx and --cy replace its
    values. For ROS's CameraInfo, give the files of the left and the right eye, or that of the right one alone. Without
    it, that of the dataset, or the rig.json of m3depth.rectify beside the images."""
    rectify: Rectify = "auto"
    """Whether to rectify the images first; auto does so with products of rovers and where --calib is of raw cameras
    alone. CameraInfo of ROS and OpenCV's files with P1 and P2 are of rectified images too: for raw images, always. Then
    --focal is that of the rectified images, and --mask is of the raw ones. In a bag, raw images whose topic does not
    say rect are rectified by their CameraInfo; always and never override that."""
    raw: Annotated[RawOptions, tyro.conf.arg(name="")] = field(default_factory=RawOptions)
    """How raw images are rectified; m3depth.rectify also has --size and --shift."""
    cx: float | None = None
    """Column of the left image's principal point [px], counted from 0. Without it, the calibration's or the middle."""
    cy: float | None = None
    """Row of the principal point [px], counted from 0. Without it, the calibration's or the middle."""
    mask: tuple[Path, ...] = ()
    """Mask of all left images, or of both eyes: an image file whose pixels of 0 become unknown, such as those of the
    rover itself. The NAME_valid.png that m3depth.rectify writes beside NAME.png are taken in any case."""
    poses: Path | None = None
    """File of the left camera's poses, camera to world, with a line for each pair, in their order: twelve numbers,
    the rows of [R t] (KITTI), or eight, time, position and quaternion x y z w (TUM). Of raw images, they are those of
    the raw camera. Datasets of marssim have poses of their own."""
    pose_axes: Literal["z-up", "camera"] = "z-up"
    """Axes of the world of --poses: z-up, or camera: those of the first left camera (x right, y down, z forward), as
    visual odometry gives them. Then the rover's frame at the first pair becomes the world."""
    mount: tuple[float, float, float] | None = None
    """Place of the cameras on the rover: metres ahead of its origin, which is on the ground, -10 to 10, metres above
    the ground, 0.001 to 10, and degrees that they look down, -90 to 90. The rows of raw images are level. Without it,
    that in the rig file of m3depth.rectify, which the labels of a rover's images give, that of a drive of marssim, or
    Zhurong's (0.65 1.2 20), with a warning where that matters. A bag whose frames have the camera in base_footprint or
    base_link needs none."""
    weights: Path | None = None
    """Weights file (.safetensors) of m3depth.train to predict with; the same as --estimator m3depth:PATH. Without it,
    or by the word shipped, the shipped weights."""
    estimator: Annotated[str, tyro.conf.arg(aliases=["--method"])] = "m3depth"
    """Stereo method: m3depth (shipped weights), m3depth:PATH (other weights), sgbm or another classical method that
    m3depth.evaluate --baselines lists, or package.module:Class, a class without arguments that has infer(left, right,
    rig). --method is its name in release 0.1."""
    device: DeviceName = "auto"
    """Device that M3Depth runs on; auto takes a GPU if there is one."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth: pytorch; openvino, on the CPU, with the extra `fast`; or auto, which is openvino if it
    is installed and the device is the CPU, and else pytorch."""
    nearest: float | None = None
    """Nearest depth [m] in view, 0.01 to 1000 and 0.84 by default, for M3Depth or a class whose infer takes it. M3Depth
    finds up to 192 px of disparity, first in reduced images where this depth, or the images' width, has more."""
    max_pixels: int | None = None
    """Largest number of pixels of an image, 2048 or more, that the network works on, for M3Depth or a class whose infer
    takes it. Larger images are reduced to it, which saves time and memory and loses detail; the maps have the images'
    size."""
    align_rows: bool = True
    """Turn the right image where its rows lie apart from those of the left one by a significant part of a pixel. The
    summary says by how much."""
    unchecked: bool = False
    """Write the result even where the pair shows that it is meaningless, and print a warning instead of an error."""
    left_right: bool = False
    """Predict from the right eye too, which takes twice as long, and make pixels unknown where its disparity differs by
    more than 1 px or is unknown."""
    steps: bool = False
    """Write steps.png too, the depth after each refinement step and what the step changed, for M3Depth and trained
    methods that refine step by step (raft-stereo, selective-stereo, cre-stereo). It takes twice as long and runs in
    PyTorch."""
    min_confidence: float | None = None
    """Least confidence, from 0 to 1: pixels with depth of less become unknown in maps, pictures and clouds. Without it,
    maps keep all pixels that the method measured, and clouds those of 0.5 and more."""
    max_range: float = 30.0
    """Largest depth [m], above 0, of the points of the point clouds."""
    write: tuple[Literal["depth", "disparity", "normal", "confidence", "sky", "cloud", "figure", "bag"], ...] = (
        *MAP_KINDS, "sky", "cloud", "figure", "bag",
    )  # fmt: skip
    """What to write. Without figure, many pairs have no overview and no video, and without cloud no fused cloud. If the
    source is a ROS 2 bag, bag writes one of depth, DisparityImage and, with cloud, PointCloud2; it needs depth."""
    map_format: tuple[MapFormat, ...] = ("npy", "png")
    """File types of the maps, in 32-bit floats, but png in 16-bit integers: depth in mm, 256 times the disparity."""
    cloud_frame: CloudFrame = "camera"
    """Frame of the point clouds: camera (x right, y down, z forward), rover (x ahead, y left, z up; see --mount), or
    world, for pairs with poses."""
    voxel: float = 0.05
    """Edge of the cubes [m], 0.001 or more, whose points the fused cloud of pairs with poses averages."""
    video: bool = False
    """Write a video of the pictures of many pairs, in order. Without it, only videos and bags give one. A single pair
    has none."""
    view: bool = False
    """At the end, show clouds, cameras and path on a page in the browser, until Ctrl-C. Where all pairs have results
    already, it shows these. It needs the extra `view`."""

    def __post_init__(self) -> None:
        if len(self.images) > 2:
            raise ValueError(f"give a left and a right image, or one source of pairs, got {len(self.images)} files")
        if self.every < 1:
            raise ValueError(f"every must be at least 1, got {self.every}")
        for name in ("focal", "baseline", "max_range", "voxel"):
            value = getattr(self, name)
            if value is not None and not (value > 0 and (np.isfinite(value) or name == "max_range")):
                raise ValueError(f"{name} must be positive, got {value:g}")
        if self.max_pixels is not None and self.max_pixels < LEAST_PIXELS:
            raise ValueError(f"max_pixels must be at least {LEAST_PIXELS}, got {self.max_pixels}")
        if self.voxel < SMALLEST_VOXEL:
            raise ValueError(f"voxel must be at least {SMALLEST_VOXEL:g} m, got {self.voxel:g}")
        low, high = NEAREST_LIMITS
        if self.nearest is not None and not low <= self.nearest <= high:
            raise ValueError(f"nearest must lie in [{low:g}, {high:g}] m, got {self.nearest:g}")
        for name in ("cx", "cy"):
            value = getattr(self, name)
            if value is not None and not np.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
        if self.min_confidence is not None and not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence must be 0 to 1, got {self.min_confidence:g}")
        if self.mount is not None:
            CameraMount.of_flag(self.mount)  # raises ValueError for values that no mast has
        if self.pose_axes != "z-up" and self.poses is None:
            raise ValueError("pose_axes is of the poses in a file: give --poses")
        for count, name, most in ((len(self.calib), "calib", "calibration files"), (len(self.mask), "mask", "masks")):
            if count > 2:
                raise ValueError(f"{name} {getattr(self, name)[2]}: a pair has two {most} at most, got a third")
        if self.estimator != M3DEPTH and self.weights is not None:
            raise ValueError(f"weights is of m3depth, not of --estimator {self.estimator}: give one of the two")
        if (self.left is None) != (self.right is None):
            raise ValueError(f"{'left' if self.right is None else 'right'} needs its partner: give --left and --right")
        if not self.images and self.left is None:
            raise ValueError("give a left and a right image, a folder, a list, a video, a bag, or --left and --right")
        if not 0 <= self.stamp_tolerance <= 10:
            raise ValueError(f"stamp_tolerance must lie in [0, 10] s, got {self.stamp_tolerance:g}")
        if self.raw.align and self.rectify == "never":
            raise ValueError("align rectifies the images: leave out --rectify never")
        if self.steps and self.runtime == "openvino":
            raise ValueError("steps runs in PyTorch: leave out --runtime openvino")
        if "bag" in self.write and "depth" not in self.write:
            raise ValueError("write: bag needs depth, which it is made of")
        if self.view and "depth" not in self.write:
            raise ValueError("view shows depth: leave it in --write")
        if not self.write or not self.map_format:
            raise ValueError(f"{'map_format' if self.write else 'write'} must name something to write")

    @property
    def kinds(self) -> tuple[MapKind, ...]:
        """The maps that are written."""
        return tuple(kind for kind in MAP_KINDS if kind in self.write)

    @property
    def used_runtime(self) -> RuntimeChoice:
        """The runtime as load_estimator takes it: with --steps, PyTorch, which alone returns the steps."""
        return "pytorch" if self.steps else self.runtime

    @property
    def cloud_confidence(self) -> float:
        """Least confidence of the points of the clouds."""
        return 0.5 if self.min_confidence is None else self.min_confidence
