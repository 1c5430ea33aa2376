"""Decode images with OpenCV, without what its libraries print to stderr past Python's own stream."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import cv2
import numpy as np

STDERR = 2  # file descriptor
DAMAGED = (b"Corrupt JPEG data", b"Premature end of JPEG")  # begin libjpeg's lines on files that it decodes in part
MESSAGES = (b"libpng ", *DAMAGED)  # begin the lines of libraries


_ALONE = threading.Lock()


def decode(data: bytes, flag: int = cv2.IMREAD_UNCHANGED, alone: bool = True) -> np.ndarray | None:
    """Decode the content of an image file.

    Libraries print to the file descriptor of stderr, which belongs to the whole process. So their lines can be left out
    while one thread at a time decodes. What other code prints meanwhile comes a moment later.

    Args:
        data: Content of the file.
        flag: Flag of cv2.imdecode, such as cv2.IMREAD_GRAYSCALE.
        alone: Decode while no other thread does, without the lines of libraries; refuse a JPEG that is decoded in part.

    Returns:
        (H, W) or BGR (H, W, 3), of any type; None if the file is empty, of no known format or damaged.
    """
    log = cv2.utils.logging
    level = log.setLogLevel(log.LOG_LEVEL_SILENT)  # the caller reports a broken file
    try:
        if not alone:
            return cv2.imdecode(np.frombuffer(data, np.uint8), flag)
        with _ALONE, _library_messages() as messages:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
        return None if any(line.startswith(DAMAGED) for line in messages) else image
    except cv2.error:  # an empty file, or a size that OpenCV refuses
        return None
    finally:
        log.setLogLevel(level)


@contextmanager
def _library_messages() -> Iterator[list[bytes]]:
    """Keep lines of libraries off stderr while the block runs, and put them into the list when it ends."""
    messages: list[bytes] = []
    try:
        stderr = os.dup(STDERR)
    except OSError:  # it is closed
        yield messages
        return
    try:
        caught = tempfile.TemporaryFile()  # noqa: SIM115
    except OSError:  # there is no folder for it
        os.close(stderr)
        yield messages
        return
    os.dup2(caught.fileno(), STDERR)
    try:
        yield messages
    finally:
        os.dup2(stderr, STDERR)
        os.close(stderr)
        with caught:
            caught.seek(0)
            for line in caught:
                if line.startswith(MESSAGES):
                    messages.append(line)
                else:  # of other code
                    with suppress(OSError):
                        os.write(STDERR, line)
