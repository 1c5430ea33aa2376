"""The layout of KITTI 2015."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.dataset.sample import StereoSample
from marssim.base.files.png import encode_png
from marssim.layouts.layout import (
    Content,
    Item,
    Layout,
    no_lists,
)

KITTI_SCALE = 256  # uint16 steps for each pixel of disparity


def kitti_code(disparity: np.ndarray, labelled: np.ndarray) -> np.ndarray:
    """Return disparity as KITTI stores it: 256 steps a pixel, 0 where it is unknown.

    Like the benchmark's own writer, it gives known disparities that are smaller than a step the code 1, and those that
    do not fit (256 px and more) the code 0.

    Args:
        disparity: (H, W) [px].
        labelled: (H, W) bool, the pixels whose disparity is known.

    Returns:
        (H, W) uint16.
    """
    code = np.round(disparity.astype(np.float64) * KITTI_SCALE)
    return np.where(labelled & (code <= 65535), np.maximum(code, 1), 0).astype(np.uint16)


def kitti_calibration(sample: StereoSample) -> str:
    """Return calib_cam_to_cam of a rectified pair. Cameras 00 and 02 are the left eye, 01 and 03 the right one [m]."""
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


def _files(item: Item) -> dict[str, Content]:
    root, name = f"{item.split}/training", f"{item.number:06d}"

    def disparity(visible_only: bool) -> bytes:
        labelled = item.labelled & ~item.sample.occluded if visible_only else item.labelled
        return encode_png(kitti_code(item.sample.disparity, labelled))

    return {
        f"{root}/image_2/{name}_10.png": lambda: item.image("left.png"),
        f"{root}/image_3/{name}_10.png": lambda: item.image("right.png"),
        f"{root}/disp_occ_0/{name}_10.png": lambda: disparity(False),
        f"{root}/disp_noc_0/{name}_10.png": lambda: disparity(True),
        f"{root}/calib_cam_to_cam/{name}.txt": lambda: kitti_calibration(item.sample).encode(),
    }


KITTI = Layout(
    _files,
    no_lists,
    """\
KITTI 2015. Each of `train/`, `val/`, `test/` is a root of its own with `training/` inside: `image_2` and `image_3`
(left and right eye), `disp_occ_0` (every known pixel), `disp_noc_0` (only those that both eyes see): 16-bit PNG,
disparity x 256, 0 where there is none (sky; 256 px and more, which do not fit). `calib_cam_to_cam/` holds `P_rect_02`
and `P_rect_03`; baseline = -P_rect_03[0, 3] / P_rect_03[0, 0] in metres.
""",
)
