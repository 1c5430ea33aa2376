"""The figure of images, their local binary patterns and their spectra, as the paper's first figure of texture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from m3depth.figures.drawing import METHOD_COLOURS, save, show
from marssim.base.images.texture import gradient

GRADIENTS = np.geomspace(0.1, 100, 121)  # [grey levels / px] places of the curves of gradients


@dataclass(frozen=True)
class TextureExample:
    """One image of a group.

    Attributes:
        name: Name of the group.
        grey: (H, W) uint8 image.
        codes: (H - 2, W - 2) uint8 local binary patterns.
        power: (H, W) power spectrum, in the order of np.fft.
        frequency: (H, W) radial frequency [cycles/px], likewise.
        gradient_shares: (len(GRADIENTS),) share of the pixels of all images of the group with less than each of
            GRADIENTS.
    """

    name: str
    grey: np.ndarray
    codes: np.ndarray
    power: np.ndarray
    frequency: np.ndarray
    gradient_shares: np.ndarray


def gradient_shares(grey: np.ndarray) -> np.ndarray:
    """Return the share of the pixels of an image, (H, W) uint8, whose gradient is less than each of GRADIENTS."""
    lengths = np.sort(gradient(grey), axis=None)
    return np.searchsorted(lengths, GRADIENTS) / lengths.size


def texture_figure(
    examples: Sequence[TextureExample], groups: Mapping[str, Any], border: float, path: Path
) -> None:  # fmt: skip
    """Write a PNG with a row a group: an image, patterns, spectrum, energy by frequency, and pixels by gradient.

    Args:
        examples: One image of each group.
        groups: {"mean": figures, "count": number of images} by the group's name.
        border: Frequency at which high frequencies begin [cycles/px].
        path: The file to write.
    """
    figure = Figure(figsize=(17.5, 3.7 * len(examples)), layout="constrained", dpi=110)
    axes = figure.subplots(len(examples), 5, squeeze=False)
    for row, example, colour in zip(axes, examples, METHOD_COLOURS):
        mean = groups[example.name]["mean"]
        show(row[0], example.grey, cmap="gray", vmin=0, vmax=255)
        row[0].set_title(f"{example.name} (1 of {groups[example.name]['count']})", fontsize=10)
        show(row[1], example.codes, cmap="gray", vmin=0, vmax=255)
        bits = f"{mean['lbp_riu2']:.2f} of 10 labels, {mean['lbp_codes']:.2f} bits of codes"
        row[1].set_title(f"local binary patterns; mean entropy\n{bits}", fontsize=9)
        height, width = example.grey.shape
        power = np.log10(example.power / max(example.power.max(), 1e-30) + 1e-9)
        spectrum = show(row[2], np.fft.fftshift(power), cmap="magma", vmin=-8, vmax=0)
        bar = figure.colorbar(spectrum, ax=row[2], fraction=0.046, pad=0.02, extend="min")
        bar.set_label("log10 of the power, largest: 0", fontsize=9)
        row[2].add_patch(
            Ellipse(
                (width // 2, height // 2), 2 * border * width, 2 * border * height, fill=False, color="white", lw=1.2
            )
        )
        row[2].set_title(f"spectrum; circle: {2 * border:g} f_max\nmean energy outside {mean['high']:.1%}", fontsize=9)
        ratio = np.geomspace(2e-3, np.sqrt(2), 300)
        row[3].plot(ratio, 100 * energy_below(example, 10 * border * ratio), color=colour)
        row[3].axvline(0.1, color="0.5", lw=1, ls="--")
        row[3].set_xscale("log")
        row[3].set_xlim(2e-3, 1.5)
        row[3].set_ylim(0, 101)
        row[3].set_xlabel("frequency / f_max")
        row[3].set_ylabel("energy below, without the mean [%]")
        row[3].grid(True, color="0.92")
        _draw_gradients(row[4], examples, example.name, f"poor in texture: {mean['poor']:.1%} of the pixels")
    save(figure, path)


def _draw_gradients(ax: Axes, examples: Sequence[TextureExample], name: str, title: str) -> None:
    """Draw the shares of pixels by gradient of all groups, that of one group in full strength."""
    for example, colour in zip(examples, METHOD_COLOURS):
        strength = 1.0 if example.name == name else 0.35
        ax.plot(GRADIENTS, 100 * example.gradient_shares, color=colour, label=example.name, alpha=strength)
    ax.set_xscale("log")
    ax.set_ylim(0, 101)
    ax.set_xlabel("gradient [grey levels / px]")
    ax.set_ylabel("pixels below [%]")
    ax.set_title(title, fontsize=9)
    ax.grid(True, color="0.92")
    ax.legend(frameon=False, fontsize=9)


def energy_below(example: TextureExample, frequencies: np.ndarray) -> np.ndarray:
    """Return the share of the energy up to each frequency [cycles/px].

    Args:
        example: The image, with its spectrum.
        frequencies: (N,) frequencies [cycles/px].
    """
    order = np.argsort(example.frequency, axis=None)
    total = np.concatenate([[0], np.cumsum(example.power.ravel()[order])])
    upto = np.searchsorted(example.frequency.ravel()[order], frequencies, side="right")
    return total[upto] / max(total[-1], 1e-30)
