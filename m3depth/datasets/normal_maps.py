"""Maps of true normals in the file types of datasets."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from m3depth.datasets.config import NormalFrame
from m3depth.datasets.exr import Layer, exr_layers, only_layer
from m3depth.datasets.image_files import decode_image
from marssim.base.camera import PinholeCamera
from marssim.base.files.json_file import DatasetError
from marssim.base.files.npy import read_npy

AXES = ("XYZ", "RGB")  # names of the three channels of an EXR file's layer
FROM_OPENGL = np.array([1, -1, -1], np.float32)  # from x right, y up, z towards the camera
FEWEST_FITTED = 0.05  # share of the pixels that need a fitted plane for the check against them
MOST_ANGLE = 30.0  # [deg] median between true normals and planes fitted to the true depth; marssim has 3 to 10
NOT_UNIT = 0.05  # difference of a length from 1 that shows numbers which are not the components of unit vectors
CODED_LENGTH = 0.5  # least length of a vector that pixels code; unknown ones are grey, (0, 0, 0), or black


def read_normals(path: Path, frame: NormalFrame) -> np.ndarray:
    """Read a map of normals.

    An image of 8 or 16 bits holds (n + 1) / 2 of its largest value, x in red, y in green and z in blue; black and grey
    pixels are unknown. Files of floats hold the components themselves, of any length; 0 and NaN are unknown.

    Args:
        path: The file: npy, exr (channels X, Y, Z or R, G, B), or an image that OpenCV reads.
        frame: Axes of the stored normals.

    Returns:
        (H, W, 3) float32 of unit length in the camera's frame (x right, y down, z forward), 0 where unknown.

    Raises:
        DatasetError: The file is missing or unreadable, has no three channels, or holds floats coded as (n + 1) / 2;
            the message names it.
        ImportError: An EXR file without OpenEXR; the message names the extra.
    """
    stored = _vectors(path)
    if stored.dtype.kind == "u":
        vectors = stored.astype(np.float32) * np.float32(2 / np.iinfo(stored.dtype).max) - 1
        valid = stored.any(-1) & (np.linalg.norm(vectors, axis=-1) > CODED_LENGTH)
    else:
        _check_range(path, stored)
        vectors = stored.astype(np.float32)
        valid = np.isfinite(vectors).all(-1) & vectors.any(-1)
    if frame == "opengl":
        vectors = vectors * FROM_OPENGL
    length = np.linalg.norm(np.where(valid[..., None], vectors, 1), axis=-1, keepdims=True)
    return np.where(valid[..., None], vectors / length, np.float32(0)).astype(np.float32)


def check_frame(path: Path, normal: np.ndarray, frame: NormalFrame, camera: PinholeCamera, fitted: np.ndarray) -> None:
    """Raise DatasetError if normals differ from planes fitted to the true depth, or mostly turn away from the camera.

    Then their axes are other ones.

    Args:
        path: File of the normals, for the message.
        normal: (H, W, 3) in the camera's frame, 0 where unknown.
        frame: The axes by which the file was read, for the message.
        camera: The camera of the map.
        fitted: (H, W, 3) normals of planes that are fitted to the true depth, 0 where there are none.
    """
    other: NormalFrame = "opencv" if frame == "opengl" else "opengl"
    both = normal.any(-1) & fitted.any(-1)
    if np.count_nonzero(both) >= FEWEST_FITTED * both.size:
        angle, other_angle = (
            float(np.rad2deg(np.arccos(np.clip(np.median((n * fitted)[both].sum(-1)), -1, 1))))
            for n in (normal, normal * FROM_OPENGL)
        )
        if angle > MOST_ANGLE:
            advice = (
                f"try --normal-frame {other}, which fits"
                if other_angle <= MOST_ANGLE
                else f"those of {other} do not fit either, so they may be axes of the world, or another coding"
            )
            raise DatasetError(
                f"{path}: in the axes of {frame}, its normals are {angle:.0f} deg (median) off planes that are fitted "
                f"to the true depth; {advice}"
            )
    towards = (normal * camera.rays()).sum(-1)
    away, count = np.count_nonzero(towards > 0), np.count_nonzero(normal.any(-1))
    if 2 * away > count:
        raise DatasetError(
            f"{path}: {100 * away / count:.0f} % of its normals turn away from the camera in the axes of {frame}; try "
            f"--normal-frame {other}"
        )


def _check_range(path: Path, stored: np.ndarray) -> None:
    """Raise DatasetError for floats in [0, 1] that are no unit vectors: (n + 1) / 2, which only images hold."""
    valid = np.isfinite(stored).all(-1) & stored.any(-1)
    vectors = stored[valid].astype(np.float64)
    if not len(vectors) or vectors.min() < 0 or vectors.max() > 1:
        return
    if abs(np.median(np.linalg.norm(vectors, axis=-1)) - 1) > NOT_UNIT:
        raise DatasetError(
            f"{path}: holds numbers of 0 to 1 that are no unit vectors: files of floats hold the components of "
            "normals, of -1 to 1, and only images (n + 1) / 2"
        )


def _vectors(path: Path) -> np.ndarray:
    """Read the stored numbers, (H, W, 3)."""
    if not path.is_file():
        raise DatasetError(f"{path}: no such file")
    values: np.ndarray | None
    try:
        if path.suffix.lower() == ".npy":
            values = read_npy(path)
        elif path.suffix.lower() == ".exr":
            values = _exr(path)
        else:
            values = decode_image(path.read_bytes())
            values = values[..., 2::-1] if values is not None and values.ndim == 3 else None  # BGR becomes RGB
    except ValueError as error:
        if isinstance(error, DatasetError):
            raise
        values = None
    if values is None or values.dtype.kind not in "fu" or values.ndim != 3 or values.shape[2] != 3:
        raise DatasetError(f"{path}: holds no normals, three numbers a pixel")
    return values


def _exr(path: Path) -> np.ndarray | None:
    """Return the normals of an EXR file, (H, W, 3); None if it has no three channels of AXES."""
    layers = exr_layers(path)
    vectors = {
        name: channels for name, channels in layers.items() if "normal" in name.lower() or _axes(channels) == "XYZ"
    }
    channels = only_layer(path, vectors or layers, "normal", lambda channels: bool(_axes(channels)))
    return None if channels is None else np.dstack([channels[name] for name in _axes(channels)])


def _axes(channels: Layer) -> str:
    return next((names for names in AXES if set(names) <= channels.keys()), "")
