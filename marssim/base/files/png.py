"""Read and write PNG images. Reading a broken file gives None, and prints nothing."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Sequence

import cv2
import numpy as np

from marssim.base.files.decoding import decode

MAGIC = b"\x89PNG\r\n\x1a\n"


def encode_png(image: np.ndarray, options: Sequence[int] = ()) -> bytes:
    """Encode an image as PNG.

    Args:
        image: (H, W) or BGR (H, W, 3), uint8 or uint16.
        options: Pairs of cv2.IMWRITE_PNG_* and their values, one after the other.

    Returns:
        The content of the file.
    """
    return cv2.imencode(".png", np.ascontiguousarray(image), options)[1].tobytes()


def decode_png(data: bytes) -> np.ndarray | None:
    """Decode a PNG.

    The checksums are compared first, which OpenCV does not refuse in every chunk. Threads other than the main one
    decode side by side, and print what libpng says of a file that is broken behind right checksums.

    Args:
        data: Content of the file.

    Returns:
        (H, W) or BGR (H, W, 3), uint8 or uint16; None if the file is broken.
    """
    alone = threading.current_thread() is threading.main_thread()
    return decode(data, alone=alone) if is_whole(data) else None


def png_size(data: bytes) -> tuple[int, int]:
    """Return height and width [px] by the header of a PNG file, also of a broken one: a small file may unpack to much.

    Args:
        data: Content of the file.
    """
    return int.from_bytes(data[20:24], "big"), int.from_bytes(data[16:20], "big")


def is_whole(data: bytes) -> bool:
    """Return whether the checksums of all chunks of a PNG file are right, up to its last chunk."""
    if not data.startswith(MAGIC):
        return False
    view, at = memoryview(data), len(MAGIC)
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(view[at : at + 4], "big")
        if zlib.crc32(view[at + 4 : end]).to_bytes(4, "big") != view[end : end + 4]:
            return False
        if view[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False
