"""The arrays of images, compressed images and point clouds in a bag."""

from __future__ import annotations

import re
from typing import Any

import cv2
import numpy as np

from marssim.base.bags.messages import UNKNOWN_DISPARITY
from marssim.base.files.decoding import decode

# encoding: type, channels, and what OpenCV makes RGB or grey of it
ENCODINGS: dict[str, tuple[type[np.generic], int, int | None]] = {
    "mono8": (np.uint8, 1, None), "8UC1": (np.uint8, 1, None), "mono16": (np.uint16, 1, None),
    "16UC1": (np.uint16, 1, None), "32FC1": (np.float32, 1, None), "rgb8": (np.uint8, 3, None),
    "rgb16": (np.uint16, 3, None), "8UC3": (np.uint8, 3, cv2.COLOR_BGR2RGB), "bgr8": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "bgr16": (np.uint16, 3, cv2.COLOR_BGR2RGB), "rgba8": (np.uint8, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    # OpenCV names a pattern by its second row and column
    "bayer_rggb8": (np.uint8, 1, cv2.COLOR_BayerBG2RGB), "bayer_bggr8": (np.uint8, 1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (np.uint8, 1, cv2.COLOR_BayerGR2RGB), "bayer_grbg8": (np.uint8, 1, cv2.COLOR_BayerGB2RGB),
}  # fmt: skip
UINT32, FLOAT32 = 6, 7  # of sensor_msgs/PointField


def image_array(message: Any) -> np.ndarray:
    """Return the image of a sensor_msgs/Image or sensor_msgs/CompressedImage.

    Returns:
        (H, W) or RGB (H, W, 3), uint8, uint16 or float32.

    Raises:
        ValueError: The encoding is not supported, or the data are too short; the message begins with what is wrong.
    """
    if not hasattr(message, "encoding"):
        return _decompressed(message)
    check_encoding(message)
    kind, channels, conversion = ENCODINGS[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    width, height, step = int(message.width), int(message.height), int(message.step)
    row = width * channels * dtype.itemsize
    if not (width and height) or step < row or len(message.data) < step * height:
        raise ValueError(
            f"{width} x {height} px in {message.encoding} need {row} bytes a row, there are {len(message.data)} bytes "
            f"in rows of {step}"
        )
    rows = np.asarray(message.data, np.uint8)[: step * height].reshape(height, step)[:, :row]
    values = np.ascontiguousarray(rows).view(dtype).astype(kind, copy=False)
    values = values.reshape(height, width, channels) if channels > 1 else values.reshape(height, width)
    return values if conversion is None else cv2.cvtColor(values, conversion)


def check_encoding(message: Any) -> None:
    """Raise ValueError if the encoding of an image is not supported. The message begins with it."""
    if hasattr(message, "encoding") and message.encoding not in ENCODINGS:
        raise ValueError(f"encoding {message.encoding!r} is not supported; {', '.join(ENCODINGS)} are")


def disparity_array(message: Any) -> np.ndarray:
    """Return the disparity of a stereo_msgs/DisparityImage, (H, W) float32 [px]; NaN is unknown. Raises as image_array.

    A disparity of 0 is infinitely far.
    """
    disparity = image_array(message.image)
    return np.where(disparity >= max(message.min_disparity, UNKNOWN_DISPARITY), disparity, np.float32(np.nan))


def cloud_arrays(message: Any) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the points of a sensor_msgs/PointCloud2 and their colours.

    Returns:
        (N, 3) float32 points [m] in the frame of its header, and (N, 3) uint8 RGB; None if it has no field rgb.

    Raises:
        ValueError: It has no x, y and z of float32, or its data are too short.
    """
    offsets = {
        field.name: int(field.offset) for field in message.fields
        if field.datatype == FLOAT32 or (field.name == "rgb" and field.datatype == UINT32)
    }  # fmt: skip
    step, count = int(message.point_step), int(message.width) * int(message.height)
    least = max(count * step, int(message.row_step) * int(message.height))
    if not {"x", "y", "z"} <= offsets.keys() or max(offsets.values()) + 4 > step or len(message.data) < least:
        raise ValueError("the cloud has no x, y and z of float32, or its data are too short")
    end = ">" if message.is_bigendian else "<"
    names = [name for name in ("x", "y", "z", "rgb") if name in offsets]
    dtype = np.dtype(
        {"names": names, "formats": [end + ("u4" if name == "rgb" else "f4") for name in names],
         "offsets": [offsets[name] for name in names], "itemsize": step}
    )  # fmt: skip
    data = np.asarray(message.data, np.uint8)
    if (across := int(message.row_step)) > int(message.width) * step:  # rows end in unused bytes
        data = data[: int(message.height) * across].reshape(-1, across)[:, : int(message.width) * step].ravel()
    rows = data[: count * step].view(dtype)
    points = np.column_stack([rows[name] for name in "xyz"]).astype(np.float32)
    if "rgb" not in offsets:
        return points, None
    return points, np.column_stack([rows["rgb"] >> shift & 255 for shift in (16, 8, 0)]).astype(np.uint8)


def _decompressed(message: Any) -> np.ndarray:
    image = decode(bytes(message.data))
    if image is None:
        raise ValueError(f"the compressed image of format {message.format!r} is not readable")
    return _demosaiced(image, message.format) if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])


def _demosaiced(image: np.ndarray, form: str) -> np.ndarray:
    """Return the RGB image of a Bayer mosaic; an image that is grey by its format as it is.

    The format is "ENCODING; CODEC compressed ENCODING" of the image before and of what was compressed. image_transport
    leaves out the second encoding, or repeats the first, where it keeps the mosaic; newer releases convert it for JPEG,
    and then write mono8.

    Args:
        image: (H, W).
        form: CompressedImage.format.

    Raises:
        ValueError: The mosaic is of an encoding that is not supported; the message begins with it.
    """
    parts = re.match(r"\s*(bayer_\w+)\s*;\s*\w+\s+compressed\s*(\w*)", form)
    if parts is None:
        return image
    encoding, compressed = parts.groups()
    if compressed not in ("", encoding):
        return image
    if encoding not in ENCODINGS:
        raise ValueError(f"encoding {encoding!r} is not supported; {', '.join(ENCODINGS)} are")
    conversion = ENCODINGS[encoding][2]
    assert conversion is not None  # of a mosaic
    return cv2.cvtColor(image, conversion)
