"""Is a dataset on disk what its index says? Files are hashed, not decoded."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.camera import StereoRig
from marssim.base.compute.threads import in_threads
from marssim.base.dataset.dataset import VERSION, StereoDataset, split_of
from marssim.base.dataset.marks import SETTINGS
from marssim.base.dataset.sample import IMAGES, sample_digest
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.results.lock import LOCK
from marssim.scene.trajectory import TRAJECTORY, tum_lines

TOP = ("dataset.json", SETTINGS, "README.md", "contact_sheet.png")
LEFT = "left by a run that was interrupted, or of one that is at work; the command that made the data removes it"
PNG_START = bytes.fromhex("89504e470d0a1a0a0000000d49484452")  # up to the sizes
PNG_END = bytes.fromhex("0000000049454e44ae426082")
PNG_KIND = {  # bits a channel and colour type (0 grey, 2 RGB) of each image
    "left.png": (8, 2), "right.png": (8, 2), "depth.png": (16, 0), "normal.png": (16, 2), "surface.png": (16, 0),
    "occluded.png": (8, 0),
}  # fmt: skip
ELEVATION = 0.01  # [deg]
RIGID = 1e-6  # by which a pose's rotation may miss being orthonormal


@dataclass(frozen=True)
class Finding:
    """Something wrong with a file. path: within the dataset."""

    path: str
    problem: str

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}"


def check_samples(dataset: StereoDataset, threads: int = 2) -> Iterator[tuple[str, list[Finding]]]:
    """Name of each sample, in order, with what is wrong with its files. Raises DatasetError for an older version."""
    if dataset.index["version"] != VERSION:
        raise DatasetError(
            f"{dataset.path / 'dataset.json'}: is of version {dataset.index['version']}, whose hashes leave out "
            f"sample.json; it can be read, but not checked: generate it anew for version {VERSION}"
        )
    recorded = {sample["name"]: sample["sha256"] for sample in dataset.index["samples"]}
    check = partial(_check_sample, dataset.path, recorded)
    return zip(dataset.names, in_threads(check, dataset.names, threads))


def check_index(dataset: StereoDataset) -> list[Finding]:
    """What is wrong with the index itself: other settings, a sample listed twice or in the split of another scene."""
    found: list[Finding] = []
    seen = set()
    if (dataset.path / SETTINGS).is_file():
        found += _check_settings(dataset)
    for sample in dataset.index["samples"]:
        name, split = sample["name"], sample["split"]
        if name in seen:
            found.append(Finding("dataset.json", f"lists {name} twice"))
        seen.add(name)
        due = split_of(int(name.split("/")[0]))
        if split != due:
            found.append(Finding("dataset.json", f"{name} is in {split}, its scene belongs to {due}"))
    return found


def _check_settings(dataset: StereoDataset) -> list[Finding]:
    try:
        asked = read_json(dataset.path / SETTINGS)
    except DatasetError as error:
        return [Finding(SETTINGS, str(error).removeprefix(f"{dataset.path / SETTINGS}: "))]
    config = dataset.index.get("config")
    config = config if isinstance(config, dict) else {}
    own = {"command", "pairs"}  # of the folder, of the index
    same = {k: v for k, v in asked.items() if k not in own} == {k: v for k, v in config.items() if k not in own}
    return [] if same else [Finding(SETTINGS, "other settings than dataset.json holds")]


def check_trajectories(dataset: StereoDataset) -> list[Finding]:
    """Where a scene's views are a drive (generate --trajectory), its poses must lie beside them as they are in them."""
    config = dataset.index.get("config")
    if not (isinstance(config, dict) and config.get("trajectory")):
        return []
    views: dict[str, list[str]] = {}
    for name in dataset.names:
        views.setdefault(name.split("/")[0], []).append(name)
    found = []
    for scene, names in views.items():
        path = f"scenes/{scene}/{TRAJECTORY}"
        try:
            text = (dataset.path / path).read_text()
        except (OSError, ValueError):
            found.append(Finding(path, "missing, or cannot be read"))
            continue
        try:
            metas = [read_json(dataset.path / "scenes" / name / "sample.json") for name in names]
            due = tum_lines([meta["timestamp"] for meta in metas], np.array([meta["pose"] for meta in metas]))
        except (KeyError, ValueError, TypeError, IndexError):
            continue  # check_samples names the sample
        if text != due:
            found.append(Finding(path, "other poses or times than those of the views"))
    return found


def check_extra(dataset: StereoDataset, own: Path | None = None) -> list[Finding]:
    """Files that are neither the dataset's nor below `own`, the folder of a report; whole folders as one."""
    expected = set(TOP) | {f"scenes/{n}/{file}" for n in dataset.names for file in (*IMAGES, "sample.json")}
    expected |= {f"scenes/{n.split('/')[0]}/{TRAJECTORY}" for n in dataset.names}
    folders = {str(parent) for path in expected for parent in Path(path).parents}
    if own is not None and own.resolve().is_relative_to(dataset.path.resolve()):
        inside = own.resolve().relative_to(dataset.path.resolve())
        folders |= {parent.as_posix() for parent in inside.parents}
    found = []
    waiting = [dataset.path]
    while waiting:
        for entry in sorted(waiting.pop().iterdir()):
            path = entry.relative_to(dataset.path).as_posix()
            if own is not None and entry.resolve() == own.resolve():
                continue
            if entry.is_dir() and not entry.is_symlink():
                if path in folders:
                    waiting.append(entry)
                elif entry.name.endswith(".partial"):
                    found.append(Finding(path, LEFT))
                else:
                    found.append(Finding(path, "a folder that the index does not list"))
            elif path not in expected and path != LOCK:  # which locks nothing after the command that held it
                left = entry.name.startswith(".") and entry.name.endswith(".part")
                found.append(Finding(path, LEFT if left else "a file that the dataset does not have"))
    return found


def check_written(root: Path, names: Sequence[str], threads: int = 2) -> list[Finding]:
    """What is wrong with samples ("scene/view") that lie in a folder without an index: one that is being completed."""
    return [finding for found in in_threads(partial(_check_sample, root, {}), names, threads) for finding in found]


def _check_sample(root: Path, recorded: dict[str, str], name: str) -> list[Finding]:
    folder = root / "scenes" / name

    def finding(file: str, problem: str) -> Finding:
        return Finding(f"scenes/{name}/{file}", problem)

    if not folder.is_dir():
        return [Finding(f"scenes/{name}", "missing")]
    file = folder / "sample.json"
    try:
        meta, digest = read_json(file), sample_digest(folder)
        rig = _check_meta(meta)
    except (DatasetError, ValueError) as error:
        found = [finding("sample.json", str(error).removeprefix(f"{file}: "))]
        return found + [finding(image, "missing") for image in IMAGES if not (folder / image).is_file()]
    found = []
    if digest != recorded.get(name, digest):
        found.append(finding("sample.json", "other content than dataset.json records"))
    for image in IMAGES:
        problem = _check_image(folder / image, meta["sha256"][image], rig)
        if problem:
            found.append(finding(image, problem))
    return found


def _check_meta(meta: dict[str, Any]) -> StereoRig:
    """The rig. Raises ValueError that names a field which is missing or cannot be."""
    for field in ("rig", "pose"):
        if field not in meta:
            raise ValueError(f"field '{field}' is missing")
    rotation = _numbers(meta["pose"], (4, 4))[:3, :3]
    if not (np.abs(rotation @ rotation.T - np.eye(3)).max() < RIGID and np.linalg.det(rotation) > 0):
        raise ValueError("pose is not a 4 x 4 rigid motion")
    if "sun" in meta:
        sun = _numbers(meta["sun"], (3,))
        if not abs(float(np.linalg.norm(sun)) - 1) < RIGID:
            raise ValueError("sun is not a unit vector")
        elevation = float(_numbers(meta.get("sun_elevation_deg"), ()))
        if not abs(np.rad2deg(np.arcsin(np.clip(sun[2], -1, 1))) - elevation) < ELEVATION:
            raise ValueError("sun_elevation_deg is not that of sun")
    return StereoRig.from_dict(meta["rig"])


def _numbers(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """As an array of that shape; of NaN if it is no such thing."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    return array if array.shape == shape else np.full(shape, np.nan)


def _check_image(path: Path, recorded: str, rig: StereoRig) -> str | None:
    """What is wrong with an image file, if anything."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return "missing"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if hashlib.sha256(data).hexdigest() != recorded:
        if not data:
            return "empty"
        return "other content than recorded" if PNG_END in data else "truncated"
    if not (len(data) > 26 and data.startswith(PNG_START) and data.endswith(PNG_END)):
        return "is no whole PNG image" if data else "empty"
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    if (width, height) != (rig.camera.width, rig.camera.height) or (bits, colour) != PNG_KIND[path.name]:
        return f"is {width} x {height} px, {bits} bits, not what the rig and the format say"
    return None
