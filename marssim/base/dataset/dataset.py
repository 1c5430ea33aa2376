"""Stereo datasets on disk: plain PNG and JSON files, written atomically, hashed, and read back as arrays.

DIR/generate.json            what was asked for
DIR/dataset.json             the index: every sample, its split and the SHA-256 of its sample.json; written last
DIR/scenes/00003/05/         one sample (scene 3, view 5)
    left.png right.png       8-bit RGB
    depth.png                16-bit, logarithmic: see encode_depth; 65535 is the sky
    normal.png               16-bit RGB, (n + 1) / 2 scaled to 65535; 0 0 0 is the sky
    surface.png              16-bit, 0 sky, 1 ground, n + 2 rock n
    occluded.png             8-bit, 255 where the right eye does not see the point
    sample.json              rig, pose, scene parameters, what was drawn from their ranges (sun, air, surface, sensor),
                             and the SHA-256 of each image

So the index holds, by way of each sample.json, every byte of every sample. In version 1 it held the images only.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, overload
from uuid import uuid4

import cv2
import numpy as np

from marssim.base.camera import MAX_DEPTH, MIN_DEPTH, StereoRig
from marssim.base.dataset.encoding import decode_depth, decode_normal, encode_depth, encode_normal
from marssim.base.files.atomic import write_atomically
from marssim.base.files.png import decode_png
from marssim.render.geometry.gbuffer import SKY
from marssim.render.stereo import StereoFrame

SCHEMA = "marssim-stereo"
VERSION = 2
READABLE = (1, VERSION)
SETTINGS = "generate.json"
EXPORTED = "export.json"  # of a folder that marssim.export has written
MOST_LEVELS = 64  # of nesting in a JSON file; our own have less than ten
TOO_DEEP = f"more than {MOST_LEVELS} lists and objects within each other"
SPLITS = ("train", "val", "test")
SPLIT_OF_TEN = ("train", "test", "val", "train", "train", "train", "val", "train", "train", "train")
IMAGES = ("left.png", "right.png", "depth.png", "normal.png", "surface.png", "occluded.png")
# the fastest that PNG has to offer for each, at about equal size: noise does not repeat, so searching it for repeats is
# lost time; maps do, and normals are those of facets: unfiltered they repeat as they are
_PLAIN = [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
_NOISY = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
_RUNS = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
PNG = {
    name: [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB, *strategy]
    for name, strategy in zip(IMAGES, (_NOISY, _NOISY, [], _PLAIN, _RUNS, _RUNS))
}

Split = Literal["train", "val", "test"]


class DatasetError(ValueError):
    """A dataset that cannot be read; the message names the file."""


@dataclass(frozen=True)
class StereoSample:
    """One stereo pair with its ground truth; maps are of the left eye, frame: left camera, x right, y down, z forward.

    left, right: (H, W, 3) uint8 RGB. depth: (H, W) float32 [m], z along the optical axis, inf in the sky.
    disparity: (H, W) float32 [px], 0 in the sky. normal: (H, W, 3) float32, unit, facing the camera, 0 in the sky.
    valid: (H, W) bool, depth within 0.5 m to 15 m. occluded: (H, W) bool, not seen by the right eye.
    rock: (H, W) int32, 0 or the rock's number, from 1. rig: StereoRig. meta: the sample's JSON.
    """

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    valid: np.ndarray
    occluded: np.ndarray
    rock: np.ndarray
    rig: StereoRig
    meta: dict[str, Any]


class StereoDataset:
    """A dataset folder as a sequence of StereoSample.

    split: "train", "val", "test" or None for all; it may hold no pairs, as val and test do where there are few scenes.
    Raises DatasetError if the folder holds no readable dataset and ValueError for an unknown split. Indexing reads the
    files of that sample anew.
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
            _check_no_other(self.path)
        self.index = read_json(file)
        if self.index.get("schema") != SCHEMA:
            raise DatasetError(f"{file}: schema is {self.index.get('schema')!r}, not {SCHEMA!r}")
        if self.index.get("version") not in READABLE:
            versions = " and ".join(map(str, READABLE))
            raise DatasetError(f"{file}: is of version {self.index.get('version')!r}, this marssim reads {versions}")
        if not _lists_samples(self.index):
            raise DatasetError(f"{file}: samples must list name (scene/view), split and sha256")
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
            raise IndexError(f"{self.path}: {part} holds {len(self) or 'no'} pairs, there is no index {index}")
        return read_sample(self.path / "scenes" / self.names[index])

    def __iter__(self) -> Iterator[StereoSample]:
        return (self[i] for i in range(len(self)))

    @cached_property
    def digest(self) -> str:
        """One hash over the hashes of all samples of all splits."""
        lines = "".join(f"{s['name']} {s['sha256']}\n" for s in self.index["samples"])
        return hashlib.sha256(lines.encode()).hexdigest()


def split_of(scene: int) -> str:
    """The split of a scene: 7:2:1 in every ten scenes, by its index alone; three scenes already give every split."""
    return SPLIT_OF_TEN[scene % len(SPLIT_OF_TEN)]


def write_sample(folder: Path, frame: StereoFrame, meta: dict[str, Any]) -> None:
    """Write one sample so that the folder appears complete or not at all. Raises OSError if the disk refuses.

    Nothing half written stays, but for a process that is killed. Two that write the same sample, as a run on a cluster
    and the next one may for a moment, do not touch each other's files; whoever is done last finds it done.
    """
    images = {
        "left.png": frame.left[..., ::-1],
        "right.png": frame.right[..., ::-1],
        "depth.png": encode_depth(frame.depth),
        "normal.png": encode_normal(frame.normal)[..., ::-1],
        "surface.png": (frame.surface + 1).astype(np.uint16),
        "occluded.png": frame.occluded.astype(np.uint8) * 255,
    }
    partial = folder.with_name(f".{folder.name}.{uuid4().hex}.partial")
    try:
        partial.mkdir(parents=True)
        digest = {}
        for name, image in images.items():
            encoded = cv2.imencode(".png", np.ascontiguousarray(image), PNG[name])[1].tobytes()
            digest[name] = hashlib.sha256(encoded).hexdigest()
            (partial / name).write_bytes(encoded)
        meta = {**meta, "rig": frame.rig.to_dict(), "pose": frame.pose.tolist(), "sha256": digest}
        (partial / "sample.json").write_text(json.dumps(meta, indent=1, sort_keys=True))
        shutil.rmtree(folder, ignore_errors=True)
        try:
            partial.rename(folder)
        except OSError:
            if not is_complete(folder):
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def is_complete(folder: Path) -> bool:
    """Are all files of a sample there, none of them empty? What they hold is not looked at."""
    files = (folder / name for name in ("sample.json", *IMAGES))
    return all(file.is_file() and file.stat().st_size > 0 for file in files)


def read_sample(folder: Path) -> StereoSample:
    """Read one sample. Raises DatasetError that names the file which is missing or broken."""
    meta = read_json(folder / "sample.json")
    try:
        rig = StereoRig.from_dict(meta["rig"])
    except KeyError:
        raise DatasetError(f"{folder / 'sample.json'}: field 'rig' is missing") from None
    except ValueError as error:
        raise DatasetError(f"{folder / 'sample.json'}: {error}") from None
    size = (rig.camera.height, rig.camera.width)
    surface = _read_image(folder / "surface.png", size, np.uint16).astype(np.int32) - 1
    depth = decode_depth(_read_image(folder / "depth.png", size, np.uint16))
    depth[surface == SKY] = np.inf
    return StereoSample(
        left=_read_image(folder / "left.png", (*size, 3), np.uint8)[..., ::-1].copy(),
        right=_read_image(folder / "right.png", (*size, 3), np.uint8)[..., ::-1].copy(),
        depth=depth,
        disparity=rig.depth_to_disparity(depth),
        normal=decode_normal(_read_image(folder / "normal.png", (*size, 3), np.uint16)[..., ::-1]),
        valid=(depth >= MIN_DEPTH) & (depth <= MAX_DEPTH),
        occluded=_read_image(folder / "occluded.png", size, np.uint8) > 0,
        rock=np.maximum(surface, 0),
        rig=rig,
        meta=meta,
    )


def sample_digest(folder: Path) -> str:
    """SHA-256 of a sample's sample.json, which holds those of its images. Raises DatasetError if it does not."""
    file = folder / "sample.json"
    digest = read_json(file).get("sha256")
    if not isinstance(digest, dict) or set(digest) != set(IMAGES):
        raise DatasetError(f"{file}: sha256 must hold the hash of each image")
    return hashlib.sha256(file.read_bytes()).hexdigest()


def write_index(path: Path, config: dict[str, Any], names: list[str]) -> None:
    """Write dataset.json over the samples `names` ("scene/view"), which must be there."""
    samples = [
        {"name": name, "split": split_of(int(name.split("/")[0])), "sha256": sample_digest(path / "scenes" / name)}
        for name in names
    ]
    index = {"schema": SCHEMA, "version": VERSION, "config": config, "samples": samples}
    write_json(path / "dataset.json", index)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Replace a JSON file in one step."""
    write_atomically(path, (json.dumps(content, indent=1, sort_keys=True) + "\n").encode())


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object. Raises DatasetError that names the file."""
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except OSError as error:
        raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except ValueError as error:  # bytes that are no text, or no JSON
        raise DatasetError(f"{path}: is not JSON: {error}") from None
    except RecursionError:
        raise DatasetError(f"{path}: {TOO_DEEP}") from None
    if not isinstance(content, dict):
        raise DatasetError(f"{path}: not a JSON object")
    if _deeper(content, MOST_LEVELS):
        raise DatasetError(f"{path}: {TOO_DEEP}")
    return content


def _deeper(content: dict[str, Any], levels: int) -> bool:
    """Are dicts and lists nested in more levels? What compares and writes them again recurs, and would break."""
    level: list[Any] = [content]
    for _ in range(levels):
        inner = (part for whole in level for part in (whole.values() if isinstance(whole, dict) else whole))
        level = [part for part in inner if isinstance(part, dict | list)]
    return bool(level)


def _check_no_other(path: Path) -> None:
    """Raise DatasetError that says what a folder without an index is, if that can be known."""
    if (path / SETTINGS).is_file():
        raise DatasetError(_unfinished(path))
    if (path / EXPORTED).is_file():
        layout = read_json(path / EXPORTED).get("format")
        raise DatasetError(f"{path}: is an export of format {layout}, not a dataset of marssim.generate")


def _unfinished(path: Path) -> str:
    """What a folder says that has settings and no index yet."""
    done = sum(is_complete(file.parent) for file in path.glob("scenes/*/[0-9]*/sample.json"))
    command = read_json(path / SETTINGS).get("command")
    if not isinstance(command, str):
        how = "the call that began it completes it"
    else:
        how = f"python -m marssim.generate --out {shlex.quote(str(path))} {command} completes it"
    return f"{path}: not finished, {done} pairs are there; {how}"


def _lists_samples(index: dict[str, Any]) -> bool:
    """Is every sample of the index named like a folder within the dataset, with a split and a hash?"""
    samples = index.get("samples")
    return isinstance(samples, list) and all(
        isinstance(s, dict)
        and re.fullmatch(r"\d+/\d+", str(s.get("name"))) is not None
        and s.get("split") in SPLITS
        and isinstance(s.get("sha256"), str)
        for s in samples
    )


def _read_image(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    try:
        image = decode_png(path.read_bytes())
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except OSError as error:
        raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    if image is None:
        raise DatasetError(f"{path}: not a readable image")
    if image.shape != shape or image.dtype != dtype:
        sizes = " x ".join(str(n) for n in (shape[1], shape[0], *shape[2:]))
        raise DatasetError(f"{path}: must be {sizes} {np.dtype(dtype)} as the rig says, is {image.shape} {image.dtype}")
    return image
