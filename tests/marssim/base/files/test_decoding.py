"""Broken images are refused without a line of the libraries that decode them, and other lines stay."""

import os
import struct
import zlib
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from marssim.base.files import decoding
from marssim.base.files.decoding import decode
from marssim.base.files.png import MAGIC, decode_png

ROWS = b"".join(b"\0" + bytes(range(24)) for _ in range(6))  # 8 x 6 RGB, without filters


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(pixels: bytes, more: bytes = b"", depth: int = 8) -> bytes:
    """Return a file of these compressed pixels, all of whose checksums are right."""
    header = struct.pack(">IIBBBBB", 8, 6, depth, 2, 0, 0, 0)
    return MAGIC + chunk(b"IHDR", header) + more + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


BROKEN = {
    "too few rows": png(zlib.compress(ROWS[:50])),
    "no stream": png(b"x\x9cgarbage!"),
    "an unknown filter": png(zlib.compress(b"\7" + ROWS[1:])),
    "an unknown depth": png(zlib.compress(ROWS), depth=3),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_content_behind_right_checksums_prints_nothing(kind, capfd):
    assert decode_png(BROKEN[kind]) is None
    assert capfd.readouterr() == ("", "")


def test_what_a_library_says_of_a_file_that_can_be_read_stays_out(capfd):
    image = decode(png(zlib.compress(ROWS), chunk(b"iCCP", b"x\0\0garbage")))
    assert image is not None and np.array_equal(image[0, 0], [2, 1, 0])
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_that_is_decoded_in_part_is_refused(capfd):
    smooth = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8), (0, 0), 2)
    whole = cv2.imencode(".jpg", smooth)[1].tobytes()
    assert decode(whole) is not None
    assert decode(whole[:-40] + whole[-2:]) is None
    assert capfd.readouterr() == ("", "")


def test_lines_of_others_stay(capfd, monkeypatch):
    def imdecode(data, flag):
        os.write(2, b"libpng warning: iCCP: too short\na line of other code\n")
        return np.zeros((1, 1), np.uint8)

    monkeypatch.setattr(decoding.cv2, "imdecode", imdecode)
    assert decode(b"x") is not None
    assert capfd.readouterr().err == "a line of other code\n"


@pytest.mark.parametrize("read", [decode, decode_png])
def test_in_threads_decode_alone_leaves_the_lines_of_libraries_out(read, capfd):
    with ThreadPoolExecutor(4) as pool:
        whole = png(zlib.compress(ROWS))
        images = list(pool.map(read, [BROKEN["too few rows"], whole] * 20))
    assert images[::2] == [None] * 20 and all(image is not None for image in images[1::2])
    assert ("libpng error" in capfd.readouterr().err) == (read is decode_png)
    assert decode(b"") is None
