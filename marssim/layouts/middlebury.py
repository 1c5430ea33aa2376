"""The layouts of Middlebury 2014 and of ETH3D, which share one calibration format."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.dataset.sample import StereoSample
from marssim.base.right_image import recorded_rotation, vertical_disparity
from marssim.layouts.layout import (
    Content,
    Item,
    Layout,
    SameAs,
    gapped_pfm,
    no_lists,
    visibility_png,
)


def middlebury_calibration(sample: StereoSample, labelled: np.ndarray) -> str:
    """Return calib.txt of Middlebury 2014 and ETH3D: baseline in mm, depth = baseline f / (disparity + doffs).

    dyavg and dymax are the mean and the largest of the absolute vertical disparities of the labelled pixels.

    Args:
        sample: The sample, for its rig and its disparities.
        labelled: (H, W) bool, the pixels that give vmin, vmax, dyavg and dymax [px].
    """
    camera = sample.rig.camera
    disparity = sample.disparity[labelled]
    low, high = (int(np.floor(disparity.min())), int(np.ceil(disparity.max()))) if labelled.any() else (0, 0)
    rotation = recorded_rotation(sample.meta.get("right_rotation"))
    rows = np.abs(vertical_disparity(sample.rig, sample.depth, rotation)[labelled])
    mean, most = (float(rows.mean()), float(rows.max())) if labelled.any() else (0.0, 0.0)
    matrix = f"[{camera.fx:.10g} 0 {camera.cx:.10g}; 0 {camera.fy:.10g} {camera.cy:.10g}; 0 0 1]"
    return (
        f"cam0={matrix}\ncam1={matrix}\ndoffs=0\nbaseline={1000 * sample.rig.baseline:.10g}\n"
        f"width={camera.width}\nheight={camera.height}\nndisp={high + 1}\nisint=0\nvmin={low}\nvmax={high}\n"
        f"dyavg={mean:.4g}\ndymax={most:.4g}\n"
    )


def calibration_file(item: Item) -> bytes:
    """Return calib.txt of an item as bytes."""
    return middlebury_calibration(item.sample, item.labelled).encode()


def _middlebury_files(item: Item) -> dict[str, Content]:
    new = f"{item.split}/2014/{item.flat}"
    old = f"{item.split}/MiddEval3/trainingF/{item.flat}"
    return {
        f"{new}/im0.png": lambda: item.image("left.png"),
        f"{new}/im1.png": lambda: item.image("right.png"),
        f"{new}/im1E.png": SameAs(f"{new}/im1.png"),
        f"{new}/im1L.png": SameAs(f"{new}/im1.png"),
        f"{new}/disp0.pfm": lambda: gapped_pfm(item),
        f"{new}/mask0nocc.png": lambda: visibility_png(item),
        f"{new}/calib.txt": lambda: calibration_file(item),
        f"{old}/im0.png": SameAs(f"{new}/im0.png"),
        f"{old}/im1.png": SameAs(f"{new}/im1.png"),
        f"{old}/disp0GT.pfm": SameAs(f"{new}/disp0.pfm"),
        f"{old}/mask0nocc.png": SameAs(f"{new}/mask0nocc.png"),
        f"{old}/calib.txt": SameAs(f"{new}/calib.txt"),
    }


def _middlebury_lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    return {f"{split}/MiddEval3/official_train.txt": "".join(f"{item.flat}\n" for item in items)}


def _eth3d_files(item: Item) -> dict[str, Content]:
    images, truth = (f"{item.split}/two_view_training{end}/{item.flat}" for end in ("", "_gt"))
    return {
        f"{images}/im0.png": lambda: item.image("left.png"),
        f"{images}/im1.png": lambda: item.image("right.png"),
        f"{images}/calib.txt": lambda: calibration_file(item),
        f"{truth}/disp0GT.pfm": lambda: gapped_pfm(item),
        f"{truth}/mask0nocc.png": lambda: visibility_png(item),
    }


MIDDLEBURY = Layout(
    _middlebury_files,
    _middlebury_lists,
    """\
Middlebury. Each of `train/`, `val/`, `test/` is a root of its own with `2014/<scene>/` (im0, im1, disp0.pfm) and
`MiddEval3/trainingF/<scene>/` (im0, im1, disp0GT.pfm). `im1E.png` and `im1L.png`, in the original another exposure and
another light, are the same image as `im1.png`. PFM: inf where there is none (sky). `mask0nocc.png`: 255 seen by both
eyes, 128 hidden from the right one, 0 unknown. `calib.txt`: baseline in millimetres.
""",
)


ETH3D = Layout(
    _eth3d_files,
    no_lists,
    """\
ETH3D low-res two-view. Each of `train/`, `val/`, `test/` is a root of its own with `two_view_training/<scene>/` (im0,
im1, calib.txt; baseline in millimetres) and `two_view_training_gt/<scene>/` (disp0GT.pfm, inf in the sky;
mask0nocc.png: 255 seen by both eyes, 128 hidden from the right one, 0 unknown).
""",
)
