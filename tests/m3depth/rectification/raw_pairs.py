"""Raw pairs of a scene that is known in closed form, drawn through any lens, and products that hold them."""

from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np

from marssim.base.calibration.cameras import PosedCamera, PosedPair, first_camera, from_vectors, second_camera
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.orientation import RectifiedView, directions
from marssim.base.calibration.pds3_label import camera_group

SIZE = (480, 360)
# planes n . P = -d [m] in the left camera's frame: n and d
GROUND = np.array([0.05, -0.9, -0.43]), 1.3
WALL = np.array([0.1, -0.2, -0.97]), 1.4
CELL = 0.012  # [m] of the texture on the ground
_texture = cv2.GaussianBlur(np.random.default_rng(4).normal(size=(2048, 2048)).astype(np.float32), (0, 0), 1.6)
_drawn: dict[bytes, np.ndarray] = {}  # images by camera and plane
TEXTURE = 128 + 55 * _texture / _texture.std()


def turned(vergence_deg: float = 0.0) -> np.ndarray:
    """A small rotation of the right camera, and a turn towards the left one."""
    return cv2.Rodrigues(np.array([0.012, np.deg2rad(vergence_deg), -0.015]))[0]


def opencv_pair(
    lens: type = RadialTangential, terms=(-0.22, 0.06, 1e-3, -8e-4), vergence_deg: float = 0.5
) -> PosedPair:
    """Two lenses that differ, 0.2 m apart."""
    lenses = lens(300.0, 301.0, 243.0, 176.0, terms), lens(296.0, 295.5, 236.0, 183.5, terms)
    rotation = turned(vergence_deg)
    return PosedPair(
        first_camera(lenses[0], SIZE), second_camera(lenses[1], rotation, -rotation @ [0.2, 2e-3, -3e-3], SIZE)
    )


def cahvore_pair() -> PosedPair:
    """Two cameras of a rover, whose frame is that of the left camera here."""
    cameras = []
    for x, roll in ((0.0, 0.0), (0.2, 0.02)):
        right = np.array([np.cos(roll), np.sin(roll), 0.0])
        axis = np.array([0.0, 0.0, 1.0])
        h, v = 300 * right + 240 * axis, 301 * np.cross(axis, right) + 178 * axis
        optical = np.array([0.002, -0.001, 1.0]) / np.linalg.norm([0.002, -0.001, 1.0])
        r, e = (1e-5, 0.05, -0.02), (1e-5, -2e-5, 1e-5)
        cameras.append(from_vectors(np.array([x, 0, 0]), axis, h, v, optical, r, e, 0.0, SIZE, "ROVER"))
    return PosedPair(*cameras)


def depth_of(plane: tuple[np.ndarray, float], view: RectifiedView, pixels: np.ndarray) -> np.ndarray:
    """Depth (N,) [m] of a plane at pixels (N, 2) of the left rectified image."""
    ahead = directions(view.left, view.rotation, pixels)
    return -plane[1] / (ahead @ plane[0])


def drawn(camera: PosedCamera, plane: tuple[np.ndarray, float] = GROUND) -> np.ndarray:
    """(H, W) float image of a textured plane, four rays a pixel; 30 where there is sky or nothing."""
    key = pickle.dumps((camera, plane))
    if key not in _drawn:
        _drawn[key] = _draw(camera, plane)
    return _drawn[key].copy()


def _draw(camera: PosedCamera, plane: tuple[np.ndarray, float]) -> np.ndarray:
    normal, distance = plane
    width, height = SIZE
    total = np.zeros((height, width))
    for du, dv in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
        u, v = np.meshgrid(np.arange(width) + du, np.arange(height) + dv)
        rays = camera.rays(np.stack([u, v], axis=-1))
        with np.errstate(all="ignore"):
            along = -(distance + rays.origin @ normal) / (rays.direction @ normal)
            points = rays.at(np.where((along > 0) & (along < 9), along, np.nan))
        across = points[..., [0, 2 if abs(normal[1]) > 0.5 else 1]] / CELL
        inside = np.isfinite(across).all(axis=-1)
        places = np.where(inside[..., None], np.mod(across + 1024, 2000) + 20, 0).astype(np.float32)
        shown = cv2.remap(TEXTURE, places[..., 0], places[..., 1], cv2.INTER_CUBIC)
        total += np.where(inside, shown, 30)
    return np.clip(total / 4, 0, 255)


def write_images(folder: Path, pair: PosedPair, plane: tuple[np.ndarray, float] = GROUND) -> tuple[Path, Path]:
    """Write the pair as PNG, with a little noise."""
    files = folder / "left.png", folder / "right.png"
    rng = np.random.default_rng(0)
    for file, camera in zip(files, (pair.left, pair.right)):
        noisy = drawn(camera, plane) + rng.normal(0, 1, SIZE[::-1])
        cv2.imwrite(str(file), np.clip(np.round(noisy), 0, 255).astype(np.uint8))
    return files


def img_bytes(camera: PosedCamera, values: np.ndarray, **keys: str) -> bytes:
    """A PDS3 product with its label attached: 16 bits, most significant byte first, of which 12 are used."""
    lines, samples = values.shape[:2]
    data = values.astype(">i2") if values.dtype != np.uint8 else values
    bits = 8 * data.dtype.itemsize
    record = samples * data.dtype.itemsize
    keys = {
        "FRAME_ID": '"LEFT"', "START_TIME": "2023-02-17T05:22:09.508", "ROVER_MOTION_COUNTER": "(33,2841,1,0)", **keys,
    }  # fmt: skip
    label = "\r\n".join(
        ["ODL_VERSION_ID = ODL3", "RECORD_TYPE = FIXED_LENGTH", f"RECORD_BYTES = {record}"]
        + [f"FILE_RECORDS = {lines + 20}", "LABEL_RECORDS = 20", "^IMAGE = 21"]
        + [f"{key} = {value}" for key, value in keys.items()]
        + camera_group(camera).splitlines()
        + ["OBJECT = IMAGE", f"  LINES = {lines}", f"  LINE_SAMPLES = {samples}", "  BANDS = 1"]
        + [f"  SAMPLE_TYPE = {'UNSIGNED_INTEGER' if bits == 8 else 'MSB_INTEGER'}", f"  SAMPLE_BITS = {bits}"]
        + ["  MISSING_CONSTANT = 0.0", "END_OBJECT = IMAGE", "END", ""]
    ).encode()
    assert len(label) <= 20 * record
    return label.ljust(20 * record, b" ") + data.tobytes()


def write_products(folder: Path, pair: PosedPair, bits: int = 16, **right: str) -> tuple[Path, Path]:
    """Write the pair as products of Mars 2020, with a square of missing data in the left one."""
    names = [f"N{eye}M_0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01.IMG" for eye in "LR"]
    files = folder / names[0], folder / names[1]
    for file, camera, keys in zip(files, (pair.left, pair.right), ({}, {"FRAME_ID": '"RIGHT"', **right})):
        values = np.maximum(drawn(camera) * (16 if bits == 16 else 1), 1)
        if keys == {}:
            values[200:220, 300:330] = 0
        file.write_bytes(img_bytes(camera, values.astype(np.int16 if bits == 16 else np.uint8), **keys))
    return files
