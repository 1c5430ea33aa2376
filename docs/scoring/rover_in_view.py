"""Abs Rel of an ablation's networks without the pixels of the rover itself, on the test pairs that show it.

    python docs/scoring/rover_in_view.py --data data/wide --runs out/lite/runs --out out/rover.json

The loss of `lite` counts the rover a tenth, and it is nearer than nearly all ground. So a few pairs with large errors
on it decide the means of tables that score every pixel. Pairs without the rover have the Abs Rel of those tables.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from m3depth.evaluation.metrics import capped_depth, pixel_kinds
from m3depth.network.model import M3Depth
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import StereoSample
from marssim.base.files.json_file import DatasetError, write_json

DIGITS = 6  # significant digits of a figure


@dataclass(frozen=True)
class Options:
    """Score the networks of an ablation without the rover."""

    data: Path
    """Dataset of marssim whose test split the ablation was scored on."""
    runs: Path
    """Folder of the ablation's runs, with their weights."""
    out: Path
    """JSON file to write: for each run and each pair that shows the rover, Abs Rel without and on the rover."""


def errors_of(sample: StereoSample, depth: np.ndarray) -> dict[str, float]:
    """Return the Abs Rel of a prediction without the rover and on it, and the number of the rover's scored pixels.

    Args:
        sample: A pair that shows the rover.
        depth: (H, W) predicted depth [m].
    """
    kinds = pixel_kinds(sample)
    scored, rover = kinds["all"], kinds["rover"]
    error = np.abs(capped_depth(depth) / capped_depth(sample.depth) - 1)
    figures = {"abs_rel": error[scored & ~rover].mean(), "rover_abs_rel": error[rover].mean()}
    rounded = {name: float(f"{value:.{DIGITS}g}") for name, value in figures.items()}
    return {**rounded, "rover_pixels": int(rover.sum())}


def work(options: Options) -> None:
    """Write the file."""
    pairs = StereoDataset(options.data, "test")
    samples = {
        name: sample for name, sample in zip(pairs.names, pairs, strict=True) if pixel_kinds(sample)["rover"].any()
    }
    runs = sorted(path.parent for path in options.runs.glob("*/weights.safetensors"))
    if not runs:
        raise DatasetError(f"--runs {options.runs}: holds no run with weights.safetensors")
    scores = {}
    for run in runs:
        network = M3Depth.from_pretrained(run / "weights.safetensors")
        scores[run.name] = {
            name: errors_of(sample, network.infer(sample.left, sample.right, sample.rig).depth)
            for name, sample in samples.items()
        }
    write_json(options.out, scores)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(work, Options, "python docs/scoring/rover_in_view.py", __doc__, args, STARTS_OVER)


if __name__ == "__main__":
    sys.exit(main())
