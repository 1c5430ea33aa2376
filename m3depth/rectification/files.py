"""The files of a rectified pair: images, masks, the rig, and the report."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.rectification.pair import RectifiedPair
from m3depth.rectification.placing import rectified_to_rover
from m3depth.rectification.raw_image import RawImage
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.files.png import encode_png
from marssim.base.pose import ROVER_KEY
from marssim.base.results.claim import ResultFolder

RIG_FILE, REPORT, ROWS = "rig.json", "report.json", "rows.png"
FILES = (*(f"{eye}{end}.png" for eye in ("left", "right") for end in ("", "_valid")), ROWS, RIG_FILE)
UNFINISHED = '{"unfinished": "rectify this pair again"}\n'  # REPORT while the other files are written
NO_SCALE = "none: nothing gives the distance of the cameras, so depth has no unit"


def write_pair(
    out: Path, left: RawImage, right: RawImage, pair: RectifiedPair, report: dict[str, Any], with_picture: bool = True
) -> None:
    """Write every file that m3depth.rectify lists, each in one step, the report last.

    Args:
        out: The folder; it is made.
        left, right: The raw images.
        pair: The rectified pair.
        report: Its make_report.
        with_picture: Whether to draw rows.png too, which takes some seconds.

    Raises:
        OSError: A file cannot be written; the message names it.
    """
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / REPORT, UNFINISHED.encode())
    for name in ("left", "right"):
        pixels = getattr(pair, name)
        write_atomically(out / f"{name}.png", encode_png(pixels[..., ::-1] if pixels.ndim == 3 else pixels))
        write_atomically(out / f"{name}_valid.png", encode_png(getattr(pair, f"{name}_valid").astype(np.uint8) * 255))
    rig = rig_dict(pair)
    if rig is None:
        (out / RIG_FILE).unlink(missing_ok=True)  # of an earlier run
    else:
        write_json(out / RIG_FILE, rig, sort_keys=False)
    if with_picture:
        from m3depth.rectification.figure import rows_figure  # loads matplotlib

        rows_figure(left, right, pair, out / ROWS)
    else:
        (out / ROWS).unlink(missing_ok=True)
    write_json(out / REPORT, report, sort_keys=False)


def pair_folder(out: Path) -> ResultFolder:
    """Return the folder for a rectified pair, which replaces an earlier one and leaves other files.

    Raises:
        DatasetError: A file in it would be replaced that is of no rectified pair; the message names it.
    """
    present = next((name for name in FILES if (out / name).exists()), None)
    if present is not None and not (out / REPORT).is_file():
        raise DatasetError(
            f"--out {out}: its {present} would be replaced, and no {REPORT} says that it is of an earlier rectified "
            "pair; choose another"
        )
    return ResultFolder(out, "rectified pair", REPORT, mark_text=UNFINISHED, shared=True)


def rig_beside(image: Path) -> Path:
    """Return where the rig file of an image or a recording lies, if there is one."""
    return (image if image.name else image.absolute()).with_name(RIG_FILE)  # a bag may be "."


def remove_pair(out: Path) -> None:
    """Delete the files of write_pair, and the folder if nothing else is in it; without its report, nothing."""
    if not (out / REPORT).is_file():
        return
    for name in (*FILES, REPORT):
        (out / name).unlink(missing_ok=True)
    with suppress(OSError):  # the folder is not empty
        out.rmdir()


def rig_dict(pair: RectifiedPair) -> dict[str, Any] | None:
    """Return the rig file of a rectified pair, with `shift` where the eyes' cx differ, and with `camera_to_rover` where
    labels give it; None without a scale.
    """
    calibration = pair.calibration
    if calibration is None or calibration.size is None:
        return None
    rig: dict[str, Any] = calibration.rig(*calibration.size).to_dict()
    if calibration.shift:
        rig["shift"] = round(float(calibration.shift), 6)
    if (pose := labelled_camera_pose(pair)) is not None:
        rig[ROVER_KEY] = pose.round(9).tolist()
    return rig


def labelled_camera_pose(pair: RectifiedPair) -> np.ndarray | None:
    """Return the pose of the rectified left camera on the rover, where the labels give it: (4, 4) camera to rover."""
    if pair.view is None or pair.cameras is None:
        return None
    return rectified_to_rover(pair.cameras, pair.view.rotation)


def make_report(left: RawImage, right: RawImage, pair: RectifiedPair, calibration: str) -> dict[str, Any]:
    """Return what report.json holds.

    Args:
        left, right: The raw images.
        pair: The rectified pair.
        calibration: Where the calibration is from.
    """
    height, width = pair.left_valid.shape
    report: dict[str, Any] = {
        "left": str(left.path), "right": str(right.path), "calibration": calibration,
        "size_px": [width, height],
        "valid_share": {
            name: round(float(getattr(pair, f"{name}_valid").mean()), 4) for name in ("left", "right")
        },
    }  # fmt: skip
    scale = pair.calibration
    if scale is None:
        report["scale"] = NO_SCALE
    else:
        report.update(scale="metres", focal_px=float(scale.fx), baseline_m=float(scale.baseline))
    if pair.view is not None and pair.cameras is not None:
        report.update(
            vergence_deg=round(float(np.rad2deg(pair.cameras.vergence)), 4),
            common_disparity_taken_out_px=round(float(pair.view.shift), 6),
        )
    rows: dict[str, Any] = {"raw": None, "rectified": None, "removed": None}
    if pair.matches is not None:
        rows.update(raw=pair.matches.before.as_dict(), rectified=pair.matches.after.as_dict())
        report["disparity_of_matches_px"] = _percentiles(pair.matches.disparity)
        if scale is not None:
            d = pair.matches.disparity + scale.shift
            report["depth_of_matches_m"] = _percentiles(scale.fx * scale.baseline / d[d > 0])
    if pair.removed is not None:
        rows["removed"] = {
            "terms_px": [round(term, 4) for term in pair.removed.terms],
            "root_mean_square_px": round(pair.removed.size, 4), "standard_error_px": round(pair.removed.error, 4),
        }  # fmt: skip
    return {**report, "rows": rows}


def _percentiles(values: np.ndarray) -> dict[str, float]:
    if not len(values):
        return {}
    return {f"percentile_{p}": round(float(np.percentile(values, p)), 3) for p in (1, 50, 99)}
