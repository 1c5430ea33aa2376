"""Measures how the error of disparity falls from refinement step to refinement step.

    python docs/refinement_steps.py --data data/gale data/gusev --split all --out out/steps --weights shipped \\
        runs/raft-stereo/weights.safetensors

The weights are those of M3Depth, RAFT-Stereo, Selective-Stereo or CREStereo. For each step, --out gets the mean error
of disparity (EPE) over the pairs, of non-occluded pixels, which both cameras see, and of occluded ones, with 95 %
intervals of a bootstrap over the scenes: in steps.json, in steps.md and as a picture, steps.png. "first map" is the
disparity before any step. "result" is what M3Depth makes of the last step: it corrects its map at 1/2 of the images'
size. The pixels and their errors are those of m3depth.evaluate; a pixel without a disparity counts as disparity 0.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from m3depth.datasets.config import DataConfig, Split
from m3depth.datasets.open import open_pairs
from m3depth.estimator import EstimatorName, distinct_labels
from m3depth.evaluation.bootstrap import mean_interval
from m3depth.evaluation.metrics import pixel_kinds
from m3depth.figures.drawing import method_styles, save
from m3depth.kinds.networks import load_network
from m3depth.network.stereo_network import StereoNetwork
from m3depth.stereo.pairs import pair_name, scene_name, spread
from m3depth.stereo.prediction import StepMap
from m3depth.training.samples import JoinedPairs
from m3depth.weights import weights_file
from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json

KINDS = {"visible": "non-occluded", "occluded": "occluded"}
"""The kinds of pixels of m3depth.evaluation.metrics.pixel_kinds, with their names here."""
FIRST = "first map"  # the name of a StepMap before any step


@dataclass(frozen=True)
class Options:
    """Measures how the error of disparity falls from refinement step to refinement step."""

    data: tuple[Path, ...]
    """Datasets with ground truth, whose pairs are averaged over."""
    out: Path
    """Folder for steps.json, steps.md and steps.png."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """Settings of the dataset reader."""
    weights: tuple[Path, ...] = (Path("shipped"),)
    """Weights, each a .safetensors file, or the word shipped for those of the package."""
    split: Split = "test"
    """Split of the datasets."""
    limit: int = 100
    """Largest number of pairs, 1 or more, spread evenly over the split."""

    def __post_init__(self) -> None:
        check_least(self, limit=1)
        if not self.data or not self.weights:
            raise ValueError(f"{'data' if not self.data else 'weights'} must name at least one path")


def load_networks(options: Options) -> dict[str, StereoNetwork]:
    """Return the networks by their label.

    Raises:
        ValueError: One of them does not refine its disparity step by step.
    """
    files = [weights_file(path) for path in options.weights]
    networks = [load_network(path) for path in files]
    for path, network in zip(options.weights, networks):
        if not network.takes_steps:
            raise ValueError(f"--weights {path}: {network.config.KIND} does not refine disparity step by step")
    labels = distinct_labels([EstimatorName(f"m3depth:{path}") for path in files])
    return dict(zip(labels, networks, strict=True))


def errors(disparity: np.ndarray, sample: Any) -> list[float]:
    """Return the mean absolute error [px] of each of KINDS, NaN where a pair has no such pixel.

    Args:
        disparity: (H, W) [px]; NaN where it is unknown.
        sample: The ground truth.
    """
    off = np.abs(np.nan_to_num(disparity) - sample.disparity)
    kinds = pixel_kinds(sample)
    return [float(off[kinds[kind]].mean()) if kinds[kind].any() else np.nan for kind in KINDS]


def titles(steps: Sequence[StepMap]) -> list[str]:
    """Return the names of steps, with the size of the images where they are not all taken at one size."""
    several = len({step.working_size for step in steps}) > 1
    return [f"{step.name}, {step.working_size[1]} px wide" if several else step.name for step in steps]


def measure(options: Options) -> tuple[dict[str, dict[str, np.ndarray]], list[str]]:
    """Return the errors by network and step, each (pairs, KINDS) [px], and the scene of each pair.

    Raises:
        ValueError: The split holds no pairs, or a network takes other steps on some pairs than on others.
    """
    networks = load_networks(options)
    parts = [open_pairs(folder, options.split, options.reader) for folder in options.data]
    pairs = JoinedPairs(parts)
    scenes = [  # each dataset has its own, whatever its folder is called
        f"{folder}/{scene_name(part, index)}" for folder, part in zip(options.data, parts) for index in range(len(part))
    ]
    chosen = spread(len(pairs), options.limit)
    if not chosen:
        raise ValueError(f"--data {' '.join(map(str, options.data))}: split {options.split} holds no pairs")
    rows: dict[str, dict[str, list[list[float]]]] = {label: {} for label in networks}
    for index in chosen:
        sample = pairs[index]
        for label, network in networks.items():
            steps = network.infer_steps(sample.left, sample.right, sample.rig)
            by_step = dict(zip(titles(steps), (errors(step.disparity, sample) for step in steps), strict=True))
            if rows[label] and rows[label].keys() != by_step.keys():
                raise ValueError(
                    f"{pair_name(pairs, index)}: is not of the size of the first pair; give pairs of one size"
                )
            for title, values in by_step.items():
                rows[label].setdefault(title, []).append(values)
    arrays = {label: {step: np.array(values) for step, values in steps.items()} for label, steps in rows.items()}
    return arrays, [scenes[index] for index in chosen]


def summary(errors_of: np.ndarray, scenes: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the mean of each of KINDS and its interval, None for fewer than four scenes, by its name here.

    Args:
        errors_of: (pairs, KINDS) [px].
        scenes: (pairs,) the scene of each pair.
    """
    means: dict[str, dict[str, Any]] = {}
    for column, name in zip(errors_of.T, KINDS.values(), strict=True):
        mean, bounds = mean_interval(column, scenes, within=(0, np.inf))
        means[name] = {"epe_px": mean, "interval": bounds}
    return means


def table(content: dict[str, dict[str, dict[str, dict[str, Any]]]]) -> str:
    """Return the Markdown table of all networks and steps; content: summary() by network and step."""
    lines = ["| network | step | EPE, non-occluded [px] | EPE, occluded [px] |", "|---|---|---:|---:|"]
    for label, steps in content.items():
        for step, by_kind in steps.items():
            cells = []
            for value in by_kind.values():
                bounds = value["interval"]
                mean = "-" if value["epe_px"] is None else f"{value['epe_px']:.3f}"
                cells.append(f"{mean} ({bounds[0]:.3f} to {bounds[1]:.3f})" if bounds else mean)
            lines.append(f"| {label} | {step} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def steps_figure(content: dict[str, dict[str, dict[str, dict[str, Any]]]], path: Path) -> None:
    """Write a PNG of the errors over the steps; content: summary() by network and step."""
    figure = Figure(figsize=(12, 4.4), layout="constrained", dpi=100)
    for ax, name in zip(figure.subplots(1, 2), KINDS.values()):
        for (label, steps), style in zip(content.items(), method_styles()):
            begin = 0 if next(iter(steps)).startswith(FIRST) else 1
            values = [by_kind[name]["epe_px"] for by_kind in steps.values()]
            drawn = [(i, value) for i, value in enumerate(values, begin) if value]  # the scale has no 0
            ax.plot([i for i, _ in drawn], [value for _, value in drawn], label=label, ms=5, **style)
        ax.set_yscale("log")
        ax.yaxis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
        for set_formatter in (ax.yaxis.set_major_formatter, ax.yaxis.set_minor_formatter):
            set_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_xlabel("refinement step; 0: the first map")
        ax.set_ylabel(f"EPE, {name} [px]")
        ax.grid(True, which="both", color="0.9")
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(frameon=False)
    save(figure, path)


def work(options: Options) -> None:
    """Measure, and write the numbers and the picture."""
    measured, scenes = measure(options)
    content = {
        label: {step: summary(rows, scenes) for step, rows in steps.items()} for label, steps in measured.items()
    }
    options.out.mkdir(parents=True, exist_ok=True)
    settings = {
        "data": [*map(str, options.data)], "split": options.split, "pairs": len(scenes), "scenes": len(set(scenes)),
    }  # fmt: skip
    write_json(options.out / "steps.json", {**settings, "networks": content}, sort_keys=False)
    write_atomically(options.out / "steps.md", table(content).encode())
    steps_figure(content, options.out / "steps.png")
    print(table(content), end="")
    print(f"{counted(len(scenes), 'pair')}; the picture is {options.out / 'steps.png'}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/refinement_steps.py", __doc__, args, STARTS_OVER)


if __name__ == "__main__":
    sys.exit(main())
