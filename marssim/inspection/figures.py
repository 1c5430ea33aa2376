"""Figures of a dataset: one sample with all its ground truth, and the statistics of many.

They are drawn with matplotlib's object interface, which needs no display and keeps no global state.
"""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from marssim.base.camera import MAX_DEPTH
from marssim.base.dataset.sample import StereoSample
from marssim.base.images.colours import (
    DEPTH_MAP,
    DISPARITY_MAP,
    NORMAL_TITLE,
    depth_colours,
    depth_ticks,
    normal_colours,
)
from marssim.inspection.statistics import DEPTH_STEP, NETWORK_DISPARITY, SampleStatistics, noted_number

SHOWN_DEPTH = 40.0  # right end of the depth plot [m]
COLOURS = {"all": "0.25", "train": "#0072b2", "val": "#d55e00", "test": "#009e73"}  # of the splits; by Okabe and Ito
RESIDUAL_END = 30.0  # bright end of the residual's colours [grey levels]


def warped(image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Return the right image as the left eye would see it, sampled linearly at column u - disparity.

    Args:
        image: (H, W, 3) right image.
        disparity: (H, W) of the left eye [px].

    Returns:
        (H, W, 3) float32.
    """
    width = disparity.shape[1]
    at = np.clip(np.arange(width) - disparity, 0, width - 1)
    left = np.minimum(at.astype(int), width - 2)
    share = (at - left)[..., None]
    row = np.arange(len(disparity))[:, None]
    return ((1 - share) * image[row, left] + share * image[row, left + 1]).astype(np.float32)


def warp_residual(sample: StereoSample) -> np.ndarray:
    """Return how much the left image differs from the warped right one.

    Returns:
        (H, W) float32 [grey levels], mean of |left - warped right| over the colours; NaN in the sky and where occluded.
    """
    difference = np.abs(warped(sample.right, sample.disparity) - sample.left).mean(axis=-1)
    difference[sample.occluded | ~np.isfinite(sample.depth)] = np.nan
    return difference


def sample_figure(sample: StereoSample, name: str) -> bytes:
    """Draw a sample: both eyes, depth, disparity, normals, surfaces, occlusion and the residual of warping.

    Args:
        sample: The sample.
        name: Its name, for the title.

    Returns:
        A PNG file.
    """
    height, width = sample.depth.shape
    figure = Figure(figsize=(16, 8.6 * height / width + 0.4), dpi=100, layout="constrained")
    axes = figure.subplots(2, 4)
    sky = ~np.isfinite(sample.depth)
    residual = warp_residual(sample)
    meta = sample.meta
    _image(axes[0, 0], sample.left, "left eye")
    _image(axes[0, 1], sample.right, "right eye")
    ticks = depth_ticks([sample.depth])
    near, far = ticks[0], ticks[-1]
    _image(axes[0, 2], depth_colours(sample.depth, near, far), f"depth [m], grey beyond {far:g} m")
    scale = ScalarMappable(LogNorm(near, far), DEPTH_MAP)
    bar = figure.colorbar(scale, ax=axes[0, 2], shrink=0.8, ticks=ticks, format="%g")
    bar.ax.yaxis.set_minor_locator(NullLocator())
    shown = axes[0, 3].imshow(np.where(sky, np.nan, sample.disparity), cmap=DISPARITY_MAP, interpolation="nearest")
    _bare(axes[0, 3], "disparity [px]")
    figure.colorbar(shown, ax=axes[0, 3], shrink=0.8)
    _image(axes[1, 0], normal_colours(sample.normal), NORMAL_TITLE)
    bodies = len(np.unique(sample.rock[sample.rock > 0]))
    _image(axes[1, 1], _surface_colours(sample), f"surfaces: {bodies} rocks and slabs, ground, sky")
    occluded = (0.45 * sample.left).astype(np.uint8)
    occluded[sample.occluded] = (255, 140, 0)
    _image(
        axes[1, 2], occluded, f"hidden from the right eye: {sample.occluded[~sky].mean() if (~sky).any() else 0:.1%}"
    )
    shown = axes[1, 3].imshow(residual, cmap="magma", vmin=0, vmax=RESIDUAL_END, interpolation="nearest")
    axes[1, 3].set_facecolor("0.8")
    middle = f", median {np.nanmedian(residual):.1f}" if np.isfinite(residual).any() else ""
    _bare(axes[1, 3], f"|left - warped right| [grey levels]{middle}")
    figure.colorbar(shown, ax=axes[1, 3], shrink=0.8)
    elevation = noted_number(meta.get("sun_elevation_deg"), -90, 90)
    sun = "" if elevation is None else f", sun {elevation:.0f} deg"
    figure.suptitle(f"{name}  {meta.get('preset', '')}{sun}")
    return _png(figure)


def statistics_figure(statistics: dict[str, SampleStatistics], title: str) -> bytes:
    """Draw the distributions of depth and disparity, and shares of surfaces, texture, sun and rocks, by split.

    Args:
        statistics: By split, "all" among them, which is not drawn if there is only one split.
        title: Title of the figure.

    Returns:
        A PNG file.
    """
    statistics = {name: part for name, part in statistics.items() if part.samples}
    if len(statistics) == 2:
        statistics.pop("all", None)
    figure = Figure(figsize=(14, 8), dpi=100, layout="constrained")
    axes = figure.subplots(2, 3)
    _depth_plot(axes[0, 0], statistics)
    for name, part in statistics.items():
        share = part.disparity / max(1, part.disparity.sum())
        axes[0, 1].stairs(share * 100, np.arange(len(share) + 1), color=COLOURS[name], label=name)
    axes[0, 1].axvline(NETWORK_DISPARITY, color="0.6", linestyle=":")
    axes[0, 1].set(xlabel="disparity of valid pixels [px]", ylabel="share of pixels in a bin of 1 px [%]")
    if any(part.disparity.any() for part in statistics.values()):  # a logarithmic axis needs a share above 0
        axes[0, 1].set_yscale("log")
    _share_plot(axes[0, 2], statistics)
    for name, part in statistics.items():
        axes[1, 0].scatter(part.gradients, part.lbp, s=10, color=COLOURS[name], label=name)
    axes[1, 0].set(xlabel="mean gradient [grey levels / px]", ylabel="LBP entropy [bits]")
    whole = statistics.get("all") or next(iter(statistics.values()))
    axes[1, 1].hist(whole.sun_elevation_deg, bins=np.arange(0, 91, 5).tolist(), color="0.5")
    axes[1, 1].set(xlabel="sun elevation [deg]", ylabel="number of samples")
    axes[1, 1].yaxis.get_major_locator().set_params(integer=True)
    _cover_plot(axes[1, 2], whole)
    axes[0, 0].legend(fontsize=8)
    figure.suptitle(title)
    return _png(figure)


def _depth_plot(axes: Axes, statistics: dict[str, SampleStatistics]) -> None:
    distance = np.arange(0, SHOWN_DEPTH + DEPTH_STEP / 2, DEPTH_STEP)
    for name, part in statistics.items():
        axes.plot(distance, 100 * part.share_within(distance), color=COLOURS[name], label=name)
    whole = statistics.get("all") or next(iter(statistics.values()))
    counts = whole.depth[: len(distance) - 1]
    other = axes.twinx()
    other.stairs(100 * counts / max(1, whole.depth.sum()), distance, fill=True, color="0.85")
    other.set_ylabel(f"share of pixels in a bin of {DEPTH_STEP:g} m [%]", color="0.5")
    axes.set_zorder(other.get_zorder() + 1)
    axes.patch.set_visible(False)
    within = 100 * float(whole.share_within(np.array([MAX_DEPTH]))[0])
    axes.axvline(MAX_DEPTH, color="0.6", linestyle=":")
    axes.axhline(within, color="0.6", linestyle=":")
    axes.set(
        xlabel="depth [m]",
        ylabel="share of pixels up to this depth, without sky [%]",
        xlim=(0, SHOWN_DEPTH),
        ylim=(0, 100),
    )
    axes.set_title(f"{within:.1f} % within {MAX_DEPTH:g} m", fontsize=10)


def _share_plot(axes: Axes, statistics: dict[str, SampleStatistics]) -> None:
    kinds = ("valid", "sky", "occluded", "rock")
    for place, (name, part) in enumerate(statistics.items()):
        report = part.report()
        height = 0.8 / len(statistics)
        at = np.arange(len(kinds)) + (place - (len(statistics) - 1) / 2) * height
        axes.barh(at, [100 * report[kind] for kind in kinds], height=height, color=COLOURS[name], label=name)
    axes.set_yticks(range(len(kinds)), kinds)
    axes.invert_yaxis()
    axes.set_xlabel("share of pixels [%]")


def _cover_plot(axes: Axes, whole: SampleStatistics) -> None:
    report = whole.cover.report()
    if report:
        axes.plot(report["diameters_m"], np.multiply(report["seen"], 100), "o-", color="0.25", label="seen")
        axes.plot(report["diameters_m"], np.multiply(report["asked"], 100), "x:", color="#d55e00", label="asked for")
        axes.legend(fontsize=8)
        axes.set_ylim(0)
    axes.set(xlabel="rock diameter D [m]", ylabel="share of ground under rocks of D and more [%]")


def _surface_colours(sample: StereoSample) -> np.ndarray:
    """Return a colour for each rock, the same in every view; grey ground, black sky, blue rover."""
    rng = np.random.default_rng(1)
    palette = rng.integers(60, 256, (997, 3)).astype(np.uint8)
    out = palette[sample.rock % len(palette)]
    out[sample.rock == 0] = 110
    out[sample.rock < 0] = (60, 90, 200)
    out[~np.isfinite(sample.depth)] = 0
    return out


def _image(axes: Axes, image: np.ndarray, title: str) -> None:
    axes.imshow(image, interpolation="nearest")
    _bare(axes, title)


def _bare(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])


def _png(figure: Figure) -> bytes:
    canvas = FigureCanvasAgg(figure)
    out = io.BytesIO()
    canvas.print_png(out)
    return out.getvalue()
