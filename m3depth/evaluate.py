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
from functools import partial

from m3depth.checked_inference import EstimatorError
from m3depth.datasets.config import flag
from m3depth.datasets.depth_check import depth_misfit
from m3depth.datasets.labels import NO_NORMALS
from m3depth.datasets.open import open_pairs
from m3depth.evaluation.command.dependencies import dependencies, dependencies_without_truth
from m3depth.evaluation.command.methods import loaded, named_estimators, scored_estimators
from m3depth.evaluation.command.options import EvaluateOptions
from m3depth.evaluation.recorded_maps import RecordedError, RecordedPredictions
from m3depth.evaluation.report import markdown_report, text_table
from m3depth.evaluation.resume import SavedState, SavedStateError
from m3depth.evaluation.scoring import RESERVED, Evaluation, Method, chosen_pairs, evaluate
from m3depth.evaluation.without_truth.pairs import are_without_truth, image_pairs
from m3depth.evaluation.without_truth.run import FIGURE, score_without_truth
from m3depth.stereo.degradation import Degradation
from m3depth.stereo.pairs import StereoPairs, scored_depths, spread
from marssim.base.command.progress import watched
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import versions

EXAMPLES = 3  # pairs in the figures
NOTED_SHARE = 0.01  # of pixels that are scored apart, from which on a note says so


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
    methods: dict[str, Method] = {**loaded(estimators, options)}
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
    from m3depth.figures.evaluation import draw_evaluation  # not at the top, since it loads matplotlib

    degradation = None if options.degrade is None else Degradation.parse(options.degrade)
    estimators = scored_estimators(options)
    saved_state = SavedState(options.out, dependencies(options, dataset, estimators))
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
        "weights_sha256": next(iter(estimators.records.values()))["sha256"],  # of the first network
        "estimators": estimators.records,
        "device": estimators.device,
        "runtime": estimators.runtime,
        "max_pixels": options.max_pixels,
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
    if (share := evaluation.near_share()) >= NOTED_SHARE:
        print(
            f"note: {share:.0%} of the pixels with true depth have a disparity above --max-disparity "
            f"({options.max_disparity:g} px); this table leaves them out, and results.json has them as near",
            file=sys.stderr,
        )
    print(f"{counted(len(evaluation.pairs), 'pair')}; figures by kind and depth, and pictures, are in {options.out}")
    return evaluation


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


def _work_without_truth(options: EvaluateOptions) -> None:
    """Score the methods on pairs of images alone."""
    from m3depth.figures.side_by_side import draw_side_by_side  # not at the top, since it loads matplotlib

    default = EvaluateOptions(options.data, options.out)
    for name in ("split", "predictions", "degrade", "seed", "max_disparity"):
        if getattr(options, name) != getattr(default, name):
            raise ValueError(f"{flag(name)} is for pairs with true depth; give --disparity or --depth")
    pairs = image_pairs(options.data, options.reader)
    if options.limit is not None:
        pairs = [pairs[i] for i in spread(len(pairs), options.limit)]
    folder = result_folder(options)
    estimators = scored_estimators(options)
    folder.check()
    methods = loaded(estimators.columns, options)
    saved_state = SavedState(options.out, dependencies_without_truth(options, pairs, estimators))
    about = {
        "data": str(options.data), "pairs": len(pairs), "estimators": estimators.records, "runtime": estimators.runtime,
        "max_pixels": options.max_pixels, "align_rows": options.align_rows, "versions": versions(),
    }  # fmt: skip
    with folder.claim():
        score_without_truth(pairs, methods, options.out, about, saved_state, options.align_rows)
        draw_side_by_side(pairs, methods, options.out / FIGURE, options.align_rows)
        saved_state.remove()


if __name__ == "__main__":
    sys.exit(main())
