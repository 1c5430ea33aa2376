"""Read a stereo dataset from disk, and write its index. A dataset is a folder of PNG and JSON files:

DIR/generate.json            the settings of marssim.generate
DIR/dataset.json             the index: every sample, its split and the SHA-256 of its sample.json; written last
DIR/scenes/00003/05/         one sample (scene 3, view 5)
    left.png right.png       8-bit RGB
    depth.png                16-bit, logarithmic: see encode_depth; 65535 is the sky
    normal.png               16-bit RGB, (n + 1) / 2 scaled to 65535; 0 0 0 is the sky
    surface.png              16-bit, 0 sky, 1 ground, n + 1 rock, slab, block or fragment n (from 1), 65535 the rover
    occluded.png             8-bit, 255 where the right eye does not see the point
    sample.json              rig, pose, rotation of the right camera, scene parameters, what was drawn from their ranges
                             (sun, air, surface, sensor), and the SHA-256 of each image

So the hashes in the index cover every byte of every sample. In version 1 they covered the images only. Up to version 2
the rotation of the right camera was not recorded, and disparity and occlusion were those of the ideal rig.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, overload

from marssim.base.command.wording import counted
from marssim.base.dataset.marks import EXPORTED, SETTINGS
from marssim.base.dataset.sample import StereoSample, is_complete, read_sample, sample_digest
from marssim.base.files.json_file import DatasetError, read_json, write_json

SCHEMA = "marssim-stereo"
VERSION = 3
READABLE = (1, 2, VERSION)
SPLITS = ("train", "val", "test")
SPLIT_OF_TEN = ("train", "test", "val", "train", "train", "train", "val", "train", "train", "train")

Split = Literal["train", "val", "test"]


class StereoDataset:
    """A dataset, or one split of it, as a sequence of StereoSample. Each access by index reads the files of the sample.

    Args:
        path: Folder of the dataset.
        split: "train", "val" or "test"; None for all. A dataset of few scenes has no pairs in val and test.

    Attributes:
        path: Folder of the dataset.
        split: The split.
        index: Content of dataset.json.
        names: Name of each sample, "scene/view".
        scenes: Name of each sample's scene.

    Raises:
        DatasetError: The folder holds no dataset that can be read.
        ValueError: The split is unknown.
    """

    def __init__(self, path: str | os.PathLike[str], split: Split | None = None) -> None:
        self.path = Path(path)
        self.split = split
        if split is not None and split not in SPLITS:
            raise ValueError(f"split {split!r} is unknown; choose from {', '.join(SPLITS)}")
        if not self.path.is_dir():
            what = "is a file; give the dataset's folder" if self.path.exists() else "no such folder"
            raise DatasetError(f"{self.path}: {what}")
        file = self.path / "dataset.json"
        if not file.is_file():
            _check_not_unfinished(self.path)
            raise DatasetError(
                f"{self.path}: holds no dataset of marssim, as dataset.json is missing; give the folder that "
                "marssim.generate wrote"
            )
        self.index = read_json(file)
        if self.index.get("schema") != SCHEMA:
            raise DatasetError(f"{file}: schema is {self.index.get('schema')!r}, not {SCHEMA!r}")
        if self.index.get("version") not in READABLE:
            versions = f"{', '.join(map(str, READABLE[:-1]))} and {VERSION}"
            raise DatasetError(f"{file}: is of version {self.index.get('version')!r}, this marssim reads {versions}")
        if not _lists_samples(self.index):
            raise DatasetError(f"{file}: samples must list name (scene/view), split and sha256")
        folders = Counter(tuple(map(int, s["name"].split("/"))) for s in self.index["samples"])
        for (scene, view), times in folders.items():
            if times > 1:  # in two splits, for one: it would be trained on and scored
                raise DatasetError(f"{file}: lists scene {scene}, view {view} more than once")
        self.names: list[str] = [s["name"] for s in self.index["samples"] if split in (None, s["split"])]
        self.scenes: list[str] = [name.partition("/")[0] for name in self.names]

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> StereoSample: ...
    @overload
    def __getitem__(self, index: slice) -> list[StereoSample]: ...
    def __getitem__(self, index: int | slice) -> StereoSample | list[StereoSample]:
        if isinstance(index, slice):
            return [read_sample(self.path / "scenes" / name) for name in self.names[index]]
        if not -len(self) <= index < len(self):
            part = "the dataset" if self.split is None else f"split {self.split}"
            held = counted(len(self), "pair") if len(self) else "no pairs"
            raise IndexError(f"{self.path}: {part} holds {held}, there is no index {index}")
        return read_sample(self.path / "scenes" / self.names[index])

    def __iter__(self) -> Iterator[StereoSample]:
        return (self[i] for i in range(len(self)))

    @cached_property
    def digest(self) -> str:
        """SHA-256 over the names and hashes of all samples of all splits, in hexadecimal."""
        lines = "".join(f"{s['name']} {s['sha256']}\n" for s in self.index["samples"])
        return hashlib.sha256(lines.encode()).hexdigest()


def split_of(scene: int) -> str:
    """Return the split of a scene, which its number alone determines.

    Of every ten scenes, seven are in train, two in val and one in test. The first three scenes are of all three splits.

    Args:
        scene: Number of the scene, from 0.
    """
    return SPLIT_OF_TEN[scene % len(SPLIT_OF_TEN)]


def write_index(path: Path, config: dict[str, Any], names: list[str]) -> None:
    """Write dataset.json, the index of a dataset.

    Args:
        path: Folder of the dataset.
        config: The settings of marssim.generate, and "pairs".
        names: "scene/view" of the samples, all of which must be on disk.

    Raises:
        DatasetError: A sample.json cannot be read.
        OSError: The index cannot be written.
    """
    samples = [
        {"name": name, "split": split_of(int(name.split("/")[0])), "sha256": sample_digest(path / "scenes" / name)}
        for name in names
    ]
    index = {"schema": SCHEMA, "version": VERSION, "config": config, "samples": samples}
    write_json(path / "dataset.json", index)


def _check_not_unfinished(path: Path) -> None:
    """Raise DatasetError if a folder without an index is an unfinished dataset or an export."""
    if (path / SETTINGS).is_file():
        raise DatasetError(_unfinished(path))
    if (path / EXPORTED).is_file():
        layout = read_json(path / EXPORTED).get("format")
        raise DatasetError(f"{path}: is an export of format {layout}, not a dataset of marssim.generate")


def _unfinished(path: Path) -> str:
    """Return the message on a dataset that has settings and no index yet."""
    done = sum(is_complete(file.parent) for file in path.glob("scenes/*/[0-9]*/sample.json"))
    flags = _flags(read_json(path / SETTINGS).get("command"))
    if flags is None:
        completion = "the call that began it completes it"
    else:
        completion = f"python -m marssim.generate --out {shlex.quote(str(path))} {flags} completes it"
    return f"{path}: not finished, it has {counted(done, 'pair')}; {completion}"


def _flags(command: Any) -> str | None:
    """Return recorded flags so that a shell takes each word as it is; None if there are none, or no terminal's text."""
    if not isinstance(command, str) or not command.isprintable():
        return None
    try:
        return shlex.join(shlex.split(command))
    except ValueError:  # an open quote
        return None


def _lists_samples(index: dict[str, Any]) -> bool:
    """Return whether each sample of the index has the name of a folder in the dataset, a split and a hash."""
    samples = index.get("samples")
    return isinstance(samples, list) and all(
        isinstance(s, dict)
        and re.fullmatch(r"[0-9]{1,9}/[0-9]{1,9}", str(s.get("name"))) is not None
        and s.get("split") in SPLITS
        and isinstance(s.get("sha256"), str)
        for s in samples
    )
