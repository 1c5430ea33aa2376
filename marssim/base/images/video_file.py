"""Write a video frame by frame, so that a file under its name is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from marssim.base.files.atomic import written_atomically

MOST_TICKS = 65535  # that MPEG-4 counts in a second, or in a power of ten of seconds


@contextmanager
def written_video(path: Path, size: tuple[int, int], rate: float) -> Iterator[Callable[[np.ndarray], None]]:
    """Yield a function that adds a frame to a video (MPEG-4 in mp4), which gets its name when the block ends.

    An exception in the block leaves an older file, or none. OpenCV does not say when it cannot write, so the frames are
    counted in the file afterwards.

    Args:
        path: The file. Its folder must exist.
        size: Width and height of the frames [px].
        rate: Frames a second; rounded to what MPEG-4 can count, as 66.667 to 66.67.

    Yields:
        A function of a frame, (height, width, 3) uint8 BGR.

    Raises:
        OSError: The file cannot be written, or does not hold all frames, as on a full disk. The error names it.
    """
    with written_atomically(path) as part:
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*"mp4v"), countable_rate(rate), size)
        if not writer.isOpened():
            raise OSError(
                f"{path}: OpenCV cannot write a video of {size[0]} x {size[1]} px here; is the folder writable?"
            )
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


def countable_rate(rate: float) -> float:
    """Return the nearest rate [frames/s] that is a whole number up to MOST_TICKS over a power of ten."""
    fitting = (round(rate, digits) for digits in range(6, -1, -1) if round(rate * 10**digits) <= MOST_TICKS)
    return float(max(next(fitting, MOST_TICKS), 1e-6))


def _frames(path: Path) -> int:
    """Return how many frames of a video can be read; 0 if it cannot be opened."""
    video = cv2.VideoCapture(str(path))
    count = 0
    while video.grab():
        count += 1
    video.release()
    return count
