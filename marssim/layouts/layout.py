"""What a layout is, and the files that several layouts have in common."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from marssim.base.dataset.sample import StereoSample, read_sample
from marssim.base.files.json_file import DatasetError
from marssim.base.files.pfm import encode_pfm
from marssim.base.files.png import encode_png
from marssim.base.files.whole_file import read_file


@dataclass(frozen=True)
class SameAs:
    """A file with the content of another file of the same sample; a hard link where the file system allows it."""

    path: str
    """Path of the other file under the output folder."""


@dataclass(frozen=True)
class Item:
    """One sample to be exported."""

    folder: Path
    """Folder of the sample in the dataset."""
    name: str
    """Name of the sample, "scene/view"."""
    split: str
    """Split that its scene belongs to."""
    number: int
    """Position of the sample within its split, from 0."""

    @property
    def flat(self) -> str:
        """The name with an underscore instead of the slash, for file names."""
        return self.name.replace("/", "_")

    @cached_property
    def sample(self) -> StereoSample:
        """The sample, read at the first use.

        Raises:
            DatasetError: A file is missing or broken. The message names it.
        """
        return read_sample(self.folder)

    @property
    def labelled(self) -> np.ndarray:
        """(H, W) bool, true where the disparity is known and positive: everywhere but in the sky and, if the right
        image lies too far right, on very far ground."""
        return np.isfinite(self.sample.depth) & (self.sample.disparity > 0)

    def image(self, name: str) -> bytes:
        """Return the bytes of an image file.

        Args:
            name: "left.png" or "right.png".

        Raises:
            DatasetError: The file is missing, or sample.json records another content.
        """
        path = self.folder / name
        try:
            data = read_file(path)
        except FileNotFoundError:
            raise DatasetError(f"{path}: no such file") from None
        except OSError as error:
            raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
        recorded = self.sample.meta.get("sha256")
        if not isinstance(recorded, dict) or hashlib.sha256(data).hexdigest() != recorded.get(name):
            raise DatasetError(
                f"{path}: its content is not what sample.json records; python -m marssim.verify lists all such files"
            )
        return data


Content = Callable[[], bytes] | SameAs


@dataclass(frozen=True)
class Layout:
    """The files that an export writes."""

    sample: Callable[[Item], dict[str, Content]]
    """Returns the content of each file of an item, by its path under the output folder."""
    lists: Callable[[str, Sequence[Item]], dict[str, str]]
    """Returns the text of the files that list all items of a split, by path. They are written last."""
    about: str
    """What a reader of the export has to know, in Markdown."""


def no_lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    """Return no files: the layout has no lists."""
    return {}


def dense_pfm(item: Item) -> bytes:
    """Encode the disparity [px] as PFM, with 0 in the sky, which is infinitely far."""
    return encode_pfm(np.where(item.labelled, item.sample.disparity, 0))


def gapped_pfm(item: Item) -> bytes:
    """Encode the disparity [px] as PFM, with inf in the sky, as Middlebury marks unknown pixels."""
    return encode_pfm(np.where(item.labelled, item.sample.disparity, np.inf))


def occlusion_png(item: Item) -> bytes:
    """Encode the occlusion mask as PNG: 255 where the right eye does not see the point."""
    return encode_png(item.sample.occluded.astype(np.uint8) * 255)


def visibility_png(item: Item) -> bytes:
    """Encode the visibility as PNG: 255 seen by both eyes, 128 hidden from the right eye, 0 unknown (sky)."""
    return encode_png(np.where(item.labelled, np.where(item.sample.occluded, 128, 255), 0).astype(np.uint8))
