"""Rectified stereo pairs: their checks, the range of matching, and sequences of them."""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np

from marssim.base.camera import MAX_DEPTH, MIN_DEPTH, StereoRig

NEAREST = 0.84  # [m] shortest depth at which every method searches for matches; 192 px for NaTeCam
MAX_DISPARITY = 192.0  # [px] pixels of larger disparity are not trained, and are scored apart
TINY = 32  # [px] images of at most this height and width are padded: M3Depth's first maps are wrong on 4 x 4 cells
LEAST_PIXELS = 2048  # of a pair that is reduced: none is tiny then
LARGEST_SIDE = (1 << 15) - 2  # [px] of images that OpenCV resamples


class StereoPairs(Protocol):
    """A sequence of samples with ground truth, with the fields of StereoSample (marssim.base.dataset.sample)."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Any: ...


def pair_name(pairs: StereoPairs, index: int) -> str:
    """Return the dataset's own name of a pair; where it has none, its index.

    Args:
        pairs: The dataset.
        index: Index of the pair.
    """
    names = getattr(pairs, "names", None)
    return f"{index:06d}" if names is None else names[index]


def scene_name(pairs: StereoPairs, index: int) -> str:
    """Return the dataset's name of a pair's scene; where it has no scenes, each pair is one.

    Args:
        pairs: The dataset.
        index: Index of the pair.
    """
    scenes = getattr(pairs, "scenes", None)
    return pair_name(pairs, index) if scenes is None else scenes[index]


def scored_depths(pairs: StereoPairs) -> tuple[float, float]:
    """Return the nearest and farthest depth [m] in the `valid` masks of pairs; by default the paper's 0.5 to 15 m."""
    return getattr(pairs, "depth_range", (MIN_DEPTH, MAX_DEPTH))


def largest_disparity(rig: StereoRig, nearest: float = NEAREST) -> float:
    """Return the largest disparity [px] that a method must find: that of `nearest` [m], or the width of the images."""
    return min(rig.fb / nearest, float(rig.camera.width))


def spread(count: int, wanted: int) -> list[int]:
    """Return at most `wanted` of range(count), evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(wanted, count)).round().astype(int)).tolist()


def in_colour(image: np.ndarray) -> np.ndarray:
    """Return an image (H, W) or (H, W, 3) as (H, W, 3); grey becomes three equal channels."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def in_grey(image: np.ndarray) -> np.ndarray:
    """Return an image (H, W) or RGB (H, W, 3), uint8 or float32, as (H, W)."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image


def checked_pair(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[np.ndarray, np.ndarray]:
    """Return both images as (H, W) or (H, W, 3) uint8; a single channel is squeezed.

    Args:
        left: (H, W) or (H, W, 3) uint8, RGB, rectified.
        right: The right image, likewise.
        rig: The cameras of these images.

    Raises:
        ValueError: An image has a wrong type or shape, not the rig's size, or a side of more than 32766 px; the message
            names it.
    """
    checked = []
    for name, image in (("left", left), ("right", right)):
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
            kind = str(getattr(image, "dtype", type(image).__name__))
            advice = "; m3depth.datasets.image_files.in_eight_bits converts a pair" if kind == "uint16" else ""
            raise ValueError(f"{name} image must be a uint8 array, got {kind}{advice}")
        if image.ndim == 3 and image.shape[2] == 1:
            image = image[..., 0]
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
            advice = "; image[..., :3] is without the alpha channel" if image.shape[2:] == (4,) else ""
            raise ValueError(f"{name} image must be (H, W) or (H, W, 3), got {image.shape}{advice}")
        if image.shape[:2] != (rig.camera.height, rig.camera.width):
            raise ValueError(
                f"{name} image is {image.shape[1]} x {image.shape[0]}, "
                f"the rig's camera is {rig.camera.width} x {rig.camera.height}"
            )
        if max(image.shape[:2]) > LARGEST_SIDE:
            size = f"{image.shape[1]} x {image.shape[0]}"
            raise ValueError(f"{name} image is {size}: sides of at most {LARGEST_SIDE} px can be matched")
        checked.append(image)
    return checked[0], checked[1]
