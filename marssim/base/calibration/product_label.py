"""What the label of a rover's image says about the camera: its model, the size, the time, and which eye it is.

PDS3       attached to the image (.IMG), or in a file of its own (.LBL): group GEOMETRIC_CAMERA_MODEL,
           or in labels of MSL GEOMETRIC_CAMERA_MODEL_PARMS
VICAR      the header of a .IMG or .VIC file: property GEOMETRIC_CAMERA_MODEL
PDS4       .xml: geom:Camera_Model_Parameters
Zhurong    .2CL, PDS4 with the mission's own fields
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from marssim.base.calibration.cameras import PosedCamera

LATEST = timedelta(seconds=60)  # between the images of a pair, which are often taken one after the other
BASED = re.compile(r"([+-]?)(?:(\d{1,2})#|0x)([0-9A-Za-z]{1,64})#?")  # a number in another base, 16#FF7FFFFB#
NO_VALUE = ("", "N/A", "NULL", "UNK")  # in place of a number


@dataclass(frozen=True)
class ProductLabel:
    """The label of an image.

    Attributes:
        camera: The camera model; None if the label has none.
        size: Width and height of the image [px]; None if the label does not say.
        start: When the exposure began; None if the label does not say.
        eye: "left", "right", or "" if the label does not say.
        motion: The rover's motion counter, which changes when the rover or its mast moves; empty if unknown.
        missing: Values of pixels that hold no data.
        file_bytes: Least size of the file that the label is attached to; None if it is detached.
    """

    camera: PosedCamera | None
    size: tuple[int, int] | None
    start: datetime | None = None
    eye: str = ""
    motion: tuple[int, ...] = ()
    missing: tuple[float, ...] = ()
    file_bytes: int | None = None


def check_labels(left: ProductLabel, right: ProductLabel, names: tuple[Path, Path]) -> None:
    """Check that two labels are those of one pair.

    Args:
        left, right: The labels.
        names: Their files, for the message.

    Raises:
        ValueError: The eyes are exchanged or one and the same, or the rover moved between the images.
    """
    if left.eye == "right" and right.eye == "left":
        raise ValueError(f"{names[0]} is of the right eye and {names[1]} of the left one: exchange left and right")
    if left.eye and left.eye == right.eye:
        raise ValueError(f"{names[0]} and {names[1]} are both of the {left.eye} eye: give one of each")
    if left.motion and right.motion and left.motion != right.motion:
        raise ValueError(
            f"{names[0]} and {names[1]} have other motion counters, {_counter(left.motion)} and "
            f"{_counter(right.motion)}: the rover or its mast moved between them"
        )
    if left.start is not None and right.start is not None and abs(right.start - left.start) > LATEST:
        seconds = abs((right.start - left.start).total_seconds())
        raise ValueError(f"{names[0]} and {names[1]} were taken {seconds:.0f} s apart: they are no pair")


def parse_time(text: object) -> datetime | None:
    """Return a time of a label (2023-02-17T05:22:09.508, 2023-048T05:22:09.508Z); None if it is none."""
    for form in ("%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S", "%Y-%jT%H:%M:%S.%f", "%Y-%jT%H:%M:%S"):
        try:
            return datetime.strptime(str(text).strip().removesuffix("Z"), form).replace(tzinfo=UTC)
        except ValueError:
            continue
    return None


def eye_of(*texts: object) -> str:
    """Return "left" or "right" if one of some texts, such as NAVCAM_LEFT, says so."""
    for text in texts:
        words = str(text).lower().replace("_", " ").split()
        for eye in ("left", "right"):
            if eye in words:
                return eye
    return ""


def parse_counter(texts: Iterable[object]) -> tuple[int, ...]:
    """Return the whole numbers among the texts of a motion counter."""
    return tuple(int(float(str(x))) for x in texts if re.fullmatch(r"-?\d{1,12}(\.0*)?", str(x).strip()))


def sample_type(kind: str | None, size: int | None) -> np.dtype | None:
    """Return the type of a pixel, most significant byte first; None if there is no such type, or it is unknown.

    Args:
        kind: Letter of numpy: f, i or u.
        size: Bytes of a pixel.
    """
    sizes = (2, 4, 8) if kind == "f" else (1, 2, 4, 8)
    return np.dtype(f">{kind}{size}") if kind is not None and size in sizes else None


def pixel_constants(values: Mapping[str, object], sample: np.dtype | None) -> tuple[float, ...]:
    """Return the values of pixels that hold no data, by the constants of a label.

    Args:
        values: The constants, a text or a list of texts each, by the names of their fields.
        sample: Type of a pixel, most significant byte first. A number in another base, such as 16#FF7FFFFB#, has the
            bits of this type; None if the label does not say the type.

    Returns:
        The finite values, in rising order, each once.

    Raises:
        ValueError: A constant is no number. The message names the field.
    """
    constants = set()
    for name, content in values.items():
        for text in content if isinstance(content, list) else [content]:
            if str(text).strip().upper() in NO_VALUE:
                continue
            try:
                constants.add(_constant(str(text).strip(), sample))
            except (ValueError, OverflowError):
                raise ValueError(f"field {name} must hold numbers only, has {str(text).strip()[:40]!r}") from None
    return tuple(sorted(value for value in constants if np.isfinite(value)))


def _constant(text: str, sample: np.dtype | None) -> float:
    """Return the value of a pixel that a constant stands for. Raises ValueError or OverflowError if it is no number."""
    match = BASED.fullmatch(text)
    if match is None:
        return float(text)
    bits = int(match[3], int(match[2] or 16))
    if sample is None or match[1]:
        return float(-bits if match[1] == "-" else bits)
    return float(np.frombuffer(bits.to_bytes(sample.itemsize, "big"), sample)[0])


def _counter(motion: tuple[int, ...]) -> str:
    return "(" + ", ".join(map(str, motion)) + ")"
