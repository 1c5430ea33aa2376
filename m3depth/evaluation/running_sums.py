"""Sums over pixels and over images, in memory that does not grow with either."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from m3depth.evaluation.metrics import has_depth
from marssim.base.camera import MAX_DEPTH

ROOTS = frozenset({"rmse"})  # terms whose mean is a mean square
NEAR_GROUND = 8.0  # [m] ground nearer than this must not be taken for sky
BIN = 0.01  # [deg] width of a bin of the histogram that the pooled median angle comes from
DEPTH_BIN = 0.25  # [m] width of a column of the error map
ERROR_RANGE = (1e-3, 1e2)  # [m] smallest and largest error of the error map
ERROR_BINS = 60  # rows of the error map


class RunningSums:
    """Means of per-pixel terms, over all pixels and as the mean over images.

    Attributes:
        names: Names of the terms, in order.
        pixels: Number of pixels so far.
        images: Number of images so far that have such pixels.
    """

    def __init__(self, names: tuple[str, ...], median: bool = False) -> None:
        """Begin with no pixels.

        Args:
            names: Names of the terms, in order.
            median: Whether the first term is an angle [deg] whose median is needed too.
        """
        self.names = names
        self.pixels = 0
        self.images = 0
        self._sum = np.zeros(len(names))
        self._image_sum: dict[str, float] = {}
        self._histogram = np.zeros(round(180 / BIN), dtype=np.int64) if median else None

    def add_sums(self, total: np.ndarray, pixels: int, first: np.ndarray) -> dict[str, float]:
        """Add one image.

        Args:
            total: (len(names),) sums of the terms over the image's pixels.
            pixels: Number of these pixels.
            first: (N,) the first term at every pixel, for its median.

        Returns:
            The image's own figures by name; {} if it has no such pixel.
        """
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
        """Return {"pixels", "images", "per_image": {name: figure}, "pooled": {name: figure}}.

        Both "per_image" and "pooled" are {} without pixels.
        """
        out: dict[str, Any] = {"pixels": self.pixels, "images": self.images, "per_image": {}, "pooled": {}}
        if self.pixels:
            out["per_image"] = {name: value / self.images for name, value in self._image_sum.items()}
            out["pooled"] = self._figures(self._sum, self.pixels)
            if self._histogram is not None:
                out["pooled"]["median"] = self._histogram_median()
        return out

    def state_dict(self) -> dict[str, Any]:
        """Return everything added so far, as JSON's types and arrays, for load_state_dict."""
        return {
            "pixels": self.pixels, "images": self.images, "sum": self._sum, "image_sum": self._image_sum,
            "histogram": self._histogram,
        }  # fmt: skip

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state_dict.

        Raises:
            KeyError: Something is missing in it.
        """
        self.pixels, self.images, self._sum = state["pixels"], state["images"], state["sum"]
        self._image_sum, self._histogram = state["image_sum"], state["histogram"]

    def _figures(self, total: np.ndarray, count: int) -> dict[str, float]:
        means = total / count
        return {n: float(np.sqrt(m) if n in ROOTS else m) for n, m in zip(self.names, means, strict=True)}

    def _histogram_median(self) -> float:
        """Return the median [deg], linear within the bin that holds the middle."""
        assert self._histogram is not None
        below = np.cumsum(self._histogram)
        half = self.pixels / 2
        index = int(np.searchsorted(below, half))
        before = below[index] - self._histogram[index]
        return BIN * (index + (half - before) / float(self._histogram[index]))


@dataclass
class SkyCounts:
    """Sky that is taken for something else, and near ground that is taken for sky, which reads as free ground.

    Attributes:
        pixels: Number of sky pixels.
        near: Number of those with a predicted depth under 15 m: an obstacle.
        missed: Number of those with any finite predicted depth.
        ground: Number of pixels whose true depth is under NEAR_GROUND.
        ground_as_sky: Number of those that are predicted as sky.
    """

    pixels: int = 0
    near: int = 0
    missed: int = 0
    ground: int = 0
    ground_as_sky: int = 0

    def add(self, depth: np.ndarray, truth: np.ndarray) -> None:
        """Add one image.

        Args:
            depth: (H, W) predicted depth [m].
            truth: (H, W) true depth [m], inf for sky, NaN where it is unknown.
        """
        sky, valid = np.isposinf(truth), has_depth(depth)
        with np.errstate(invalid="ignore"):
            near_ground = (truth > 0) & (truth < NEAR_GROUND)
        self.pixels += int(sky.sum())
        self.near += int((valid & (depth < MAX_DEPTH) & sky).sum())
        self.missed += int((valid & sky).sum())
        self.ground += int(near_ground.sum())
        self.ground_as_sky += int((np.isposinf(depth) & near_ground).sum())

    def merge(self, other: SkyCounts) -> None:
        """Add the counts of other images."""
        for name, count in asdict(other).items():
            setattr(self, name, getattr(self, name) + count)

    def state_dict(self) -> dict[str, Any]:
        """Return the state, as RunningSums.state_dict does."""
        return asdict(self)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, as RunningSums.load_state_dict does."""
        for name in asdict(self):
            setattr(self, name, state[name])

    def result(self) -> dict[str, Any]:
        """Return the counts of pixels, and the shares of each mistake; None without such pixels.

        predicted_near: sky that is predicted nearer than 15 m; missed: sky with any finite predicted depth;
        near_ground_as_sky: true depth under NEAR_GROUND that is predicted as sky.
        """
        return {
            "pixels": self.pixels,
            "near_ground_pixels": self.ground,
            "predicted_near": self.near / self.pixels if self.pixels else None,
            "missed": self.missed / self.pixels if self.pixels else None,
            "near_ground_as_sky": self.ground_as_sky / self.ground if self.ground else None,
        }


@dataclass
class ErrorMap:
    """Counts of pixels by absolute depth error and true depth: the paper's cloud of points, counted.

    Attributes:
        counts: (60, 60) pixels, [error, depth]. Errors go from 1 mm to 100 m in equal steps of their logarithm, depths
            in steps of 0.25 m.
    """

    counts: np.ndarray = field(default_factory=lambda: np.zeros((ERROR_BINS, round(MAX_DEPTH / DEPTH_BIN)), np.int64))

    def add(self, true: np.ndarray, error: np.ndarray) -> None:
        """Add pixels; those beyond the paper's 15 m are left out.

        Args:
            true: (N,) true depth [m].
            error: (N,) absolute error [m].
        """
        true, error = true[true <= MAX_DEPTH], error[true <= MAX_DEPTH]
        rows, columns = self.counts.shape
        low, high = np.log(ERROR_RANGE)
        row = (np.log(np.clip(error, *ERROR_RANGE)) - low) * (rows / (high - low))
        column = true / DEPTH_BIN
        flat = np.minimum(row.astype(int), rows - 1) * columns + np.minimum(column.astype(int), columns - 1)
        self.counts += np.bincount(flat, minlength=rows * columns).reshape(rows, columns)

    def state_dict(self) -> dict[str, Any]:
        """Return the state, as RunningSums.state_dict does."""
        return {"counts": self.counts}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, as RunningSums.load_state_dict does."""
        self.counts = state["counts"]

    def result(self) -> dict[str, Any]:
        """Return {"depth_step_m", "error_from_m", "error_to_m", "counts": rows by the error's logarithm}."""
        low, high = ERROR_RANGE
        return {
            "depth_step_m": DEPTH_BIN, "error_from_m": low, "error_to_m": high, "counts": self.counts.tolist(),
        }  # fmt: skip
