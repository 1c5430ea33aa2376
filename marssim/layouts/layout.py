"""What a layout is, and the files that several layouts share."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from marssim.base.dataset.sample import StereoSample, read_sample
from marssim.base.files.json_file import DatasetError
from marssim.base.files.pfm import encode_pfm


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


def png_bytes(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def no_lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    return {}


def dense_pfm(item: Item) -> bytes:
    """PFM of the disparity, 0 in the sky: the disparity of what is infinitely far."""
    return encode_pfm(np.where(item.known, item.sample.disparity, 0))


def gapped_pfm(item: Item) -> bytes:
    """PFM of the disparity, inf in the sky, where Middlebury's ground truth is unknown."""
    return encode_pfm(np.where(item.known, item.sample.disparity, np.inf))


def occlusion_png(item: Item) -> bytes:
    return png_bytes(item.sample.occluded.astype(np.uint8) * 255)


def visibility_png(item: Item) -> bytes:
    """255 seen by both eyes, 128 hidden from the right one, 0 unknown (sky)."""
    return png_bytes(np.where(item.known, np.where(item.sample.occluded, 128, 255), 0).astype(np.uint8))
