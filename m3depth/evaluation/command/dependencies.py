"""What the figures of m3depth.evaluate depend on, by flag: an evaluation continues only one with the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from m3depth.datasets.config import flag
from m3depth.datasets.state import state_of_files, state_of_pairs
from m3depth.evaluation.command.methods import ScoredEstimators
from m3depth.evaluation.command.options import EvaluateOptions
from m3depth.evaluation.recorded_maps import RecordedPredictions
from m3depth.evaluation.scoring import chosen_pairs
from m3depth.evaluation.without_truth.pairs import ImagePair, calibration_files
from m3depth.stereo.pairs import StereoPairs, pair_name
from marssim.base.results.code_state import source_digest


def dependencies(options: EvaluateOptions, dataset: StereoPairs, estimators: ScoredEstimators) -> dict[str, Any]:
    """Return what the figures of pairs with true depth depend on, by flag.

    Args:
        options: The command's flags.
        dataset: The pairs.
        estimators: The estimators that they name.
    """
    pairs = chosen_pairs(dataset, options.limit)
    names = [pair_name(dataset, index) for index in range(len(dataset))]
    recorded = {text: RecordedPredictions.parse(text)[1].of_pairs(pairs, names) for text in options.predictions}
    calib = options.reader.calib
    return {
        **_common(options, state_of_pairs(dataset), estimators),
        "--split": options.split,
        "--predictions": [[text, state_of_files(maps.files(pairs))] for text, maps in recorded.items()],
        "--limit": options.limit,
        "--degrade": options.degrade,
        "--seed": options.seed,
        "--max-disparity": options.max_disparity,
        **({} if calib is None else {"--calib": [str(calib), state_of_files([calib])]}),
    }


def dependencies_without_truth(
    options: EvaluateOptions, pairs: Sequence[ImagePair], estimators: ScoredEstimators
) -> dict[str, Any]:
    """Return what the figures of pairs without true depth depend on, by flag.

    Args:
        options: The command's flags.
        pairs: The pairs.
        estimators: The estimators that they name.
    """
    images = state_of_files(path for pair in pairs for path in pair.files)
    calibrations = state_of_files(calibration_files(pairs))
    return {**_common(options, images, estimators), "--calib": calibrations}


def _common(options: EvaluateOptions, state_of_data: str, estimators: ScoredEstimators) -> dict[str, Any]:
    reader = {flag(name): str(value) for name, value in options.reader.changed_fields().items() if name != "calib"}
    return {
        "--data": [str(options.data.resolve()), state_of_data],
        "--device": estimators.device,
        "--runtime": estimators.runtime,
        **estimators.by_flag(),
        "--max-pixels": options.max_pixels,
        "--align-rows": options.align_rows,
        **reader,
        "state of the code": source_digest(("marssim", "m3depth")),
    }
