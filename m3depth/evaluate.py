"""Score M3Depth, classical stereo and anybody's saved predictions on the same pairs.

    python -m m3depth.evaluate --data DIR --split test --out RESULTS
    python -m m3depth.evaluate --data DIR --out RESULTS --baselines all --degrade contrast=.33,blur=1,noise=2.5
    python -m m3depth.evaluate --data KITTI --split all --out RESULTS
    python -m m3depth.evaluate --data DIR --out RESULTS --estimator Mine=my_stereo:Net --predictions RAFT=out,scale=-1

Writes results.json (every figure), results.md (the tables) and figures: comparison.png and qualitative.png (images,
truth, methods), zoom.png (parts that are hard), error_by_depth.png, error_distribution.png, worst.png (the pairs that
the first method got most wrong), sparsification.png (error left as the least confident pixels are dropped), rocks.png
(found, missed and falsely seen).
Every pixel with true depth from 0.5 to 15 m (in other layouts: every known one, or --depth-range) is scored, whatever
a method says of it; the rules in full are in m3depth/metrics.py, m3depth/rocks.py and m3depth/sparsification.py. Files
of predictions: m3depth/recorded.py.
The same command goes on where it was stopped or killed: what is scored is kept in RESULTS/unfinished.npz till the end.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from m3depth.datasets.config import DataConfig, Part, flag
from m3depth.datasets.open import open_pairs
from m3depth.estimator import CLASSICAL, EstimatorError, EstimatorName, load_estimator
from m3depth.evaluation.example import Example
from m3depth.evaluation.inputs import state_of_files, state_of_pairs
from m3depth.evaluation.recorded_maps import FORM, RecordedError, RecordedPredictions
from m3depth.evaluation.report import markdown_report, text_table
from m3depth.evaluation.resume import Unfinished, UnfinishedError
from m3depth.evaluation.scoring import RESERVED, Evaluation, Method, check_choice, chosen_pairs, evaluate
from m3depth.figures.comparison import comparison_figure
from m3depth.figures.errors import distribution_figure, interval_figure, sparsification_figure
from m3depth.figures.qualitative import qualitative_figure, zoom_figure
from m3depth.figures.rocks import rocks_figure
from m3depth.figures.worst import worst_figure
from m3depth.stereo.degradation import Degradation
from m3depth.stereo.pairs import MAX_DISPARITY, StereoPairs, scored_depths
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.command.notes import counted
from marssim.base.command.progress import watched
from marssim.base.command.run import run_command
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import source_digest, versions

EXAMPLES = 3  # pairs in the figures
COMPARED = 3  # methods in comparison.png, which shows the errors too; all are in qualitative.png

Baseline = Literal["sgbm", "ssd", "sad", "ncc", "ssd-sgm", "sad-sgm", "ncc-sgm", "all", "none"]


@dataclass(frozen=True)
class EvaluateOptions:
    """Score M3Depth and other methods on a dataset of marssim.generate, or of others."""

    data: Path
    """Dataset folder, of marssim.generate or of any layout that --format lists."""
    out: Path
    """Folder for results.json, results.md and the figures; those of an earlier scoring are replaced."""
    split: Part = "test"
    """Which part of the dataset; test is what no training on it has seen, all is for data that none was done on."""
    weights: Path | None = None
    """A .safetensors file written by m3depth.train; default: the weights that come with the package."""
    baselines: tuple[Baseline, ...] = ("sgbm",)
    """Classical methods that are scored on the same pairs. sgbm: OpenCV's semi-global matching; ssd, sad, ncc: windows
    compared by squared or absolute differences or by correlation, best one taken; with -sgm: the same costs, summed
    along eight paths. all: the seven of them. none: no classical method."""
    estimator: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[NAME=]MODULE:CLASS ...")] = ()
    """Further methods: a class without arguments that has infer(left, right, rig), and a name for the table (default:
    the class's)."""
    predictions: Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{FORM} ...")] = ()
    """Maps that other programs wrote: disparity [px], or depth [m] with ",depth"; ",scale=S" if 1 px or 1 m is
    stored as S (-1 for RAFT-Stereo and Pandora, 256 for KITTI's PNG is the default); ",fill" to fill unknown pixels
    from the background. How the files are named: m3depth/recorded.py; recipes: docs/other_methods.md."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """What M3Depth computes on; auto: a GPU if there is one."""
    limit: int | None = None
    """Score only so many pairs, spread evenly over the split."""
    degrade: str | None = None
    """Make the images worse first: any of contrast (a factor), blur (sigma [px]) and noise (sigma [grey levels]), and
    of the right one alone vertical (too low by [px]) and gain (its brightness by the left's), as in
    contrast=.33,blur=1,noise=2.5."""
    seed: int = 0
    """Seed of the noise that --degrade adds."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """How the folder is read."""

    def __post_init__(self) -> None:
        check_choice(self.limit, self.seed)


def run(options: EvaluateOptions, dataset: StereoPairs, methods: Mapping[str, Method]) -> Evaluation:
    """Evaluate, print the table, and write the files into options.out."""
    degradation = None if options.degrade is None else Degradation.parse(options.degrade)
    weights = options.weights or SHIPPED_WEIGHTS
    digest = hashlib.sha256(weights.read_bytes()).hexdigest() if weights.is_file() else None
    from m3depth.network.device import chosen_device

    device = chosen_device(options.device).type
    unfinished = Unfinished(options.out, asked_for(options, dataset, digest, device))
    done = evaluate(
        dataset,
        methods,
        limit=options.limit,
        degradation=degradation,
        seed=options.seed,
        examples=EXAMPLES,
        worst=EXAMPLES,
        progress=partial(_watched, len(dataset) if options.limit is None else min(options.limit, len(dataset))),
        unfinished=unfinished,
    )
    about = {
        "data": str(options.data),
        "data_sha256": getattr(dataset, "digest", None),
        "split": options.split,
        "pairs": len(done.pairs),
        "weights": "shipped" if options.weights is None else str(options.weights),
        "weights_sha256": digest,
        "device": device,
        "degrade": options.degrade,
        "seed": options.seed,
        "depth_range_m": scored_depths(dataset),
        "max_disparity_px": MAX_DISPARITY,
        "versions": versions(),
    }
    found = {"methods": done.results, "true_depth_normals": done.true_depth_normals}
    write_json(options.out / "results.json", {**about, **found, "per_pair": done.pairs}, sort_keys=False)
    write_atomically(options.out / "results.md", markdown_report(about, done.results, done.true_depth_normals).encode())
    draw(done, options.out)
    unfinished.remove()
    print(text_table(done.results))
    print(f"{counted(len(done.pairs), 'pair')}; figures by kind and depth, and pictures, are in {options.out}")
    return done


def asked_for(options: EvaluateOptions, dataset: StereoPairs, weights: str | None, device: str) -> dict[str, Any]:
    """What the figures depend on, by flag; only an evaluation of the same goes on where another was stopped.

    weights: their SHA-256. device: what M3Depth computes on.
    """
    pairs = chosen_pairs(dataset, options.limit)
    recorded = {text: RecordedPredictions.parse(text)[1] for text in options.predictions}
    calib = options.reader.calib
    return {
        "--data": [str(options.data.resolve()), state_of_pairs(dataset)],
        "--split": options.split,
        "--weights": weights,
        "--device": device,
        "--baselines": list(options.baselines),
        "--estimator": [[text, EstimatorName(_split_estimator(text)[1]).digest()] for text in options.estimator],
        "--predictions": [
            [text, state_of_files(maps.find(*pair) for pair in pairs)] for text, maps in recorded.items()
        ],
        "--limit": options.limit,
        "--degrade": options.degrade,
        "--seed": options.seed,
        **{flag(name): str(value) for name, value in options.reader.given().items()},
        **({} if calib is None else {"--calib": [str(calib), state_of_files([calib])]}),
        "state of the code": source_digest(("marssim", "m3depth")),
    }


def _watched(number: int, left: Sequence[int]) -> Iterator[int]:
    """The pairs that are left of so many, and how far one is among them."""
    if len(left) < number:
        print(f"evaluate: {number - len(left)} of {counted(number, 'pair')} are scored already", file=sys.stderr)
    return watched(left, "pair", "evaluate")


def draw(done: Evaluation, out: Path) -> None:
    """Write every figure."""
    comparison_figure(done.examples, out / "comparison.png", most=COMPARED)
    qualitative_figure(done.examples, out / "qualitative.png")
    zoom_figure(done.examples, out / "zoom.png")
    worst_figure(done.worst, out / "worst.png")
    interval_figure(done.results, out / "error_by_depth.png", _common_fb(done.examples))
    distribution_figure(done.results, out / "error_distribution.png")
    sparsification_figure(done.results, out / "sparsification.png")
    rocks_figure({name: result["rocks"] for name, result in done.results.items()}, out / "rocks.png")


def _common_fb(examples: Sequence[Example]) -> float | None:
    """Focal length times baseline [px m] if all examples share it."""
    values = {round(e.truth.rig.fb, 3) for e in examples}
    return values.pop() if len(values) == 1 else None


def prepare(options: EvaluateOptions) -> tuple[StereoPairs, dict[str, Method]]:
    """Open what the options name. Raises ValueError or OSError with one line for the user."""
    dataset = open_pairs(options.data, options.split, options.reader)
    if not len(dataset):
        raise ValueError(f"{options.data}: split {options.split} holds no pairs; choose another --split")
    if options.degrade is not None:
        Degradation.parse(options.degrade)
    if "none" in options.baselines and len(options.baselines) > 1:
        raise ValueError("--baselines none stands alone")
    result_folder(options).check()
    own = "m3depth" if options.weights is None else f"m3depth:{options.weights}"
    methods: dict[str, Method] = {"M3Depth": load_estimator(own, device=options.device)}
    names = CLASSICAL if "all" in options.baselines else options.baselines
    methods |= {name.upper(): load_estimator(name) for name in names if name != "none"}
    for text in options.estimator:
        name, spec = _split_estimator(text)
        _add(methods, "--estimator", text, name, load_estimator(spec, "--estimator", device=options.device))
    for text in options.predictions:
        try:
            name, recorded = RecordedPredictions.parse(text)
        except ValueError as error:
            raise ValueError(f"--predictions {error}") from None
        if not recorded.folder.is_dir():
            raise FileNotFoundError(f"--predictions {text}: {recorded.folder}: no such folder")
        _add(methods, "--predictions", text, name, recorded)
    return dataset, methods


def result_folder(options: EvaluateOptions) -> ResultFolder:
    """Return the folder for the results, which replace those of an earlier scoring."""
    return ResultFolder(options.out, "scoring", results_key="per_pair")


def _split_estimator(text: str) -> tuple[str, str]:
    """Name and module:class, the name being the class's unless another is given."""
    name, equals, spec = text.partition("=")
    if not equals:
        name, spec = text.rpartition(":")[2], text
    if not (name and ":" in spec):
        raise ValueError(f"--estimator {text}: expected MODULE:CLASS or NAME=MODULE:CLASS")
    return name, spec


def _add(methods: dict[str, Method], option: str, text: str, name: str, method: Method) -> None:
    if name in RESERVED or name in methods:
        raise ValueError(f"{option} {text}: the name {name!r} is taken, choose another")
    methods[name] = method


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for."""
    return run_command(_work, EvaluateOptions, "python -m m3depth.evaluate", __doc__, args)


def _work(options: EvaluateOptions) -> None:
    dataset, methods = prepare(options)
    with result_folder(options).claim():
        try:
            run(options, dataset, methods)
        except (DatasetError, EstimatorError, RecordedError, UnfinishedError):
            raise
        except ValueError as error:  # a bug, in here or in a method: show where
            raise RuntimeError(f"scoring failed: {error}") from error


if __name__ == "__main__":
    sys.exit(main())
