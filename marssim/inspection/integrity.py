"""Checks that a dataset on disk is what its index records. Files are hashed, not decoded."""

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
from marssim.base.dataset.marks import MARK_NOTES, SETTINGS
from marssim.base.dataset.sample import IMAGES, RAW, recorded_mount, recorded_time, sample_digest
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.files.whole_file import read_file
from marssim.base.pose import recorded_pose
from marssim.base.results.lock import LOCK
from marssim.base.right_image import recorded_rotation
from marssim.scene.trajectory import TRAJECTORY, tum_lines

CALIBRATION = "calibration"  # folder of the calibration files, in a dataset with raw pairs
TOP = ("dataset.json", SETTINGS, "README.md", "contact_sheet.png")  # files of a dataset's own folder
UNFINISHED = (
    "an unfinished file of a run that was interrupted or still works; the command that made the data removes it"
)
PNG_START = bytes.fromhex("89504e470d0a1a0a0000000d49484452")  # of a PNG file, up to its width
PNG_END = bytes.fromhex("0000000049454e44ae426082")
PNG_KIND = {  # of each image: bits a channel, and colour type (0 grey, 2 RGB)
    "left.png": (8, 2), "right.png": (8, 2), "depth.png": (16, 0), "normal.png": (16, 2), "surface.png": (16, 0),
    "occluded.png": (8, 0), **dict.fromkeys(RAW, (8, 2)),
}  # fmt: skip
ELEVATION_TOLERANCE = 0.01  # [deg] between the elevation of the sun and its vector
UNIT_TOLERANCE = 1e-6  # by which a vector's length may miss 1


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a file."""

    path: str
    """Path of the file within the dataset."""
    problem: str
    """What is wrong with it."""

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}"


def check_samples(dataset: StereoDataset, threads: int = 2) -> Iterator[tuple[str, list[Finding]]]:
    """Check the files of all samples.

    Args:
        dataset: The dataset.
        threads: How many files are hashed at the same time.

    Returns:
        Pairs of a sample's name and the findings on its files, in the order of the index.

    Raises:
        DatasetError: The dataset is of version 1, whose hashes do not cover sample.json.
    """
    if dataset.index["version"] == 1:
        raise DatasetError(
            f"{dataset.path / 'dataset.json'}: has version 1, whose hashes do not "
            f"cover sample.json: it can be read, but not checked; generate it again to get version {VERSION}"
        )
    recorded = {sample["name"]: sample["sha256"] for sample in dataset.index["samples"]}
    check = partial(_check_sample, dataset.path, recorded)
    return zip(dataset.names, in_threads(check, dataset.names, threads))


def check_index(dataset: StereoDataset) -> list[Finding]:
    """Check the index itself: its settings, the split of each sample, and the calibration of raw pairs."""
    findings = list(_check_calibration(dataset))
    if (dataset.path / SETTINGS).is_file():
        findings += _check_settings(dataset)
    for sample in dataset.index["samples"]:
        name, split = sample["name"], sample["split"]
        due = split_of(int(name.split("/")[0]))
        if split != due:
            findings.append(Finding("dataset.json", f"{name} is in {split}, its scene belongs to {due}"))
    return findings


def _check_settings(dataset: StereoDataset) -> list[Finding]:
    try:
        settings = read_json(dataset.path / SETTINGS)
    except DatasetError as error:
        return [Finding(SETTINGS, str(error).removeprefix(f"{dataset.path / SETTINGS}: "))]
    config = _settings_of(dataset)
    apart = {*MARK_NOTES, "pairs"}  # the former are in the settings alone, the latter in the index alone
    first, second = ({k: v for k, v in part.items() if k not in apart} for part in (settings, config))
    return [] if first == second else [Finding(SETTINGS, "its settings are not those that dataset.json records")]


def _settings_of(dataset: StereoDataset) -> dict[str, Any]:
    """Return the settings that the index records."""
    config = dataset.index.get("config")
    return config if isinstance(config, dict) else {}


def _calibration(dataset: StereoDataset) -> dict[str, str]:
    """Return the SHA-256 of each calibration file that the index records, by name; none without raw pairs."""
    raw = _settings_of(dataset).get("raw")
    files = raw.get("calibration") if isinstance(raw, dict) else None
    return files if isinstance(files, dict) else {}


def _check_calibration(dataset: StereoDataset) -> Iterator[Finding]:
    for name, digest in _calibration(dataset).items():
        file = dataset.path / CALIBRATION / Path(name).name
        if not file.is_file():
            yield Finding(f"{CALIBRATION}/{name}", "missing")
        elif hashlib.sha256(file.read_bytes()).hexdigest() != digest:
            yield Finding(f"{CALIBRATION}/{name}", "its content is not what dataset.json records")


def check_trajectories(dataset: StereoDataset) -> list[Finding]:
    """Check that the files of poses in a dataset of drives (generate --trajectory) have the poses of the views."""
    if not _settings_of(dataset).get("trajectory"):
        return []
    views: dict[str, list[str]] = {}
    for name in dataset.names:
        views.setdefault(name.split("/")[0], []).append(name)
    findings = []
    for scene, names in views.items():
        path = f"scenes/{scene}/{TRAJECTORY}"
        try:
            text = (dataset.path / path).read_text(encoding="utf-8")
        except (OSError, ValueError):
            findings.append(Finding(path, "missing, or cannot be read"))
            continue
        try:
            metas = [read_json(dataset.path / "scenes" / name / "sample.json") for name in names]
            due = tum_lines([meta["timestamp"] for meta in metas], np.array([meta["pose"] for meta in metas]))
        except (KeyError, ValueError, TypeError, IndexError):
            continue  # check_samples names the sample
        if text != due:
            findings.append(Finding(path, "its poses or times are not those of the views"))
    return findings


def check_extra(dataset: StereoDataset, results: Path | None = None) -> list[Finding]:
    """Find files that do not belong to the dataset.

    Args:
        dataset: The dataset.
        results: A folder that may lie in the dataset, with all that it holds.

    Returns:
        The files; a folder of them counts as one.
    """
    expected = set(TOP) | {f"scenes/{n}/{file}" for n in dataset.names for file in (*IMAGES, "sample.json")}
    expected |= {f"scenes/{n.split('/')[0]}/{TRAJECTORY}" for n in dataset.names}
    if calibration := _calibration(dataset):
        expected |= {f"scenes/{n}/{file}" for n in dataset.names for file in RAW}
        expected |= {f"{CALIBRATION}/{file}" for file in calibration}
    folders = {str(parent) for path in expected for parent in Path(path).parents}
    if results is not None and results.resolve().is_relative_to(dataset.path.resolve()):
        inside = results.resolve().relative_to(dataset.path.resolve())
        folders |= {parent.as_posix() for parent in inside.parents}
    findings = []
    unvisited = [dataset.path]
    while unvisited:
        for entry in sorted(unvisited.pop().iterdir()):
            path = entry.relative_to(dataset.path).as_posix()
            if results is not None and entry.resolve() == results.resolve():
                continue
            if entry.is_dir() and not entry.is_symlink():
                if path in folders:
                    unvisited.append(entry)
                elif entry.name.endswith(".partial"):
                    findings.append(Finding(path, UNFINISHED))
                else:
                    findings.append(Finding(path, "a folder that the index does not list"))
            elif path not in expected and path != LOCK:  # a lock's file stays when its command has ended
                unfinished = entry.name.startswith(".") and entry.name.endswith(".part")
                findings.append(Finding(path, UNFINISHED if unfinished else "a file that the index does not list"))
    return findings


def check_written(root: Path, names: Sequence[str], recorded: dict[str, str]) -> list[Finding]:
    """Check samples that earlier runs have written to a folder.

    Args:
        root: Folder of the dataset.
        names: "scene/view" of the samples.
        recorded: SHA-256 of sample.json by the name of the sample. A sample.json without one is not hashed.
    """
    check = partial(_check_sample, root, recorded)
    return [finding for each in in_threads(check, names, 2) for finding in each]


def _check_sample(root: Path, recorded: dict[str, str], name: str) -> list[Finding]:
    """Return the findings on the files of a sample; recorded: the SHA-256 of each sample.json by name, if known."""
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
        findings = [finding("sample.json", str(error).removeprefix(f"{file}: "))]
        return findings + [finding(image, "missing") for image in IMAGES if not (folder / image).is_file()]
    findings = []
    if digest != recorded.get(name, digest):
        findings.append(finding("sample.json", "its content is not what dataset.json records"))
    raw = meta["raw_sha256"] if isinstance(meta.get("raw_sha256"), dict) else {}
    for image in (*IMAGES, *(image for image in RAW if image in raw)):
        problem = _check_image(folder / image, {**raw, **meta["sha256"]}[image], rig)
        if problem:
            findings.append(finding(image, problem))
    return findings


def _check_meta(meta: dict[str, Any]) -> StereoRig:
    """Return the rig of a sample. Raises ValueError that names a field which is missing or impossible."""
    for field in ("rig", "pose"):
        if field not in meta:
            raise ValueError(f"field '{field}' is missing")
    recorded_pose(meta["pose"])
    recorded_rotation(meta.get("right_rotation"))
    recorded_time(meta, 0.0)
    recorded_mount(meta)
    _check_surface_ids(meta.get("surface_ids"))
    if "sun" in meta:
        sun = _numbers(meta["sun"], (3,))
        if not abs(float(np.linalg.norm(sun)) - 1) < UNIT_TOLERANCE:
            raise ValueError("sun is not a unit vector")
        elevation = float(_numbers(meta.get("sun_elevation_deg"), ()))
        if not abs(np.rad2deg(np.arcsin(np.clip(sun[2], -1, 1))) - elevation) < ELEVATION_TOLERANCE:
            raise ValueError("sun_elevation_deg is not the elevation of sun")
    return StereoRig.from_dict(meta["rig"])


def _check_surface_ids(ids: Any) -> None:
    """Raise ValueError if the numbers of a sample's surfaces are malformed. Older datasets have none."""
    if ids is None:
        return
    if not isinstance(ids, dict) or "rocks" not in ids:
        raise ValueError("surface_ids must name the surfaces of rocks")
    for kind, span in ids.items():
        if not isinstance(span, list) or len(span) not in (0, 2) or not all(type(n) is int for n in span):
            raise ValueError(f"surface_ids must hold [first, last] or [] for {kind}")


def _numbers(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return a value as an array of that shape, full of NaN if it is none."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    return array if array.shape == shape else np.full(shape, np.nan)


def _check_image(path: Path, recorded: str, rig: StereoRig) -> str | None:
    """Return what is wrong with an image file; None if nothing is."""
    try:
        data = read_file(path)
    except FileNotFoundError:
        return "missing"
    except OSError as error:
        return f"cannot be read: {error.strerror}" if error.strerror else str(error)
    if hashlib.sha256(data).hexdigest() != recorded:
        if not data:
            return "empty"
        return "its content is not what sample.json records" if PNG_END in data else "truncated"
    if not (len(data) > 26 and data.startswith(PNG_START) and data.endswith(PNG_END)):
        return "not a complete PNG image" if data else "empty"
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    if (width, height) != (rig.camera.width, rig.camera.height) or (bits, colour) != PNG_KIND[path.name]:
        return f"{width} x {height} px with {bits} bits, which is not what the rig and the format ask for"
    return None
