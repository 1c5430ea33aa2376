"""The figure of a study's maps: depth, its error and the normals of every row, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill

from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from m3depth.evaluation.example import Example
from m3depth.figures.drawing import (
    colour_map,
    depth_scale,
    label_bar,
    masked_depth,
    normal_image,
    note,
    panel_aspect,
    save,
    show,
)  # fmt: skip
from m3depth.figures.pairs import LARGEST_ERROR
from m3depth.figures.panels import predicted_normal_image, show_disparity_error
from m3depth.network.model import M3Depth
from m3depth.stereo.pairs import StereoPairs, pair_name, spread
from marssim.base.images.colours import DEPTH_MAP, NORMAL_TITLE

PAIRS = 2  # pairs shown
PANEL = 1.7  # [in] width of one image
TITLE = 22  # characters of a line above it; three lines fit
KINDS = ("depth", "error of the disparity", "normals")  # rows of a pair


def predicted(rows: Mapping[str, Path], test: StereoPairs, device: str) -> list[Example]:
    """Return the first and the last test pair, with what the networks of a study's rows predict for them.

    Args:
        rows: The weights file of each row, by its label.
        test: The test pairs.
        device: Where the networks run, as PyTorch names it.
    """
    chosen = spread(len(test), PAIRS)
    samples = [test[index] for index in chosen]
    predictions: list[dict] = [{} for _ in chosen]
    for label, weights in rows.items():
        network = M3Depth.from_pretrained(weights).to(device)
        for sample, of_pair in zip(samples, predictions, strict=True):
            of_pair[label] = network.infer(sample.left, sample.right, sample.rig)
    return [
        Example(index, sample.left, sample.right, sample, of_pair, pair_name(test, index))
        for index, sample, of_pair in zip(chosen, samples, predictions, strict=True)
    ]


def maps_figure(examples: Sequence[Example], path: Path) -> None:
    """Write a PNG with three rows a pair: the depth, the error of the disparity and the normals, a column a row.

    The depths of a pair share a scale. Each error has its mean over the scored pixels.

    Args:
        examples: Two pairs or fewer, with the predictions of all rows.
        path: The file to write.
    """
    names = list(examples[0].predictions)
    columns, lines = 2 + len(names), len(KINDS) * len(examples)
    aspect = max(panel_aspect(example.left) for example in examples)
    width, height = PANEL * columns + 0.4, PANEL * aspect * lines + 1.23  # [in]
    figure = Figure(figsize=(width, height), dpi=120)
    edges = {"left": 0.36 / width, "right": 1 - 0.04 / width, "top": 1 - 0.5 / height, "bottom": 0.7 / height}
    axes = figure.subplots(lines, columns, squeeze=False, gridspec_kw={**edges, "wspace": 0.03, "hspace": 0.03})
    depth_map, errors = colour_map(DEPTH_MAP), Normalize(0, LARGEST_ERROR)
    for number, example in enumerate(examples):
        truth, of_pair = example.truth, axes[number * len(KINDS) : (number + 1) * len(KINDS)]
        scored = example.scored
        norm = depth_scale(truth.depth[scored])
        for ax, kind in zip(of_pair[:, 0], KINDS, strict=True):
            ax.axis("off")
            ax.text(0.97, 0.5, kind, transform=ax.transAxes, ha="right", va="center", fontsize=9)
        of_pair[0, 0].clear()
        show(of_pair[0, 0], example.left)
        of_pair[0, 0].set_ylabel(example.title, fontsize=9)
        show(of_pair[0, 1], masked_depth(truth.depth), cmap=depth_map, norm=norm)
        note(of_pair[0, 1], f"{norm.vmin:.1f} to {norm.vmax:.0f} m")
        of_pair[1, 1].axis("off")
        show(of_pair[2, 1], normal_image(truth.normal))
        for name, (over, middle, under) in zip(names, of_pair[:, 2:].T, strict=True):
            prediction = example.predictions[name]
            show(over, masked_depth(prediction.depth), cmap=depth_map, norm=norm)
            show_disparity_error(middle, prediction.disparity, truth.disparity, scored, errors)
            if prediction.normal is None:
                under.axis("off")
            else:
                show(under, predicted_normal_image(prediction.normal, prediction.depth))
    for ax, title in zip(axes[0], ["left image", "truth", *names], strict=True):
        ax.set_title(fill(title, TITLE), fontsize=9)
    figure.text(0.36 / width, 0.1 / height, f"depth: bright is near; grey: sky or unknown\n{NORMAL_TITLE}", fontsize=8)
    place = figure.add_axes((1 - (0.3 + 1.5 * PANEL) / width, 0.5 / height, 1.5 * PANEL / width, 0.1 / height))
    bar = figure.colorbar(ScalarMappable(errors, colour_map("inferno")), cax=place, orientation="horizontal")
    label_bar(bar, errors, "error of the disparity [px]")
    save(figure, path)
