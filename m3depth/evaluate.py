"""Score M3Depth, classical stereo and anybody's saved predictions on the same pairs.

    python -m m3depth.evaluate --data DIR --split test --out RESULTS
    python -m m3depth.evaluate --data DIR --out RESULTS --weights RUN_A/weights.safetensors RUN_B/weights.safetensors
    python -m m3depth.evaluate --data DIR --out RESULTS --baselines all --degrade contrast=.33,blur=1,noise=2.5
    python -m m3depth.evaluate --data KITTI --split all --out RESULTS
    python -m m3depth.evaluate --data DIR --out RESULTS --estimator Mine=my_stereo:Net --predictions RAFT=out,scale=-1
    python -m m3depth.evaluate --data DIR --left 'left/*.png' --right 'right/*.png' --calib calib.yml --out RESULTS

The command writes results.json (every figure), results.md (the tables) and these figures: comparison.png and
qualitative.png (images, truth, methods), zoom.png (the hardest parts), error_by_depth.png, error_distribution.png,
worst.png (the pairs with the largest error of the first method), sparsification.png (the error that is left as the
least confident pixels are dropped), rocks.png (found, missed, and predicted where none are).

Every pixel with true depth from 0.5 to 15 m (in other layouts: every known one, or --depth-range) is scored, whatever a
method predicts there. The rules are in m3depth/evaluation/metrics.py, rock_scores.py and sparsification.py, the form of
saved predictions in m3depth/evaluation/recorded_maps.py.

Pairs without true depth, as in the last line, are scored by what they say themselves: how far the eyes agree, and how
well the disparity explains the right image beside SGBM's. Without --calib, the rig.json of m3depth.rectify beside a
left image is its calibration. The only figure is then qualitative.png: the left image, and depth and normals of every
method, of up to three pairs.

The same command continues after it was stopped or killed: until the end, RESULTS/unfinished.npz holds what is scored.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from m3depth.datasets.config import DataConfig, Split, flag
from m3depth.datasets.depth_check import depth_misfit
from m3depth.datasets.labels import NO_NORMALS
from m3depth.datasets.open import open_pairs
from m3depth.datasets.state import state_of_files, state_of_pairs
from m3depth.estimator import (
    CLASSICAL,
    M3DEPTH,
    Classical,
    Estimator,
    EstimatorError,
    EstimatorName,
    distinct_labels,
    load_estimator,
)
from m3depth.evaluation.recorded_maps import FORM, RecordedError, RecordedPredictions
from m3depth.evaluation.report import markdown_report, text_table
from m3depth.evaluation.resume import SavedState, SavedStateError
from m3depth.evaluation.scoring import RESERVED, Evaluation, Method, check_choice, chosen_pairs, evaluate
from m3depth.evaluation.without_truth.pairs import are_without_truth, calibration_files, image_pairs
from m3depth.evaluation.without_truth.run import FIGURE, score_without_truth
from m3depth.figures.evaluation import draw_evaluation
from m3depth.figures.side_by_side import draw_side_by_side
from m3depth.holes import FilledEstimator, UnfilledEstimator
from m3depth.network.device import DeviceName, chosen_device
from m3depth.runtimes.choice import RuntimeChoice, recorded_runtime
from m3depth.stereo.degradation import Degradation
from m3depth.stereo.pairs import MAX_DISPARITY, StereoPairs, pair_name, scored_depths, spread
from marssim.base.command.progress import watched
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import source_digest, versions

EXAMPLES = 3  # pairs in the figures

Baseline = Literal[Classical, "mccnn", "all", "none"]


@dataclass(frozen=True)
class EvaluateOptions:
    """Score M3Depth and other methods on a dataset of marssim.generate, or of other layouts."""

    data: Path
    """Dataset folder, of marssim.generate or of any layout that --format lists."""
    out: Path
    """Folder to write results.json, results.md and the figures to; those of an earlier scoring are replaced."""
    split: Split = "test"
    """Part of the dataset to score: test, which training leaves out, or all, for data that nothing was trained on."""
    weights: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PATH ...")] = ()
    """Weights files (.safetensors) of m3depth.train to score, each in a row named after its file or run folder.
    Without any, the shipped weights are scored, as M3Depth."""
    baselines: tuple[Baseline, ...] = ("sgbm",)
    """Classical methods to score on the same pairs: sgbm is OpenCV's semi-global matching along five paths, sgbm-hh
    along eight, which is slower and more accurate on level ground; ssd, sad and ncc take the window with the least
    squared or absolute difference, or the highest correlation; ssd-sgm, sad-sgm and ncc-sgm sum these costs along eight
    paths first. mccnn is CNES's MC-CNN with such paths, whose weights come with the extra `rivals`. all scores every
    classical method, and not mccnn; none scores neither."""
    estimator: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[NAME=]ESTIMATOR[,fill|,unfilled] ...")] = ()
    """Further methods to score: package.module:Class, a class without arguments that has infer(left, right, rig);
    m3depth (the shipped weights), m3depth:PATH (other weights), or a classical method by its name in --baselines.
    NAME= before it names its row. ",fill" after it fills unknown pixels from the background, and ",unfilled" after
    that of a classical method leaves pixels without a match unknown."""
    predictions: Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{FORM} ...")] = ()
    """Folders of maps that other programs wrote, each scored in a row NAME. The maps hold disparity [px], or depth
    [m] with ",depth". ",scale=S" says that they hold S times that (-1 for RAFT-Stereo and Pandora); without it, S is 1,
    but 256 for disparity and 1000 for depth in PNG files. ",fill" fills unknown pixels from the background.
    Where the principal points of the cameras differ (doffs), that is added to disparities of the images, but not to
    those of m3depth.predict beside a prediction.json.
    m3depth/evaluation/recorded_maps.py lists the names of the files."""
    device: DeviceName = "auto"
    """Device that M3Depth runs on; auto takes a GPU if there is one."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth: pytorch; openvino, on the CPU, with the extra `fast`; or auto, which is openvino if it
    is installed and the device is the CPU, and else pytorch."""
    limit: int | None = None
    """Number of pairs to score, 1 or more, spread evenly over the split. Without it, all are scored."""
    degrade: str | None = None
    """Degradation of the images before they are scored, as contrast=.33,blur=1,noise=2.5: contrast (a factor), blur
    (sigma [px]) and noise (sigma [grey levels]) of both images; vertical (offset downwards [px]) and gain (brightness
    relative to the left) of the right one alone. Maps of --predictions stay as recorded, and their rows say so."""
    seed: int = 0
    """Seed of the noise that --degrade adds."""
    max_disparity: float = MAX_DISPARITY
    """Largest true disparity [px], above 0, of the pixels that are scored; nearer ones are scored apart, as near. For
    images larger than 512 px of the same view, give as many times more."""
    align_rows: bool = False
    """Align the rows of each pair where they lie significantly apart, before the estimators see it, as m3depth.predict
    does. It counts to their time. Maps of --predictions stay as recorded, and their rows say so."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """How the folder is read."""

    def __post_init__(self) -> None:
        check_choice(self.limit, self.seed)
        if not self.max_disparity > 0:
            raise ValueError(f"max_disparity must be positive, got {self.max_disparity}")


def named_estimators(options: EvaluateOptions) -> dict[str, tuple[str, EstimatorName]]:
    """Return the estimators that the flags name, each with its flag, by the name of its column.

    An estimator that is named twice in the same way has one column.

    Raises:
        ValueError: A name is unknown or taken.
    """
    if "none" in options.baselines and len(options.baselines) > 1:
        raise ValueError("--baselines none excludes other names: give none, or the names")
    classical = CLASSICAL if "all" in options.baselines else options.baselines
    texts = [
        *(("--weights", f"{M3DEPTH}:{path}") for path in options.weights),
        *([] if options.weights else [("--weights", M3DEPTH)]),
        *(("--baselines", name) for name in classical if name != "none"),
    ]
    flags = {EstimatorName(text): flag_name for flag_name, text in reversed(texts)}
    names = list(dict.fromkeys(EstimatorName(text) for _, text in texts))
    for text in options.estimator:
        name = EstimatorName.parse(text, "--estimator", labelled=True, fillable=True)
        if name not in flags:
            flags[name] = "--estimator"
            names.append(name)
    columns: dict[str, tuple[str, EstimatorName]] = {}
    for label, name in zip(distinct_labels(names), names, strict=True):
        if label in columns or label in RESERVED:
            hint = "" if name.given_label else f"; write --estimator NAME={name.form}"
            raise ValueError(f"{flags[name]} {name.form}: the name {label!r} is taken, choose another{hint}")
        columns[label] = flags[name], name
    return columns


def loaded(name: EstimatorName, flag_name: str, options: EvaluateOptions) -> Estimator:
    """Load an estimator, which fills unknown pixels, or leaves them unknown, where its name says so.

    Args:
        name: Its name.
        flag_name: The flag that gave the name, for the message.
        options: Hold the device and the runtime.
    """
    estimator = load_estimator(name.name, flag_name, device=options.device, runtime=options.runtime)
    if name.holes == "unfilled":
        return UnfilledEstimator(estimator)
    return FilledEstimator(estimator) if name.holes == "fill" else estimator


def prepare(options: EvaluateOptions) -> tuple[StereoPairs, dict[str, Method]]:
    """Open the dataset, and load the methods, by the name of their column.

    Raises:
        ValueError: A flag, the dataset or a method cannot be used; one line that says which.
        OSError: A file is missing or cannot be read.
    """
    dataset = open_pairs(options.data, options.split, options.reader)
    if not len(dataset):
        raise ValueError(f"{options.data}: split {options.split} holds no pairs; choose another --split, or all")
    if options.degrade is not None:
        Degradation.parse(options.degrade)
    estimators = named_estimators(options)
    result_folder(options).check()
    if finding := depth_misfit(dataset, [index for _, index in chosen_pairs(dataset, options.limit)]):
        print(f"warning: {finding}", file=sys.stderr)
    methods: dict[str, Method] = {
        label: loaded(name, flag_name, options) for label, (flag_name, name) in estimators.items()
    }
    for text in options.predictions:
        try:
            label, recorded = RecordedPredictions.parse(text)
        except ValueError as error:
            raise ValueError(f"--predictions {error}") from None
        if not recorded.folder.is_dir():
            raise FileNotFoundError(f"--predictions {text}: {recorded.folder}: no such folder")
        if label in RESERVED or label in methods:
            raise ValueError(f"--predictions {text}: the name {label!r} is taken, choose another")
        methods[label] = recorded
    return dataset, methods


def result_folder(options: EvaluateOptions) -> ResultFolder:
    """Return the folder for the results, which replace those of an earlier scoring."""
    return ResultFolder(options.out, "scoring", results_key="per_pair")


def run(options: EvaluateOptions, dataset: StereoPairs, methods: Mapping[str, Method]) -> Evaluation:
    """Score the methods, print the table, and write the files.

    Args:
        options: The command's flags.
        dataset: The pairs, from `prepare`.
        methods: The methods by the name of their column, from `prepare`.
    """
    degradation = None if options.degrade is None else Degradation.parse(options.degrade)
    columns = named_estimators(options)
    estimators = {label: {"name": name.form, "sha256": name.digest()} for label, (_, name) in columns.items()}
    runtime = recorded_runtime([name.name for _, name in columns.values()], options.runtime, options.device)
    device = device_kind(options.device, runtime)
    saved_state = SavedState(options.out, dependencies(options, dataset, estimators, device, runtime))
    evaluation = evaluate(
        dataset,
        methods,
        limit=options.limit,
        degradation=degradation,
        seed=options.seed,
        max_disparity=options.max_disparity,
        align_rows=options.align_rows,
        examples=EXAMPLES,
        worst=EXAMPLES,
        progress=partial(_watched, len(dataset) if options.limit is None else min(options.limit, len(dataset))),
        saved_state=saved_state,
    )
    if not evaluation.scored_pixels:
        saved_state.remove()
        raise DatasetError(f"{options.data}: {evaluation.nothing_scored(dataset)}")
    about = {
        "data": str(options.data),
        "data_sha256": getattr(dataset, "digest", None),
        "split": options.split,
        "pairs": len(evaluation.pairs),
        "weights": ", ".join(map(str, options.weights)) or "shipped",
        "weights_sha256": next(iter(estimators.values()))["sha256"],  # of the first network
        "estimators": estimators,
        "device": device,
        "runtime": runtime,
        "degrade": options.degrade,
        "seed": options.seed,
        "align_rows": options.align_rows,
        "depth_range_m": scored_depths(dataset),
        "max_disparity_px": options.max_disparity,
        "versions": versions(),
    }
    figures = {"methods": evaluation.results, "true_depth_normals": evaluation.true_depth_normals}
    write_json(options.out / "results.json", {**about, **figures, "per_pair": evaluation.pairs}, sort_keys=False)
    write_atomically(
        options.out / "results.md", markdown_report(about, evaluation.results, evaluation.true_depth_normals).encode()
    )
    draw_evaluation(evaluation, options.out)
    saved_state.remove()
    print(text_table(evaluation.results))
    if options.reader.normals == "depth" and not evaluation.true_depth_normals["all"]["pixels"]:
        print(f"warning: {NO_NORMALS}", file=sys.stderr)
    print(f"{counted(len(evaluation.pairs), 'pair')}; figures by kind and depth, and pictures, are in {options.out}")
    return evaluation


def dependencies(
    options: EvaluateOptions, dataset: StereoPairs, estimators: Mapping[str, Any], device: str, runtime: str | None
) -> dict[str, Any]:
    """Return what the figures depend on, by flag; an evaluation continues only one with the same dependencies.

    Args:
        options: The command's flags.
        dataset: The pairs.
        estimators: Name and SHA-256 of every estimator, by the name of its column.
        device: The kind of device that M3Depth runs on.
        runtime: What runs the networks, as recorded_runtime returns it.
    """
    pairs = chosen_pairs(dataset, options.limit)
    names = [pair_name(dataset, index) for index in range(len(dataset))]
    recorded = {text: RecordedPredictions.parse(text)[1].of_pairs(pairs, names) for text in options.predictions}
    calib = options.reader.calib
    return {
        "--data": [str(options.data.resolve()), state_of_pairs(dataset)],
        "--split": options.split,
        "--device": device,
        "--runtime": runtime,
        **by_flag(named_estimators(options), estimators),
        "--predictions": [[text, state_of_files(maps.files(pairs))] for text, maps in recorded.items()],
        "--limit": options.limit,
        "--degrade": options.degrade,
        "--seed": options.seed,
        "--max-disparity": options.max_disparity,
        "--align-rows": options.align_rows,
        **{flag(name): str(value) for name, value in options.reader.changed_fields().items()},
        **({} if calib is None else {"--calib": [str(calib), state_of_files([calib])]}),
        "state of the code": source_digest(("marssim", "m3depth")),
    }


def by_flag(columns: Mapping[str, tuple[str, EstimatorName]], estimators: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return label and record of the estimators, by the flag that names them; of weights, whatever their path is.

    Args:
        columns: What `named_estimators` returned.
        estimators: Name and SHA-256 of every estimator, by the name of its column.
    """
    groups: dict[str, list[Any]] = {"--weights": [], "--estimator": []}
    for label, (flag_name, name) in columns.items():
        record = estimators[label] if name.weights is None else {**estimators[label], "name": name.holes}
        groups.setdefault(flag_name, []).append([label, record])
    return groups


def _watched(number: int, remaining: Sequence[int]) -> Iterator[int]:
    """Yield the remaining indices of `number` pairs, and print the progress."""
    if len(remaining) < number:
        print(f"evaluate: {number - len(remaining)} of {counted(number, 'pair')} are scored already", file=sys.stderr)
    return watched(remaining, "pair", "evaluate")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user."""
    return run_command(_work, EvaluateOptions, "python -m m3depth.evaluate", __doc__, args)


def _work(options: EvaluateOptions) -> None:
    if are_without_truth(options.data, options.reader):
        return _work_without_truth(options)
    dataset, methods = prepare(options)
    with result_folder(options).claim():
        try:
            run(options, dataset, methods)
        except (DatasetError, EstimatorError, RecordedError, SavedStateError):
            raise
        except ValueError as error:  # a bug, here or in a method: its traceback shows where
            raise RuntimeError(f"scoring failed: {error}") from error


def device_kind(device: str, runtime: str | None) -> str:
    """Return the kind of device that M3Depth runs on, cpu or cuda.

    Args:
        device: The --device flag.
        runtime: What runs the networks, M3Depth's first, as recorded_runtime returns it.
    """
    return "cpu" if (runtime or "").startswith("openvino") else chosen_device(device).type


def _work_without_truth(options: EvaluateOptions) -> None:
    """Score the methods on pairs of images alone."""
    default = EvaluateOptions(options.data, options.out)
    for name in ("predictions", "degrade", "seed", "max_disparity"):
        if getattr(options, name) != getattr(default, name):
            raise ValueError(f"{flag(name)} is for pairs with true depth; give --disparity or --depth")
    pairs = image_pairs(options.data, options.reader)
    if options.limit is not None:
        pairs = [pairs[i] for i in spread(len(pairs), options.limit)]
    columns = named_estimators(options)
    folder = result_folder(options)
    folder.check()
    estimators = {label: {"name": name.form, "sha256": name.digest()} for label, (_, name) in columns.items()}
    runtime = recorded_runtime([name.name for _, name in columns.values()], options.runtime, options.device)
    methods = {label: loaded(name, flag_name, options) for label, (flag_name, name) in columns.items()}
    device = device_kind(options.device, runtime)
    images = state_of_files(path for pair in pairs for path in pair.files)
    depends = {
        "--data": [str(options.data.resolve()), images], **by_flag(columns, estimators), "--runtime": runtime,
        "--device": device, "--align-rows": options.align_rows, "--calib": state_of_files(calibration_files(pairs)),
        **{flag(name): str(value) for name, value in options.reader.changed_fields().items() if name != "calib"},
        "state of the code": source_digest(("marssim", "m3depth")),
    }  # fmt: skip
    about = {
        "data": str(options.data), "pairs": len(pairs), "estimators": estimators, "runtime": runtime,
        "align_rows": options.align_rows, "versions": versions(),
    }  # fmt: skip
    with folder.claim():
        state = SavedState(options.out, depends)
        score_without_truth(pairs, methods, options.out, about, state, options.align_rows)
        draw_side_by_side(pairs, methods, options.out / FIGURE, options.align_rows)


if __name__ == "__main__":
    sys.exit(main())
