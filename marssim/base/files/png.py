"""PNG images, from whoever wrote them: a broken one gives no image, and nothing else."""

from __future__ import annotations

import zlib

import cv2
import numpy as np

MAGIC = b"\x89PNG\r\n\x1a\n"


def decode_png(data: bytes) -> np.ndarray | None:
    """A PNG file as OpenCV reads it, (H, W) or BGR (H, W, 3), uint8 or uint16; None if it is not whole.

    libpng tells on stderr what is wrong with a file, and OpenCV cannot keep it from that: so checksums are held first.
    """
    if not is_whole(data):
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # of a size that OpenCV refuses
        return None


def is_whole(data: bytes) -> bool:
    """Do the checksums of all chunks of a PNG file hold, up to the last one?"""
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
