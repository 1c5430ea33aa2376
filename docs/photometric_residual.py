"""Measures the photometric residual of methods and of the true disparity on pairs with ground truth.

    python docs/photometric_residual.py --data data/gravel data/gale --split all --limit 6 --out out/residual

Real Mars images have no true depth, and the photometric residual is what m3depth.evaluate scores there. On rendered
pairs, this command says how far the residual of a method is from that of the truth itself, which is not zero: pixels
are noisy, and a surface does not look the same to both cameras. For each dataset, --out gets residual.json and
residual.md with the residual of each method and of the truth over that of SGBM, on the pixels that SGBM matched, the
mean over pairs, with 95 % intervals of a bootstrap over the scenes where there are several. Rows of the images that
lie significantly apart are aligned first.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from m3depth.datasets.config import DataConfig, Split
from m3depth.datasets.open import open_pairs
from m3depth.estimator import Estimator, EstimatorName, distinct_labels, load_estimator
from m3depth.evaluation.bootstrap import mean_interval
from m3depth.evaluation.without_truth.photometric import residuals
from m3depth.runtimes.choice import recorded_runtime
from m3depth.stereo.classical import SGBM
from m3depth.stereo.pairs import scene_name, spread
from m3depth.stereo.rows import align_rows
from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json
from marssim.base.results.code_state import versions

TRUTH = "truth"  # the name of the true disparity among the methods


@dataclass(frozen=True)
class Options:
    """Measures the photometric residual of methods and of the true disparity on pairs with ground truth."""

    data: tuple[Path, ...]
    """Datasets with ground truth; the table has a row for each."""
    out: Path
    """Folder for residual.json and residual.md."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """Settings of the dataset reader."""
    estimator: tuple[str, ...] = ("m3depth", "sgbm-hh")
    """Methods, as --estimator of m3depth.evaluate names them."""
    split: Split = "test"
    """Split of the datasets."""
    limit: int = 20
    """Largest number of pairs of each dataset, 1 or more, spread evenly over the split."""

    def __post_init__(self) -> None:
        check_least(self, limit=1)
        if not self.data or not self.estimator:
            raise ValueError(f"{'data' if not self.data else 'estimator'} must name at least one")


def ratios(sample: Any, methods: Mapping[str, Estimator]) -> dict[str, float]:
    """Return the residual over SGBM's of each method and of the truth, NaN where they share no pixel with SGBM."""
    left, rig = sample.left, sample.rig
    right, fit = align_rows(left, sample.right, rig)
    # of the aligned pair, whose right camera is the ideal one
    true_disparity = sample.disparity if fit is None else rig.depth_to_disparity(sample.depth)
    matched = residuals(left, right, SGBM().match(left, right, rig))
    disparities = {name: method.infer(left, right, rig).disparity for name, method in methods.items()}
    ratio_of = {}
    for name, disparity in {**disparities, TRUTH: true_disparity}.items():
        residual = residuals(left, right, np.where(disparity > 0, disparity, np.float32(np.nan)))
        shared = np.isfinite(residual) & np.isfinite(matched)
        ratio_of[name] = float(residual[shared].mean() / matched[shared].mean()) if shared.any() else np.nan
    return ratio_of


def measure(folder: Path, options: Options, methods: Mapping[str, Estimator]) -> dict[str, Any]:
    """Return the number of pairs and of scenes of a dataset, and the mean ratio of each method with its interval.

    Pairs in which a method shares no pixel with SGBM are left out of its mean.

    Raises:
        ValueError: The split holds no pairs, or a method shares no pixel with SGBM in any of them.
    """
    pairs = open_pairs(folder, options.split, options.reader)
    chosen = spread(len(pairs), options.limit)
    if not chosen:
        raise ValueError(f"--data {folder}: split {options.split} holds no pairs")
    rows = [ratios(pairs[index], methods) for index in chosen]
    scenes = [scene_name(pairs, index) for index in chosen]
    of_methods = {}
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        ratio, bounds = mean_interval(values, scenes, within=(0, np.inf))
        if ratio is None:
            raise ValueError(f"--data {folder}: {name} and SGBM measure no pixel together in any pair")
        of_methods[name] = {"ratio": ratio, "interval": bounds}
    return {"data": str(folder), "pairs": len(rows), "scenes": len(set(scenes)), "methods": of_methods}


def table(content: Sequence[Mapping[str, Any]]) -> str:
    """Return the Markdown table, a row for each dataset."""
    names = [*content[0]["methods"]]
    lines = [f"| pairs | {' | '.join(names)} |", "|---" * (1 + len(names)) + "|"]
    for row in content:
        cells = (row["methods"][name] for name in names)
        shown = [
            f"{cell['ratio']:.3f}" + (" ({:.3f} to {:.3f})".format(*cell["interval"]) if cell["interval"] else "")
            for cell in cells
        ]
        lines.append(f"| {Path(row['data']).name} | {' | '.join(shown)} |")
    return "\n".join(lines) + "\n"


def work(options: Options) -> None:
    """Measure, and write the numbers and the table."""
    names = [EstimatorName.parse(text, "--estimator") for text in options.estimator]
    methods = dict(zip(distinct_labels(names), map(load_estimator, options.estimator), strict=True))
    about = {
        "split": options.split,
        "estimators": {
            label: {"name": name.form, "sha256": name.digest()} for label, name in zip(methods, names, strict=True)
        },
        "runtime": recorded_runtime([name.name for name in names]),
        "versions": versions(),
    }
    content = [measure(folder, options, methods) for folder in options.data]
    options.out.mkdir(parents=True, exist_ok=True)
    write_json(options.out / "residual.json", {**about, "datasets": content}, sort_keys=False)
    write_atomically(options.out / "residual.md", table(content).encode())
    print(table(content), end="")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/photometric_residual.py", __doc__, args, STARTS_OVER)


if __name__ == "__main__":
    sys.exit(main())
