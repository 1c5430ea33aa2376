"""The folder trees of KITTI, SceneFlow, Middlebury and ETH3D, as published and as marssim.export writes them.

KITTI        training/{image_2,image_3,disp_occ_0,disp_noc_0}/*_10.png, training/calib_cam_to_cam/*.txt (2015);
             training/{colored_0,colored_1,disp_occ,disp_noc}/*_10.png, training/calib/*.txt (2012). 0 is unknown.
             A pixel is occluded if disp_occ has a value for it and disp_noc has none.
SceneFlow    frames_{cleanpass,finalpass}/**/left/*.png, .../right/..., disparity/**/left/*.pfm. TRAIN, TEST and VAL
             are splits. Its cameras have f = 1050 px (450 in 15mm_focallength) and a baseline of 1 unit. The scenes
             have no scale, and methods search from 0.84 m; so a unit counts as 0.2 m, and that is 250 px at 960 px.
Middlebury   <scene>/{im0.png,im1.png,disp0.pfm or disp0GT.pfm,calib.txt,mask0nocc.png}, in 2014/, trainingF/ (H, Q),
             MiddEval3/trainingF/ or the root itself. inf is unknown.
ETH3D        two_view_training/<scene>/{im0.png,im1.png,calib.txt}, two_view_training_gt/<scene>/{disp0GT.pfm,
             mask0nocc.png}. inf is unknown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from m3depth.datasets.pair_files import CalibrationFinder, CalibrationReader, PairFiles, is_above_zero, is_zero
from m3depth.datasets.rigs import FileRig
from marssim.base.calibration.rectified import Calibration

KITTI_FOLDERS = (  # left, right, disparity, disparity of pixels that both cameras see, calibrations
    ("image_2", "image_3", "disp_occ_0", "disp_noc_0", "calib_cam_to_cam"),
    ("colored_0", "colored_1", "disp_occ", "disp_noc", "calib"),
    ("image_0", "image_1", "disp_occ", "disp_noc", "calib"),
)
SCENEFLOW_PARTS = ("FlyingThings3D", "Driving", "Monkaa")
ROADS = ("scene_forwards", "scene_backwards")  # of Driving
RECTIFICATION = re.compile("-(im)?perfect$")  # end of the names of Middlebury's two rectifications of a scene
SCENEFLOW_FOCAL, SCENEFLOW_SHORT = 1050.0, 450.0  # focal lengths at 960 x 540 [px]
SCENEFLOW_BASELINE = 0.2  # [m] that its baseline counts as
MIDDLEBURY_FOLDERS = ("2014", "MiddEval3/trainingF", "MiddEval3/trainingH", "MiddEval3/trainingQ",
                      "trainingF", "trainingH", "trainingQ", ".")  # fmt: skip
OCCLUDED = 128  # in mask0nocc.png: only the left camera sees it; 255 is both, 0 is unknown


def kitti(root: Path, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield the pairs of a KITTI root, in the order of their numbers.

    Args:
        root: Root folder of the dataset.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.
    """
    training = root / "training"
    for left, right, truth, both, calib in KITTI_FOLDERS:
        images = sorted((training / left).glob("*_10.png"))
        for path in images:
            number = path.name.removesuffix("_10.png")
            visible = training / both / path.name
            yield PairFiles(
                number, number, path, training / right / path.name, training / truth / path.name, "disparity",
                rigs(training / calib / f"{number}.txt", path),
                visible=visible if visible.is_file() else None, hidden=is_zero,
            )  # fmt: skip
        if images:
            return


def sceneflow(root: Path, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield the pairs of FlyingThings3D, Driving or Monkaa, or of those of the three that lie in a folder.

    `name` begins with TRAIN, TEST or VAL where the tree does. Beside FlyingThings3D, the others are training pairs.
    Runs along one road of Driving, with another speed or focal length, are one scene.

    Args:
        root: Root folder of the dataset.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.
    """
    for part in (part for part in SCENEFLOW_PARTS if (root / part).is_dir()):
        first = "" if part == SCENEFLOW_PARTS[0] or not (root / SCENEFLOW_PARTS[0]).is_dir() else f"TRAIN/{part}/"
        for pair in sceneflow(root / part, rigs):
            yield replace(pair, name=first + pair.name, group=first + pair.group)
    frames = next((f for f in ("frames_cleanpass", "frames_finalpass") if (root / f).is_dir()), "frames_cleanpass")
    for path in sorted(p for p in (root / frames).rglob("left/*") if p.suffix in (".png", ".webp")):
        inside = path.relative_to(root / frames)
        right = path.parent.with_name("right") / path.name
        occlusions = root / "disparity_occlusions" / inside.with_suffix(".png")
        scene = inside.parent.parent
        road = next((part for part in scene.parts if part in ROADS), None)
        yield PairFiles(
            (scene / inside.stem).as_posix(), road or scene.as_posix(), path, right,
            root / "disparity" / inside.with_suffix(".pfm"), "disparity",
            rigs(root / "calib" / scene / f"{inside.stem}.txt", path), zero_is_far=True,
            visible=occlusions if occlusions.is_file() else None, hidden=is_above_zero,
        )  # fmt: skip


def sceneflow_rig(calib: Path, left: Path) -> CalibrationReader:
    """Return SceneFlow's own camera, unless a calibration file says otherwise.

    Args:
        calib: The calibration file of the pair, which may be missing.
        left: The left image; its path names the focal length.
    """
    if calib.is_file():
        return FileRig(calib, left)

    return partial(_sceneflow_camera, SCENEFLOW_SHORT if "15mm_focallength" in left.parts else SCENEFLOW_FOCAL)


def _sceneflow_camera(focal: float, width: int, height: int) -> Calibration:
    """Return the camera of a focal length at 960 px of width, for images of a size [px]."""
    focal = focal * width / 960
    return Calibration(focal, focal, (width - 1) / 2, (height - 1) / 2, SCENEFLOW_BASELINE)


def middlebury(root: Path, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield the pairs of the first of Middlebury's folders that exists, without scenes that lack truth (test sets).

    Args:
        root: Root folder of the dataset.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.
    """
    for folder in MIDDLEBURY_FOLDERS:
        images = sorted((root / folder).glob("*/im0.png"))
        for path in images:
            yield from _scene(path.parent, path.parent, rigs)
        if images:
            return


def eth3d(root: Path, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield the pairs of the two-view training set.

    Args:
        root: Root folder of the dataset.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.
    """
    for path in sorted((root / "two_view_training").glob("*/im0.png")):
        yield from _scene(path.parent, root / "two_view_training_gt" / path.parent.name, rigs)


def _scene(images: Path, truths: Path, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield the pair of one scene of Middlebury or ETH3D, if it has a true disparity map."""
    truth = next((truths / n for n in ("disp0GT.pfm", "disp0.pfm") if (truths / n).is_file()), None)
    if truth is None:
        return
    mask = truths / "mask0nocc.png"
    yield PairFiles(
        images.name, RECTIFICATION.sub("", images.name), images / "im0.png", images / "im1.png", truth, "disparity",
        rigs(images / "calib.txt", images / "im0.png"), visible=mask if mask.is_file() else None,
        hidden=_is_occluded,
    )  # fmt: skip


def _is_occluded(mask: np.ndarray) -> np.ndarray:
    """Return the pixels that a mask of Middlebury or ETH3D marks as occluded."""
    return mask == OCCLUDED
