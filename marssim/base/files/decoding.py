"""Decode images with OpenCV, without what its libraries print to stderr past Python's own stream."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np

STDERR = 2  # file descriptor
DAMAGED = (b"Corrupt JPEG data", b"Premature end of JPEG")  # begin libjpeg's lines on files that it decodes in part
MESSAGES = (b"libpng ", *DAMAGED)  # begin the lines of libraries


def decode(data: bytes, flag: int = cv2.IMREAD_UNCHANGED) -> np.ndarray | None:
    """Decode the content of an image file.

    Libraries print to the file descriptor of stderr, which belongs to the whole process. So their lines are left out
    in the main thread only.

    Args:
        data: Content of the file.
        flag: Flag of cv2.imdecode, such as cv2.IMREAD_GRAYSCALE.

    Returns:
        (H, W) or BGR (H, W, 3), of any type; None if the file is empty, of no known format or damaged.
    """
    log = cv2.utils.logging
    level = log.setLogLevel(log.LOG_LEVEL_SILENT)  # the caller reports a broken file
    try:
        with _library_messages() as messages:
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
    if threading.current_thread() is not threading.main_thread():
        yield messages
        return
    try:
        caught = tempfile.TemporaryFile()  # noqa: SIM115
        stderr = os.dup(STDERR)
    except OSError:  # no folder for the file, or stderr is closed
        yield messages
        return
    os.dup2(caught.fileno(), STDERR)
    try:
        yield messages
    finally:
        os.dup2(stderr, STDERR)
        with caught:
            caught.seek(0)
            for line in caught:
                if line.startswith(MESSAGES):
                    messages.append(line)
                else:  # of another thread
                    os.write(stderr, line)
        os.close(stderr)
