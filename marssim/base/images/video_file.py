"""Write a video frame by frame, so that a file under its name is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from marssim.base.files.atomic import written_atomically


@contextmanager
def written_video(path: Path, size: tuple[int, int], rate: float) -> Iterator[Callable[[np.ndarray], None]]:
    """Yield a function that adds a frame to a video (MPEG-4 in mp4), which gets its name when the block ends.

    An exception in the block leaves an older file, or none. OpenCV does not say when it cannot write, so the frames are
    counted in the file afterwards.

    Args:
        path: The file. Its folder must exist.
        size: Width and height of the frames [px].
        rate: Frames a second.

    Yields:
        A function of a frame, (height, width, 3) uint8 BGR.

    Raises:
        OSError: The file cannot be written, or does not hold all frames, as on a full disk. The error names it.
    """
    with written_atomically(path) as part:
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
        if not writer.isOpened():
            raise OSError(f"{path}: OpenCV cannot write a video here; is the folder writable?")
        frames = 0

        def write(frame: np.ndarray) -> None:
            nonlocal frames
            writer.write(frame)
            frames += 1

        try:
            yield write
        finally:
            writer.release()
        if (held := _frames(part)) != frames:
            raise OSError(f"{path}: only {held} of {frames} frames of the video could be written; is the disk full?")


def _frames(path: Path) -> int:
    """Return how many frames of a video can be read; 0 if it cannot be opened."""
    video = cv2.VideoCapture(str(path))
    count = 0
    while video.grab():
        count += 1
    video.release()
    return count
