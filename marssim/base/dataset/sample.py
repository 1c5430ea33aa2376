"""Read and write one sample of a dataset: its folder appears in one step, and its files are hashed."""

from __future__ import annotations

import hashlib
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import cv2
import numpy as np

from marssim.base.camera import MAX_DEPTH, MIN_DEPTH, StereoRig
from marssim.base.dataset.encoding import decode_depth, decode_normal, encode_depth, encode_normal
from marssim.base.dataset.frame import ROVER, SKY, StereoFrame
from marssim.base.files.atomic import naming, rename
from marssim.base.files.json_file import DatasetError, json_text, read_json
from marssim.base.files.png import MAGIC, decode_png, encode_png, png_size
from marssim.base.files.whole_file import read_file
from marssim.base.pose import ROVER_KEY, recorded_pose
from marssim.base.right_image import image_disparity, recorded_rotation

IMAGES = ("left.png", "right.png", "depth.png", "normal.png", "surface.png", "occluded.png")
RAW = ("raw_left.png", "raw_right.png")  # images before rectification, which few datasets have
LATEST = 2e9  # [s] latest time of a sample, which ROS's stamps still hold
ROVER_CODE = 65_535  # value of surface.png on the rover that carries the cameras
# The fastest compression of each image at about the smallest size. Noisy images have no repeats to search for, nor have
# normals, whose neighbours share some high bytes; depth and masks have repeats.
_NOISY = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
_RUNS = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
PNG = {
    name: [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB, *strategy]
    for name, strategy in zip(IMAGES, (_NOISY, _NOISY, [], _RUNS, _RUNS, _RUNS))
}
PNG |= dict.fromkeys(RAW, PNG["left.png"])


@dataclass(frozen=True)
class StereoSample:
    """A stereo pair of a dataset with its ground truth. Maps are of the left eye.

    Vectors are in the frame of the left camera: x right, y down, z forward.

    Attributes:
        left: (H, W, 3) uint8 RGB image of the left eye.
        right: (H, W, 3) uint8 RGB image of the right eye.
        depth: (H, W) float32 [m] along the optical axis; inf in the sky, and NaN where it is unknown, as in other
            datasets.
        disparity: (H, W) float32 [px], x_left - x_right as the images show it (marssim.base.right_image); 0 in the sky
            and where the depth is unknown.
        normal: (H, W, 3) float32 unit normals that face the camera; 0 in the sky and where they are unknown.
        valid: (H, W) bool, true where the depth is 0.5 m to 15 m.
        occluded: (H, W) bool, true where the right eye does not see the point.
        rock: (H, W) int32, the number from 1 of the rock, slab, block of a ledge or fragment; 0 elsewhere, and -1
            where the rover that carries the cameras is in view. Where the numbers of each kind begin and end is in
            meta["surface_ids"].
        rig: The cameras.
        meta: The content of sample.json.
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


def write_sample(
    folder: str | os.PathLike[str],
    frame: StereoFrame,
    meta: dict[str, Any],
    raw: tuple[np.ndarray, np.ndarray] | None = None,
    replace: bool = True,
) -> None:
    """Write a sample so that its folder appears complete or not at all.

    Only a killed process leaves files behind, in a folder ".*.partial". Two processes may write the same sample at the
    same time, as a lost worker of a cluster and its successor may: each writes to a folder of its own first.

    Args:
        folder: Folder of the sample.
        frame: The rendered pair.
        meta: Content of sample.json; rig, pose, right_rotation and the hashes of the images are added.
        raw: Both images before rectification, (H, W, 3) uint8 RGB, to write beside the others; their hashes are added
            as "raw_sha256", so that programs that know no raw images read the sample as any other.
        replace: Replace a sample that the folder holds; otherwise it stays if all of its files are there.

    Raises:
        OSError: A file cannot be written. The error names it.
    """
    folder = Path(folder)
    images = {
        "left.png": frame.left[..., ::-1],
        "right.png": frame.right[..., ::-1],
        "depth.png": encode_depth(frame.depth),
        "normal.png": encode_normal(frame.normal)[..., ::-1],
        "surface.png": np.where(frame.surface == ROVER, ROVER_CODE, frame.surface + 1).astype(np.uint16),
        "occluded.png": frame.occluded.astype(np.uint8) * 255,
    }
    partial = folder.with_name(f".{folder.name}.{uuid4().hex}.partial")
    try:
        with naming(folder):
            partial.mkdir(parents=True)
            digest = _write_images(partial, images)
            meta = {**meta, "rig": frame.rig.to_dict(), "pose": frame.pose.tolist(), "sha256": digest}
            meta["right_rotation"] = frame.right_rotation.tolist()
            if raw is not None:
                meta["raw_sha256"] = _write_images(partial, {n: image[..., ::-1] for n, image in zip(RAW, raw)})
            (partial / "sample.json").write_bytes(json_text(meta, indent=1, sort_keys=True).encode())
        if replace or not is_complete(folder):
            shutil.rmtree(folder, ignore_errors=True)
        try:
            rename(partial, folder)
        except OSError:
            if not is_complete(folder):
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _write_images(folder: Path, images: dict[str, np.ndarray]) -> dict[str, str]:
    """Write images as PNG, and return the SHA-256 of each file."""
    digest = {}
    for name, image in images.items():
        encoded = encode_png(image, PNG[name])
        digest[name] = hashlib.sha256(encoded).hexdigest()
        (folder / name).write_bytes(encoded)
    return digest


def is_complete(folder: Path) -> bool:
    """Return whether all files of a sample exist and none is empty. Their content is not checked."""
    files = (folder / name for name in ("sample.json", *IMAGES))
    return all(file.is_file() and file.stat().st_size > 0 for file in files)


def read_sample(folder: str | os.PathLike[str]) -> StereoSample:
    """Read a sample.

    Args:
        folder: Folder of the sample, DIR/scenes/SCENE/VIEW.

    Raises:
        DatasetError: A file is missing or broken. One line that names it.
    """
    folder = Path(folder)
    meta = read_json(folder / "sample.json")
    try:
        rig = StereoRig.from_dict(meta["rig"])
        rotation = recorded_rotation(meta.get("right_rotation"))
        if "pose" in meta:
            recorded_pose(meta["pose"])
    except KeyError:
        raise DatasetError(f"{folder / 'sample.json'}: field 'rig' is missing") from None
    except ValueError as error:
        raise DatasetError(f"{folder / 'sample.json'}: {error}") from None
    size = (rig.camera.height, rig.camera.width)
    surface = _read_image(folder / "surface.png", size, np.uint16).astype(np.int32) - 1
    surface[surface == ROVER_CODE - 1] = ROVER
    depth = decode_depth(_read_image(folder / "depth.png", size, np.uint16))
    depth[surface == SKY] = np.inf
    return StereoSample(
        left=_read_image(folder / "left.png", (*size, 3), np.uint8)[..., ::-1].copy(),
        right=_read_image(folder / "right.png", (*size, 3), np.uint8)[..., ::-1].copy(),
        depth=depth,
        disparity=image_disparity(rig, depth, rotation),
        normal=decode_normal(_read_image(folder / "normal.png", (*size, 3), np.uint16)[..., ::-1]),
        valid=(depth >= MIN_DEPTH) & (depth <= MAX_DEPTH),
        occluded=_read_image(folder / "occluded.png", size, np.uint8) > 0,
        rock=np.where(surface == ROVER, -1, np.maximum(surface, 0)),
        rig=rig,
        meta=meta,
    )


def recorded_time(meta: dict[str, Any], otherwise: float) -> float:
    """Return the time at which a sample was taken [s].

    Args:
        meta: Content of sample.json.
        otherwise: The time of a sample without one.

    Raises:
        ValueError: The time is no number from 0 to LATEST.
    """
    time = meta.get("timestamp", otherwise)
    if isinstance(time, bool) or not isinstance(time, int | float) or not 0 <= time <= LATEST:
        raise ValueError(f"timestamp must be a number from 0 to {LATEST:g} s")
    return float(time)


def recorded_mount(meta: dict[str, Any]) -> np.ndarray | None:
    """Return the pose of the left camera on the rover, (4, 4) camera to rover; None if the sample does not tell.

    Args:
        meta: Content of sample.json. A drive has it as camera_to_rover; that of a rover in view follows from its pose.

    Raises:
        ValueError: What is recorded is no rigid pose.
    """
    if meta.get(ROVER_KEY) is not None:
        try:
            return recorded_pose(meta[ROVER_KEY])
        except ValueError as error:
            raise ValueError(f"{ROVER_KEY}: {error}") from None
    rover = recorded_rover(meta)
    return None if rover is None else np.asarray(np.linalg.inv(rover) @ recorded_pose(meta.get("pose")))


def recorded_rover(meta: dict[str, Any]) -> np.ndarray | None:
    """Return the pose of the rover that carries the cameras, (4, 4) body to world; None if the sample records none.

    Args:
        meta: Content of sample.json.

    Raises:
        ValueError: It is no pose.
    """
    rover = meta.get("rover")
    if rover is None:
        return None
    try:
        return recorded_pose(rover.get("pose") if isinstance(rover, dict) else None)
    except ValueError as error:
        raise ValueError(f"rover.{error}") from None


def sample_digest(folder: Path) -> str:
    """Return the SHA-256 of a sample's sample.json, which holds the hashes of its images.

    Raises:
        DatasetError: sample.json cannot be read, or lacks the hash of an image.
    """
    file = folder / "sample.json"
    digest = read_json(file).get("sha256")
    if not isinstance(digest, dict) or set(digest) != set(IMAGES):
        raise DatasetError(f"{file}: sha256 must hold the hash of each image")
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _read_image(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    try:
        data = read_file(path)
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except OSError as error:
        raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    sizes = " x ".join(str(n) for n in (shape[1], shape[0], *shape[2:]))
    if data.startswith(MAGIC) and len(data) > 24 and (size := png_size(data)) != shape[:2]:
        raise DatasetError(f"{path}: must be {shape[1]} x {shape[0]} px as the rig says, is {size[1]} x {size[0]} px")
    image = decode_png(data)
    if image is None:
        raise DatasetError(f"{path}: not a readable image")
    if image.shape != shape or image.dtype != dtype:
        raise DatasetError(f"{path}: must be {sizes} {np.dtype(dtype)} as the rig says, is {image.shape} {image.dtype}")
    return image
