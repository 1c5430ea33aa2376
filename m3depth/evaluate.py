"""Score M3Depth and classical stereo on the same pairs.

    python -m m3depth.evaluate --data DIR --split test --out RESULTS
    python -m m3depth.evaluate --data DIR --out RESULTS --baselines sgbm sad ssd ncc --degrade contrast=.33,noise=2.5

Writes results.json (every figure), results.md (the tables), comparison.png and error_by_depth.png.
Every pixel with true depth from 0.5 to 15 m is scored, whatever a method says of it; the rules in full are in
m3depth/metrics.py.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from tqdm import tqdm

from m3depth.degradation import Degradation
from m3depth.estimator import Estimator, load_estimator
from m3depth.figures import Example, comparison_figure, interval_figure
from m3depth.metrics import Scores, StereoTruth
from m3depth.pairs import MAX_DISPARITY, StereoPairs
from m3depth.report import markdown_report, text_table, versions, write_json
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.command import counted, run_command
from marssim.dataset import DatasetError, StereoDataset

EXAMPLES = 3  # pairs in the comparison figure
PAIR_NUMBER = "index"  # field of a pair's record, beside those of the methods


@dataclass
class Evaluation:
    """What `evaluate` found out.

    results: by method, Scores.result() with "seconds" (median and mean per pair) and "median_image" (the median over
    images of the image's figures). pairs: a record per pair with the figures of each method. examples: to be shown.
    """

    results: dict[str, dict[str, Any]]
    pairs: list[dict[str, Any]] = field(default_factory=list)
    examples: list[Example] = field(default_factory=list)


def evaluate(
    dataset: StereoPairs,
    estimators: Mapping[str, Estimator],
    *,
    limit: int | None = None,
    degradation: Degradation | None = None,
    seed: int = 0,
    max_disparity: float = MAX_DISPARITY,
    examples: int = 0,
    progress: Callable[[Sequence[int]], Any] | None = None,
) -> Evaluation:
    """Score every method on the same pairs.

    dataset: samples with ground truth. estimators: by the name they are reported under. limit: score only so many
    pairs, spread evenly over the dataset. degradation: applied to the images first; its noise depends on (seed, index)
    alone. max_disparity [px]: nearer pixels are scored apart. examples: so many pairs are kept to be shown. progress:
    wraps the indices that are walked through, as tqdm does. Besides the examples, memory grows by a few numbers a pair.
    Raises ValueError if there is nothing to score or a method returns maps of another size.
    """
    if not len(dataset):
        raise ValueError("the dataset holds no pairs")
    if not estimators:
        raise ValueError("no estimator to score")
    if PAIR_NUMBER in estimators:
        raise ValueError(f"no method may be called {PAIR_NUMBER!r}: the records of the pairs keep their number there")
    if limit is not None and limit < 1:
        raise ValueError(f"limit must be at least 1, got {limit}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    chosen = _spread(len(dataset), len(dataset) if limit is None else limit)
    shown = {chosen[i] for i in _spread(len(chosen), examples)} if examples else set()
    scores = {name: Scores(max_disparity) for name in estimators}
    out = Evaluation({})
    for index in progress(chosen) if progress else chosen:
        sample = dataset[index]
        left, right = sample.left, sample.right
        if degradation is not None:
            rng = np.random.default_rng((seed, index))
            left, right = degradation.apply(left, rng), degradation.apply(right, rng)
        record: dict[str, Any] = {PAIR_NUMBER: index}
        predictions = {}
        for name, estimator in estimators.items():
            start = time.perf_counter()
            prediction = estimator.infer(left, right, sample.rig)
            seconds = time.perf_counter() - start
            try:
                record[name] = {**scores[name].add(prediction, sample), "seconds": seconds}
            except ValueError as error:
                raise ValueError(f"{name}, pair {index}: {error}") from None
            if index in shown:
                predictions[name] = prediction
        out.pairs.append(record)
        if index in shown:
            out.examples.append(Example(index, left, right, sample, predictions))
    for name, score in scores.items():
        out.results[name] = {**score.result(), **_over_images([record[name] for record in out.pairs])}
    return out


def _spread(count: int, wanted: int) -> list[int]:
    """At most `wanted` of range(count), evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(wanted, count)).round().astype(int)).tolist()


def _over_images(records: list[dict[str, float]]) -> dict[str, Any]:
    seconds = [record["seconds"] for record in records]
    names = sorted({name for record in records for name in record} - {"seconds"})
    medians = {name: float(np.median([r[name] for r in records if name in r])) for name in names}
    return {"median_image": medians, "seconds": {"median": float(np.median(seconds)), "mean": float(np.mean(seconds))}}


@dataclass(frozen=True)
class EvaluateOptions:
    """Score M3Depth and classical baselines on a dataset made by marssim.generate."""

    data: Path
    """Dataset folder, as marssim.generate writes it."""
    out: Path
    """Folder for results.json, results.md and the figures."""
    split: Literal["train", "val", "test"] = "test"
    """Which part of the dataset; test is what no training has seen."""
    weights: Path | None = None
    """A .safetensors file written by m3depth.train; default: the weights that come with the package."""
    baselines: tuple[Literal["sgbm", "sad", "ssd", "ncc", "none"], ...] = ("sgbm",)
    """Classical methods that are scored on the same pairs. sgbm: OpenCV's semi-global matching; sad, ssd, ncc: windows
    compared by absolute or squared differences or by correlation, best one taken. none: M3Depth alone."""
    estimator: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=MODULE:CLASS ...")] = ()
    """Further methods: a name for the table, and a class without arguments that has infer(left, right, rig)."""
    limit: int | None = None
    """Score only so many pairs, spread evenly over the split."""
    degrade: str | None = None
    """Make the images worse first: any of contrast (a factor), blur (sigma [px]) and noise (sigma [grey levels]),
    as in contrast=.33,blur=1,noise=2.5."""
    seed: int = 0
    """Seed of the noise that --degrade adds."""


def run(options: EvaluateOptions, dataset: StereoPairs, estimators: Mapping[str, Estimator]) -> Evaluation:
    """Evaluate, print the table, and write the files into options.out."""
    degradation = None if options.degrade is None else Degradation.parse(options.degrade)
    weights = options.weights or SHIPPED_WEIGHTS
    digest = hashlib.sha256(weights.read_bytes()).hexdigest() if weights.is_file() else None
    options.out.mkdir(parents=True, exist_ok=True)
    done = evaluate(
        dataset,
        estimators,
        limit=options.limit,
        degradation=degradation,
        seed=options.seed,
        examples=EXAMPLES,
        progress=lambda indices: tqdm(indices, desc="evaluate", unit="pair", disable=not sys.stderr.isatty()),
    )
    about = {
        "data": str(options.data),
        "data_sha256": getattr(dataset, "digest", None),
        "split": options.split,
        "pairs": len(done.pairs),
        "weights": "shipped" if options.weights is None else str(options.weights),
        "weights_sha256": digest,
        "degrade": options.degrade,
        "seed": options.seed,
        "max_disparity_px": MAX_DISPARITY,
        "versions": versions(),
    }
    write_json(options.out / "results.json", {**about, "methods": done.results, "per_pair": done.pairs})
    (options.out / "results.md").write_text(markdown_report(about, done.results))
    comparison_figure(done.examples, options.out / "comparison.png")
    interval_figure(done.results, options.out / "error_by_depth.png", _common_fb(done.examples))
    print(text_table(done.results))
    print(f"{counted(len(done.pairs), 'pair')}; figures by kind and depth, and pictures, are in {options.out}")
    return done


def _common_fb(examples: Sequence[Example]) -> float | None:
    """Focal length times baseline [px m] if all examples share it."""
    truths: list[StereoTruth] = [e.truth for e in examples]
    values = {round(t.rig.fb, 3) for t in truths}
    return values.pop() if len(values) == 1 else None


def prepare(options: EvaluateOptions) -> tuple[StereoDataset, dict[str, Estimator]]:
    """Open what the options name. Raises ValueError or OSError with one line for the user."""
    dataset = StereoDataset(options.data, options.split)
    if not len(dataset):
        raise ValueError(f"{options.data}: split {options.split} holds no pairs; choose another --split")
    if options.limit is not None and options.limit < 1:
        raise ValueError(f"--limit must be at least 1, got {options.limit}")
    if options.seed < 0:
        raise ValueError(f"--seed must not be negative, got {options.seed}")
    if options.degrade is not None:
        Degradation.parse(options.degrade)
    if options.out.exists() and not options.out.is_dir():
        raise ValueError(f"--out {options.out}: is not a folder")
    estimators = {"M3Depth": load_estimator("m3depth" if options.weights is None else f"m3depth:{options.weights}")}
    estimators |= {name.upper(): load_estimator(name) for name in options.baselines if name != "none"}
    for text in options.estimator:
        name, equals, spec = text.partition("=")
        if not (name and equals and spec):
            raise ValueError(f"--estimator {text}: expected NAME=MODULE:CLASS")
        if name == PAIR_NUMBER or name in estimators:
            raise ValueError(f"--estimator {text}: the name {name!r} is taken, choose another")
        estimators[name] = load_estimator(spec, "--estimator")
    return dataset, estimators


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for."""
    return run_command(_work, EvaluateOptions, "python -m m3depth.evaluate", __doc__, args, "nothing was written")


def _work(options: EvaluateOptions) -> None:
    dataset, estimators = prepare(options)
    try:
        run(options, dataset, estimators)
    except DatasetError:
        raise
    except ValueError as error:  # a bug, in here or in a method: show where
        raise RuntimeError(f"scoring failed: {error}") from error


if __name__ == "__main__":
    sys.exit(main())
