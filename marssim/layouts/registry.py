"""The folders of well-known stereo benchmarks, filled with our samples.

Each layout lists the files of one sample by their path, with a function that makes the content, so that only what is
missing is made. Left images and maps are of the left eye. Known means not sky; known pixels are kept at any depth.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from marssim.base.dataset.dataset import DatasetError, StereoSample, read_sample
from marssim.base.files.pfm import encode_pfm

KITTI_SCALE = 256  # uint16 steps a pixel of disparity
SEQUENCE = "A"  # FlyingThings3D has A, B and C


@dataclass(frozen=True)
class SameAs:
    """A file with the content of another one of the same sample: a hard link where the disk can."""

    path: str


@dataclass(frozen=True)
class Item:
    """One sample to be written. folder: where it lies; name: scene/view; number: its place within the split."""

    folder: Path
    name: str
    split: str
    number: int

    @property
    def flat(self) -> str:
        """The name as a file name."""
        return self.name.replace("/", "_")

    @cached_property
    def sample(self) -> StereoSample:
        """Read once. Raises DatasetError that names the file which is missing or broken."""
        return read_sample(self.folder)

    @property
    def known(self) -> np.ndarray:
        """(H, W) bool: not sky."""
        return np.isfinite(self.sample.depth)

    def image(self, name: str) -> bytes:
        """The bytes of left.png or right.png. Raises DatasetError if they are not those that were recorded."""
        path = self.folder / name
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            raise DatasetError(f"{path}: no such file") from None
        recorded = self.sample.meta.get("sha256")
        if not isinstance(recorded, dict) or hashlib.sha256(data).hexdigest() != recorded.get(name):
            raise DatasetError(f"{path}: other content than sample.json records; see python -m marssim.verify")
        return data


Content = Callable[[], bytes] | SameAs


@dataclass(frozen=True)
class Layout:
    """sample: the files of an item, by path under the output folder. lists: files over all items of a split, written
    when those are complete. about: what a reader has to know, Markdown."""

    sample: Callable[[Item], dict[str, Content]]
    lists: Callable[[str, Sequence[Item]], dict[str, str]]
    about: str


def kitti_code(disparity: np.ndarray, known: np.ndarray) -> np.ndarray:
    """uint16 disparity as KITTI keeps it: 256 steps a pixel, 0 where there is none.

    As the benchmark's own writer has it, known disparities too small for a step are 1, and those that do not fit
    (256 px and more) are 0.
    """
    code = np.round(disparity.astype(np.float64) * KITTI_SCALE)
    return np.where(known & (code <= 65535), np.maximum(code, 1), 0).astype(np.uint16)


def kitti_calibration(sample: StereoSample) -> str:
    """calib_cam_to_cam of a rectified pair: cameras 00 and 02 are the left eye, 01 and 03 the right one [m]."""
    camera, lines = sample.rig.camera, []

    def line(key: str, values: np.ndarray | Sequence[float]) -> None:
        lines.append(f"{key}: " + " ".join(f"{value:.12e}" for value in np.ravel(values)))

    for number in range(4):
        across = sample.rig.baseline * (number % 2)
        for key, value in (
            ("S", [camera.width, camera.height]),
            ("K", camera.K),
            ("D", np.zeros(5)),
            ("R", np.eye(3)),
            ("T", [-across, 0, 0]),
            ("S_rect", [camera.width, camera.height]),
            ("R_rect", np.eye(3)),
            ("P_rect", np.column_stack([camera.K, [-camera.fx * across, 0, 0]])),
        ):
            line(f"{key}_{number:02d}", value)
    return "\n".join(lines) + "\n"


def middlebury_calibration(sample: StereoSample, known: np.ndarray) -> str:
    """calib.txt of Middlebury 2014 and ETH3D; baseline [mm], depth = baseline f / (disparity + doffs)."""
    camera = sample.rig.camera
    disparity = sample.disparity[known]
    low, high = (int(np.floor(disparity.min())), int(np.ceil(disparity.max()))) if known.any() else (0, 0)
    matrix = f"[{camera.fx:.10g} 0 {camera.cx:.10g}; 0 {camera.fy:.10g} {camera.cy:.10g}; 0 0 1]"
    return (
        f"cam0={matrix}\ncam1={matrix}\ndoffs=0\nbaseline={1000 * sample.rig.baseline:.10g}\n"
        f"width={camera.width}\nheight={camera.height}\nndisp={high + 1}\nisint=0\nvmin={low}\nvmax={high}\n"
        f"dyavg=0\ndymax=0\n"
    )


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def _no_lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    return {}


def _kitti(item: Item) -> dict[str, Content]:
    root, name = f"{item.split}/training", f"{item.number:06d}"

    def disparity(visible_only: bool) -> bytes:
        known = item.known & ~item.sample.occluded if visible_only else item.known
        return _png(kitti_code(item.sample.disparity, known))

    return {
        f"{root}/image_2/{name}_10.png": lambda: item.image("left.png"),
        f"{root}/image_3/{name}_10.png": lambda: item.image("right.png"),
        f"{root}/disp_occ_0/{name}_10.png": lambda: disparity(False),
        f"{root}/disp_noc_0/{name}_10.png": lambda: disparity(True),
        f"{root}/calib_cam_to_cam/{name}.txt": lambda: kitti_calibration(item.sample).encode(),
    }


def _dense(item: Item) -> bytes:
    """PFM of the disparity, 0 in the sky: the disparity of what is infinitely far."""
    return encode_pfm(np.where(item.known, item.sample.disparity, 0))


def _gapped(item: Item) -> bytes:
    """PFM of the disparity, inf in the sky, where Middlebury's ground truth is unknown."""
    return encode_pfm(np.where(item.known, item.sample.disparity, np.inf))


def _occlusion(item: Item) -> bytes:
    return _png(item.sample.occluded.astype(np.uint8) * 255)


def _visibility(item: Item) -> bytes:
    """255 seen by both eyes, 128 hidden from the right one, 0 unknown (sky)."""
    return _png(np.where(item.known, np.where(item.sample.occluded, 128, 255), 0).astype(np.uint8))


def _calibration(item: Item) -> bytes:
    return middlebury_calibration(item.sample, item.known).encode()


def _sceneflow(item: Item) -> dict[str, Content]:
    scene, view = item.name.split("/")
    part = f"{item.split.upper()}/{SEQUENCE}/{scene}"
    name = f"{int(view):04d}"
    clean, final = (f"FlyingThings3D/frames_{kind}pass/{part}" for kind in ("clean", "final"))
    return {
        f"{clean}/left/{name}.png": lambda: item.image("left.png"),
        f"{clean}/right/{name}.png": lambda: item.image("right.png"),
        f"{final}/left/{name}.png": SameAs(f"{clean}/left/{name}.png"),
        f"{final}/right/{name}.png": SameAs(f"{clean}/right/{name}.png"),
        f"FlyingThings3D/disparity/{part}/left/{name}.pfm": lambda: _dense(item),
        f"FlyingThings3D/disparity_occlusions/{part}/left/{name}.png": lambda: _occlusion(item),
        f"FlyingThings3D/calib/{part}/{name}.txt": lambda: _calibration(item),
    }


def _middlebury(item: Item) -> dict[str, Content]:
    new = f"{item.split}/2014/{item.flat}"
    old = f"{item.split}/MiddEval3/trainingF/{item.flat}"
    return {
        f"{new}/im0.png": lambda: item.image("left.png"),
        f"{new}/im1.png": lambda: item.image("right.png"),
        f"{new}/im1E.png": SameAs(f"{new}/im1.png"),
        f"{new}/im1L.png": SameAs(f"{new}/im1.png"),
        f"{new}/disp0.pfm": lambda: _gapped(item),
        f"{new}/mask0nocc.png": lambda: _visibility(item),
        f"{new}/calib.txt": lambda: _calibration(item),
        f"{old}/im0.png": SameAs(f"{new}/im0.png"),
        f"{old}/im1.png": SameAs(f"{new}/im1.png"),
        f"{old}/disp0GT.pfm": SameAs(f"{new}/disp0.pfm"),
        f"{old}/mask0nocc.png": SameAs(f"{new}/mask0nocc.png"),
        f"{old}/calib.txt": SameAs(f"{new}/calib.txt"),
    }


def _middlebury_lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    return {f"{split}/MiddEval3/official_train.txt": "".join(f"{item.flat}\n" for item in items)}


def _eth3d(item: Item) -> dict[str, Content]:
    images, truth = (f"{item.split}/two_view_training{end}/{item.flat}" for end in ("", "_gt"))
    return {
        f"{images}/im0.png": lambda: item.image("left.png"),
        f"{images}/im1.png": lambda: item.image("right.png"),
        f"{images}/calib.txt": lambda: _calibration(item),
        f"{truth}/disp0GT.pfm": lambda: _gapped(item),
        f"{truth}/mask0nocc.png": lambda: _visibility(item),
    }


def _openstereo(item: Item) -> dict[str, Content]:
    return {
        f"left/{item.flat}.png": lambda: item.image("left.png"),
        f"right/{item.flat}.png": lambda: item.image("right.png"),
        f"disparity/left/{item.flat}.pfm": lambda: _dense(item),
        f"occluded/{item.flat}.png": lambda: _occlusion(item),
        f"calib/{item.flat}.txt": lambda: _calibration(item),
    }


def _openstereo_lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    lines = (f"left/{item.flat}.png right/{item.flat}.png disparity/left/{item.flat}.pfm\n" for item in items)
    return {f"{split}.txt": "".join(lines)}


LAYOUTS: dict[str, Layout] = {
    "kitti": Layout(
        _kitti,
        _no_lists,
        """\
KITTI 2015. Each of `train/`, `val/`, `test/` is a root of its own with `training/` inside: `image_2` and `image_3`
(left and right eye), `disp_occ_0` (every known pixel), `disp_noc_0` (only those that both eyes see): 16-bit PNG,
disparity x 256, 0 where there is none (sky; 256 px and more, which do not fit). `calib_cam_to_cam/` holds `P_rect_02`
and `P_rect_03`; baseline = -P_rect_03[0, 3] / P_rect_03[0, 0] in metres.
""",
    ),
    "sceneflow": Layout(
        _sceneflow,
        _no_lists,
        """\
SceneFlow's FlyingThings3D tree: `TRAIN`, `VAL` and `TEST` below `frames_cleanpass`, `frames_finalpass` (the same
images) and `disparity` (PFM, positive, left eye only). The sky has disparity 0, as what is infinitely far. Trainers
mask what is too near for them (RAFT-Stereo: 512 px). Beside what they read: `disparity_occlusions` (255 where the
right eye does not see the point) and `calib` (Middlebury's notation).
""",
    ),
    "middlebury": Layout(
        _middlebury,
        _middlebury_lists,
        """\
Middlebury. Each of `train/`, `val/`, `test/` is a root of its own with `2014/<scene>/` (im0, im1, disp0.pfm) and
`MiddEval3/trainingF/<scene>/` (im0, im1, disp0GT.pfm). `im1E.png` and `im1L.png`, in the original another exposure and
another light, are the same image as `im1.png`. PFM: inf where there is none (sky). `mask0nocc.png`: 255 seen by both
eyes, 128 hidden from the right one, 0 unknown. `calib.txt`: baseline in millimetres.
""",
    ),
    "eth3d": Layout(
        _eth3d,
        _no_lists,
        """\
ETH3D low-res two-view. Each of `train/`, `val/`, `test/` is a root of its own with `two_view_training/<scene>/` (im0,
im1, calib.txt; baseline in millimetres) and `two_view_training_gt/<scene>/` (disp0GT.pfm, inf in the sky;
mask0nocc.png: 255 seen by both eyes, 128 hidden from the right one, 0 unknown).
""",
    ),
    "openstereo": Layout(
        _openstereo,
        _openstereo_lists,
        """\
OpenStereo. `train.txt`, `val.txt`, `test.txt` list "left right disparity" a line, paths from this folder (its
DATA_PATH; the lists are its DATA_SPLIT). PFM, positive, without NaN; the sky has disparity 0, which its losses mask.
There is no right-eye disparity (RETURN_RIGHT_DISP: false). The list of a split without pairs is empty. Beside what it
reads: `occluded/` (255 where the right eye does not see the point) and `calib/` (Middlebury's notation).
""",
    ),
}
