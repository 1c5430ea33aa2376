"""Frames of a video that shows both eyes, or of two videos, one an eye."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from marssim.base.command.input_file import check_file

APART = 0.01  # share by which the frame rates of two videos may differ
SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")


class EndOfVideo(Exception):
    """A video ended before the frame that was wanted."""


class VideoFrames:
    """Reads pairs of frames, in rising order of their numbers.

    Attributes:
        count: Number of frames, as the header says; the shorter one's of two videos.
        rate: Frames a second; 0 if the header does not say.

    Args:
        paths: One video with the left eye in its left half, or those of the left and of the right eye.

    Raises:
        FileNotFoundError: A video is missing.
        ValueError: A file is no video, or the two have other sizes or rates of frames; the message names it.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = tuple(paths)
        for path in paths:
            check_file(path, "video")
        self._captures = [_opened(path) for path in paths]
        for path, capture in zip(paths, self._captures):
            if not capture.isOpened() or capture.get(cv2.CAP_PROP_FRAME_COUNT) < 1:
                raise ValueError(f"{path}: is not a video that OpenCV can read")
        sizes = [(int(c.get(cv2.CAP_PROP_FRAME_WIDTH)), int(c.get(cv2.CAP_PROP_FRAME_HEIGHT))) for c in self._captures]
        if len(set(sizes)) > 1:
            raise ValueError(
                f"{paths[0]} is {sizes[0][0]} x {sizes[0][1]}, {paths[1]} is {sizes[1][0]} x {sizes[1][1]}: "
                "both eyes must have the same size"
            )
        rates = [float(c.get(cv2.CAP_PROP_FPS) or 0.0) for c in self._captures]
        if max(rates) - min(rates) > APART * max(rates):
            raise ValueError(
                f"{paths[0]} has {rates[0]:g} frames a second, {paths[1]} has {rates[1]:g}: "
                "frames of one number are of different times"
            )
        if len(paths) == 1 and sizes[0][0] % 2:
            raise ValueError(f"{paths[0]}: is {sizes[0][0]} px wide, which does not divide into two eyes")
        self.count = min(int(c.get(cv2.CAP_PROP_FRAME_COUNT)) for c in self._captures)
        self.rate = rates[0]
        self._next = 0

    def valid(self, number: int) -> tuple[None, None]:
        """Return where the images of a frame show the scene: everywhere."""
        return None, None

    def record(self, number: int) -> dict[str, Any]:
        """Return what prediction.json says of a frame."""
        return {"frame": number}

    def read(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return both images of a frame, (H, W, 3) uint8 RGB.

        Args:
            number: Number of the frame, from 0, larger than that of the last call.

        Raises:
            EndOfVideo: The video ends before it, or is broken from there on.
        """
        while self._next < number:
            if not all(capture.grab() for capture in self._captures):
                raise EndOfVideo
            self._next += 1
        images = []
        for capture in self._captures:
            good, image = capture.read()
            if not good:
                raise EndOfVideo
            images.append(np.ascontiguousarray(image[..., ::-1]))
        self._next += 1
        if len(images) == 1:
            half = images[0].shape[1] // 2
            images = [np.ascontiguousarray(part) for part in (images[0][:, :half], images[0][:, half:])]
        return images[0], images[1]


def _opened(path: Path) -> cv2.VideoCapture:
    """Open a video without the messages of OpenCV and FFmpeg, whose first video in a process sets the level of both."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    log = cv2.utils.logging
    level = log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        log.setLogLevel(level)
