"""The figure of several methods on pairs without true depth, as in the paper's figures of real images.

A block of two rows a pair: the left image, then the depth of each method above its normals. All depths have one scale.
Sky, and depth beyond the scale, is grey; what a method does not know is black.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from m3depth.estimator import Estimator
from m3depth.evaluation.without_truth.pairs import ImagePair
from m3depth.evaluation.without_truth.scoring import predictions_of
from m3depth.figures.drawing import colour_map, label_bar, note, panel_aspect, save, show
from m3depth.prediction.masks import unknown_where, unmeasured, without_sky_normals
from m3depth.prediction.pictures.figure import depth_range_shown
from m3depth.stereo.pairs import in_colour, spread
from m3depth.stereo.prediction import Prediction
from marssim.base.command.wording import without_middle
from marssim.base.images.colours import BEYOND, DEPTH_MAP, NORMAL_TITLE, depth_colours, normal_colours

PANEL = 2.0  # [in] width of a map; the left image is twice as wide
SHOWN = 3  # pairs
LONGEST_NAME = 40  # characters that are as wide as the left image
MOST = 640  # [px] width of a map that is kept
TEXT = f"{NORMAL_TITLE}\ngrey: sky, or farther than the scale; black: unknown"


@dataclass(frozen=True)
class MethodMaps:
    """The maps of one method on a pair, at MOST px of width or less.

    Attributes:
        depth: (H, W) [m]; inf: sky, NaN: unknown.
        normal: (H, W, 3), camera frame; 0 in the sky and where it is unknown. None if the method has none.
    """

    depth: np.ndarray
    normal: np.ndarray | None

    @classmethod
    def from_prediction(cls, prediction: Prediction) -> MethodMaps:
        """Return the maps of a prediction; what the method filled in without a match is unknown."""
        measured = unknown_where(without_sky_normals(prediction), unmeasured(prediction))
        return cls(_reduced(measured.depth), None if measured.normal is None else _reduced(measured.normal))


@dataclass(frozen=True)
class PairMaps:
    """A pair with the maps of every method.

    Attributes:
        name: Name of the pair.
        left: (H, W, 3) uint8 RGB left image, at MOST px of width or less.
        maps: The maps, by the name of the method.
    """

    name: str
    left: np.ndarray
    maps: Mapping[str, MethodMaps]

    @classmethod
    def from_predictions(cls, name: str, left: np.ndarray, predictions: Mapping[str, Prediction]) -> PairMaps:
        """Return what the figure keeps of a pair.

        Args:
            name: Name of the pair.
            left: (H, W) or (H, W, 3) uint8 left image.
            predictions: Predictions by the name of the method.
        """
        image = in_colour(left)
        small = cv2.resize(image, _size(image), interpolation=cv2.INTER_AREA)
        return cls(
            name, small, {method: MethodMaps.from_prediction(prediction) for method, prediction in predictions.items()}
        )


def draw_side_by_side(
    pairs: Sequence[ImagePair], methods: Mapping[str, Estimator], path: Path, align_rows: bool = False
) -> None:
    """Predict up to SHOWN pairs, spread evenly, with every method, and write the figure of them.

    Args:
        pairs: The pairs.
        methods: The methods, by the name of their column.
        path: The file to write.
        align_rows: Whether to align the rows of each pair first.

    Raises:
        DatasetError: A file of a pair cannot be used.
        EstimatorError: A method returned no whole Prediction.
    """
    shown = []
    for pair in (pairs[i] for i in spread(len(pairs), SHOWN)):
        images = pair.read()
        shown.append(PairMaps.from_predictions(pair.name, images.left, predictions_of(methods, images, align_rows)))
    side_by_side_figure(shown, path)


def side_by_side_figure(pairs: Sequence[PairMaps], path: Path) -> np.ndarray:
    """Write a PNG with a block a pair: left image, and depth and normals of each method.

    Args:
        pairs: The pairs, all with the same methods.
        path: The file to write.

    Returns:
        (H, W, 3) uint8 RGB, the picture.
    """
    names = list(pairs[0].maps)
    aspect, blocks = panel_aspect(pairs[0].left), len(pairs)
    width, height = PANEL * (2 + len(names)) + 0.1, 2 * PANEL * aspect * blocks + 0.1 * (blocks - 1) + 1.1  # [in]
    figure = Figure(figsize=(width, height), dpi=120)
    grid = figure.add_gridspec(
        blocks, 1, left=0.05 / width, right=1 - 0.05 / width, top=1 - 0.3 / height, bottom=0.78 / height, hspace=0.04
    )
    near, far = depth_range_shown(np.concatenate([m.depth.ravel() for pair in pairs for m in pair.maps.values()]))
    for block, pair in enumerate(pairs):
        cells = grid[block].subgridspec(
            2, 1 + len(names), width_ratios=[2] + [1] * len(names), wspace=0.02, hspace=0.02
        )
        image = figure.add_subplot(cells[:, 0])
        show(image, pair.left)
        share = min(1.0, aspect / panel_aspect(pair.left))  # of the panel's width, which a higher image does not fill
        note(image, without_middle(pair.name, int(LONGEST_NAME * share)), corner="lower left")
        for column, (name, maps) in enumerate(pair.maps.items(), start=1):
            top, bottom = (figure.add_subplot(cells[row, column]) for row in range(2))
            show(top, depth_colours(maps.depth, near, far))
            show(bottom, normal_panel(maps))
            if maps.normal is None:
                note(bottom, "no normals")
            if block == 0:
                top.set_title(name, fontsize=11, fontweight="bold")
        if block == 0:
            image.set_title("left image", fontsize=11, fontweight="bold")
    norm = LogNorm(near, far)
    place = figure.add_axes((0.05, 0.5 / height, 0.4, 0.14 / height))
    scale = matplotlib.cm.ScalarMappable(norm, colour_map(DEPTH_MAP))
    label_bar(figure.colorbar(scale, cax=place, orientation="horizontal"), norm, "depth [m]")
    figure.text(0.5, 0.25 / height, TEXT, fontsize=9)
    return save(figure, path)


def normal_panel(maps: MethodMaps) -> np.ndarray:
    """Return the picture of the normals, (H, W, 3) uint8: grey in the sky, black where unknown, white without any."""
    if maps.normal is None:
        return np.full((*maps.depth.shape, 3), 255, np.uint8)
    colours = normal_colours(maps.normal)
    colours[np.isposinf(maps.depth)] = BEYOND
    return colours


def _size(image: np.ndarray) -> tuple[int, int]:
    """Return width and height [px] at which an image is kept."""
    width = min(MOST, image.shape[1])
    return width, max(1, round(image.shape[0] * width / image.shape[1]))


def _reduced(values: np.ndarray) -> np.ndarray:
    """Return a map at its size in the figure, without mixing neighbours."""
    return np.asarray(cv2.resize(values, _size(values), interpolation=cv2.INTER_NEAREST))
