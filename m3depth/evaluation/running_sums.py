"""Sums over pixels and over images, in memory that does not grow with either."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from m3depth.evaluation.metrics import known_depth
from marssim.base.camera import MAX_DEPTH

ROOTS = frozenset({"rmse"})  # terms whose mean is a mean square
BIN = 0.01  # [deg] of the histogram that the pooled median angle comes from
DEPTH_BIN = 0.25  # [m]
ERROR_RANGE = (1e-3, 1e2)  # [m]
ERROR_BINS = 60


class Tally:
    """Means of per-pixel terms, over all pixels and as the mean over images."""

    def __init__(self, names: tuple[str, ...], median: bool = False) -> None:
        """names: of the terms, in order. median: the first term is an angle [deg] whose median is wanted too."""
        self.names = names
        self.pixels = 0
        self.images = 0
        self._sum = np.zeros(len(names))
        self._image_sum: dict[str, float] = {}
        self._histogram = np.zeros(round(180 / BIN), dtype=np.int64) if median else None

    def add_sums(self, total: np.ndarray, pixels: int, first: np.ndarray) -> dict[str, float]:
        """Add one image: the sums of its terms, (len(names),), over so many pixels, and the first term, (N,), for its
        median. Returns the image's own figures; {} if it has no such pixel."""
        if not pixels:
            return {}
        figures = self._figures(total, pixels)
        if self._histogram is not None:
            figures["median"] = float(np.median(first))
            index = np.minimum((first * (1 / BIN)).astype(np.int64), len(self._histogram) - 1)
            self._histogram += np.bincount(index, minlength=len(self._histogram))
        for name, value in figures.items():
            self._image_sum[name] = self._image_sum.get(name, 0.0) + value
        self._sum += total
        self.pixels += pixels
        self.images += 1
        return figures

    def result(self) -> dict[str, Any]:
        """{"pixels", "images", "per_image": {name: figure}, "pooled": {name: figure}}; {} for both without pixels."""
        out: dict[str, Any] = {"pixels": self.pixels, "images": self.images, "per_image": {}, "pooled": {}}
        if self.pixels:
            out["per_image"] = {name: value / self.images for name, value in self._image_sum.items()}
            out["pooled"] = self._figures(self._sum, self.pixels)
            if self._histogram is not None:
                out["pooled"]["median"] = self._histogram_median()
        return out

    def state_dict(self) -> dict[str, Any]:
        """What has been added so far, in JSON's types and arrays, for load_state_dict."""
        return {
            "pixels": self.pixels, "images": self.images, "sum": self._sum, "image_sum": self._image_sum,
            "histogram": self._histogram,
        }  # fmt: skip

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there. Raises KeyError if something is missing."""
        self.pixels, self.images, self._sum = state["pixels"], state["images"], state["sum"]
        self._image_sum, self._histogram = state["image_sum"], state["histogram"]

    def _figures(self, total: np.ndarray, count: int) -> dict[str, float]:
        means = total / count
        return {n: float(np.sqrt(m) if n in ROOTS else m) for n, m in zip(self.names, means, strict=True)}

    def _histogram_median(self) -> float:
        """Linear within the bin that holds the middle."""
        assert self._histogram is not None
        below = np.cumsum(self._histogram)
        half = self.pixels / 2
        index = int(np.searchsorted(below, half))
        before = below[index] - self._histogram[index]
        return BIN * (index + (half - before) / float(self._histogram[index]))


@dataclass
class SkyTally:
    """Sky that is predicted as an obstacle: nearer than the 15 m that count."""

    pixels: int = 0
    near: int = 0

    def add(self, depth: np.ndarray, sky: np.ndarray) -> None:
        """depth: (H, W) predicted [m]; sky: (H, W) bool."""
        self.pixels += int(sky.sum())
        self.near += int((known_depth(depth) & (depth < MAX_DEPTH) & sky).sum())

    def state_dict(self) -> dict[str, Any]:
        """As Tally.state_dict."""
        return {"pixels": self.pixels, "near": self.near}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """As Tally.load_state_dict."""
        self.pixels, self.near = state["pixels"], state["near"]

    def result(self) -> dict[str, Any]:
        """{"pixels", "predicted_near": share or None}."""
        return {"pixels": self.pixels, "predicted_near": self.near / self.pixels if self.pixels else None}


@dataclass
class ErrorMap:
    """How many pixels have which absolute depth error at which true depth: the paper's cloud of points, counted.

    counts: (60, 60), [error, depth]: errors by equal steps of their logarithm from 1 mm to 100 m, depths by 0.25 m.
    """

    counts: np.ndarray = field(default_factory=lambda: np.zeros((ERROR_BINS, round(MAX_DEPTH / DEPTH_BIN)), np.int64))

    def add(self, true: np.ndarray, error: np.ndarray) -> None:
        """true: (N,) depth [m]; error: (N,) [m], not negative. What is farther than the paper's 15 m is left out."""
        true, error = true[true <= MAX_DEPTH], error[true <= MAX_DEPTH]
        rows, columns = self.counts.shape
        low, high = np.log(ERROR_RANGE)
        row = (np.log(np.clip(error, *ERROR_RANGE)) - low) * (rows / (high - low))
        column = true / DEPTH_BIN
        flat = np.minimum(row.astype(int), rows - 1) * columns + np.minimum(column.astype(int), columns - 1)
        self.counts += np.bincount(flat, minlength=rows * columns).reshape(rows, columns)

    def state_dict(self) -> dict[str, Any]:
        """As Tally.state_dict."""
        return {"counts": self.counts}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """As Tally.load_state_dict."""
        self.counts = state["counts"]

    def result(self) -> dict[str, Any]:
        """{"depth_step_m", "error_from_m", "error_to_m", "counts": rows of equal steps of the error's logarithm}."""
        low, high = ERROR_RANGE
        return {
            "depth_step_m": DEPTH_BIN, "error_from_m": low, "error_to_m": high, "counts": self.counts.tolist(),
        }  # fmt: skip
