"""The output of OAISYS, the simulator that made SimMars6K, and its config file as a calibration."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.pair_files import CalibrationFinder, PairFiles
from marssim.base.calibration.rectified import ROUNDING, Calibration
from marssim.base.files.json_file import DatasetError

RENDERING = "00"  # number of the rendering that is read; OAISYS can render a pass several times


def oaisys(root: Path, config: DataConfig, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield the pairs of OAISYS: batch_0001/<sensor>/0003<sensor>_rgb_00.png and ..._pinhole_depth_00.exr [m].

    The sensors are those whose names end in left and right, or those that --left and --right name.

    Args:
        root: Root folder of the dataset.
        config: Names of the sensors, if they are given.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.

    Raises:
        DatasetError: The sensors cannot be identified.
    """
    batches = sorted(root.glob("batch_*")) or sorted(root.glob("*/batch_*"))
    for batch in batches:
        left, right = (_sensor(batch, end, name) for end, name in (("left", config.left), ("right", config.right)))
        for path in sorted((batch / left).glob(f"*{left}_rgb_{RENDERING}.png")):
            step = path.name.removesuffix(f"{left}_rgb_{RENDERING}.png")
            yield PairFiles(
                f"{batch.relative_to(root).as_posix()}/{step}", batch.relative_to(root).as_posix(), path,
                batch / right / f"{step}{right}_rgb_{RENDERING}.png",
                batch / left / f"{step}{left}_pinhole_depth_{RENDERING}.exr", "depth", rigs(root / "calib.txt", path),
            )  # fmt: skip


def is_sensor_name(text: str) -> bool:
    """Return whether a text can be the name of a sensor, and not a pattern of images."""
    return not set(text) & set("*?[/.")


def _sensor(batch: Path, end: str, name: str | None) -> str:
    """Return the name of a batch's left or right sensor."""
    sensors = sorted(path.name for path in batch.iterdir() if path.is_dir() and path.name != "blender_file")
    if name is not None:
        if name not in sensors:
            raise DatasetError(f"{batch}: has no sensor {name}; its sensors: {', '.join(sensors) or 'none'}")
        return name
    fitting = [sensor for sensor in sensors if sensor.lower().endswith(end)]
    if len(fitting) != 1:
        names = ", ".join(sensors) or "none"
        raise DatasetError(f"{batch}: cannot tell the {end} sensor; name it by --{end}; its sensors: {names}")
    return fitting[0]


def oaisys_rig(path: Path, config: DataConfig) -> Calibration | None:
    """Read the calibration from the config file of OAISYS: KMatrix of the left sensor, and the distance to the right
    one.

    Args:
        path: The config file.
        config: Names of the sensors, if they are given; patterns of images are none.

    Returns:
        The calibration; None if the file is not a config of OAISYS.

    Raises:
        DatasetError: The sensors are not a rectified pair, or lack something; the message names the file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
        params = [sensor["sensorParams"] for sensor in data["SENSOR_SETUP"]["SENSORS"]]
        sensors = {str(sensor["outputBaseName"]): sensor for sensor in params}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    eyes = []
    for end, given in (("left", config.left), ("right", config.right)):
        name = given if given is not None and is_sensor_name(given) else None
        fitting = [s for n, s in sensors.items() if (n == name if name else n.lower().endswith(end))]
        if len(fitting) != 1:
            raise DatasetError(
                f"{path}: cannot tell the {end} sensor; name it by --{end}; its sensors: {', '.join(sensors)}; or give "
                "--focal and --baseline"
            )
        eyes.append(fitting[0])
    try:
        (k, right_k), (place, right_place) = (
            [np.array(eye[field], float) for eye in eyes] for field in ("KMatrix", "transformation")
        )
        width, height = map(int, eyes[0]["imageResolution"])
        k, right_k = k.reshape(3, 3), right_k.reshape(3, 3)
        across = _camera_axes(place[3:7]).T @ (right_place[:3] - place[:3])
        turned = np.abs(place[3:7] - right_place[3:7]).max() > 1e-6
    except (KeyError, ValueError, TypeError, IndexError, OverflowError):
        raise DatasetError(f"{path}: the sensors lack KMatrix, transformation or imageResolution") from None
    if not all(np.isfinite(values).all() for values in (k, right_k, place, right_place)):
        raise DatasetError(f"{path}: KMatrix and transformation of the sensors must be finite")
    unlike = abs(right_k - k)[:2, :2].max() > 0 or abs(right_k - k)[1, 2] > ROUNDING
    if turned or unlike or not across[0] > 0 or np.abs(across[1:]).max() > 1e-3 * across[0]:
        raise DatasetError(
            f"{path}: the sensors are not a rectified pair with the right one to the right of the left one"
        )
    shift = float(right_k[0, 2] - k[0, 2])
    fx, fy, cx, cy = (float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    calibration = Calibration(fx, fy, cx, cy, float(across[0]), shift, (width, height))
    try:
        calibration.rig(width, height)
    except ValueError as error:
        raise DatasetError(f"{path}: {error}") from None
    return calibration


def _camera_axes(quaternion: np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation of a quaternion w, x, y, z; columns: the camera's right, up and backward (Blender)."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
