"""Scores of a pair without true depth, their means over pairs, and the table of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from m3depth.estimator import Estimator
from m3depth.evaluation.cost import measured
from m3depth.evaluation.without_truth.pairs import PairImages
from m3depth.evaluation.without_truth.photometric import residuals
from m3depth.prediction.common_disparity import given_back
from m3depth.prediction.left_right import AGREEMENT, left_right_difference
from m3depth.prediction.masks import unmeasured
from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction
from marssim.base.files.markdown import in_table

COLUMNS = {  # title and number of decimals of each score
    "agreement": ("eyes agree [%] ↑", 100, 1),
    "common_agreement": ("on common pixels [%] ↑", 100, 1),
    "residual": ("photometric residual ↓", 1, 4),
    "residual_ratio": ("over SGBM's ↓", 1, 3),
    "sky": ("sky [%]", 100, 1),
    "unknown": ("unknown [%]", 100, 1),
    "seconds": ("s/pair", 1, 2),
}


def score_pair(methods: Mapping[str, Estimator], pair: PairImages, align: bool = False) -> dict[str, dict[str, float]]:
    """Score every method on a pair.

    Args:
        methods: The methods, by the name of their column.
        pair: The pair.
        align: Whether to align the rows first where they lie significantly apart.

    Returns:
        For each method: of the pixels that both eyes see, that the left one measures and the right one does not leave
        unknown, the share on which their disparities agree within 1 px, where sky in the right eye does not agree; that
        share on the pixels that so count for every method; the mean photometric residual on the pixels that SGBM
        matched and the method measured, and its ratio to SGBM's there; the shares of sky and of unknown pixels; and the
        seconds, with those of the alignment. Masked pixels do not count, nor, in the first three, those whose match is
        masked. What has no pixels is left out.

    Raises:
        EstimatorError: A method returned something else than a whole Prediction.
    """
    aligning = 0.0
    if align:
        pair, cost = measured(pair.aligned)
        aligning = cost.seconds
    pair = pair.without_upper_margins()
    left, right, rig = pair.left, pair.right, pair.rig
    matched = SGBM().match(left, right, rig)
    residual_of_sgbm = residuals(left, right, matched)
    scores, compared, agreeing = {}, {}, {}
    for name, method in methods.items():
        infer = pair.infer(method)
        prediction, cost = measured(infer, left, right, rig)
        difference = left_right_difference(infer, left, right, rig, prediction, -pair.moved)
        within = pair.matched_within(prediction)
        figures = _figures(pair, prediction, np.where(within, residual_of_sgbm, np.nan))
        scores[name] = {**figures, "seconds": cost.seconds + aligning}
        compared[name] = _is_measured(prediction) & np.isfinite(difference) & within
        agreeing[name] = difference <= AGREEMENT
    common = np.logical_and.reduce(list(compared.values()))
    for name in methods:
        for key, where in (("agreement", compared[name]), ("common_agreement", common)):
            if where.any():
                scores[name][key] = float(agreeing[name][where].mean())
    return scores


def predictions_of(methods: Mapping[str, Estimator], pair: PairImages, align: bool = False) -> dict[str, Prediction]:
    """Return what every method predicts of a pair, with a common disparity given back. Arguments and errors are those
    of score_pair.
    """
    pair = (pair.aligned() if align else pair).without_upper_margins()
    return {
        name: given_back(pair.infer(method)(pair.left, pair.right, pair.rig), pair.rig, pair.common)
        for name, method in methods.items()
    }


def _is_measured(prediction: Prediction) -> np.ndarray:
    """Return the pixels that the method measured, (H, W) bool: neither sky nor unknown nor only filled."""
    return np.asarray(np.isfinite(prediction.depth) & ~unmeasured(prediction))


def _figures(pair: PairImages, prediction: Prediction, residual_of_sgbm: np.ndarray) -> dict[str, float]:
    """Return the scores of one view. residual_of_sgbm: (H, W), NaN where it does not count."""
    shown = pair.shown
    depth, sky = _is_measured(prediction), prediction.is_sky
    unknown = np.isnan(prediction.depth) | unmeasured(prediction)
    figures = {"sky": float(sky[shown].mean()), "unknown": float(unknown[shown].mean())} if shown.any() else {}
    residual = residuals(pair.left, pair.right, np.where(depth, prediction.disparity, np.float32(np.nan)))
    if (shared := np.isfinite(residual) & np.isfinite(residual_of_sgbm)).any():
        figures["residual"] = float(residual[shared].mean())
        if (sgbm_mean := float(residual_of_sgbm[shared].mean())) > 0:
            figures["residual_ratio"] = figures["residual"] / sgbm_mean
    return figures


def means(records: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the mean of each score over the pairs that have it, by method.

    Args:
        records: A score_pair of each pair.
        names: Names of the methods.
    """
    return {
        name: {
            key: float(np.mean(values))
            for key in COLUMNS
            if (values := [record[name][key] for record in records if key in record[name]])
        }
        for name in names
    }


def table(rows: Mapping[str, Mapping[str, float]], markdown: bool = False) -> str:
    """Return scores as a table for the terminal, or in Markdown.

    Args:
        rows: Scores by the name of their row.
        markdown: Whether to write Markdown.
    """
    cells = [["", *(title for title, _, _ in COLUMNS.values())]]
    for name, scores in rows.items():
        shown = [
            f"{scores[key] * factor:.{digits}f}" if key in scores else "-"
            for key, (_, factor, digits) in COLUMNS.items()
        ]
        cells.append([in_table(name) if markdown else name, *shown])
    if markdown:
        cells.insert(1, ["---", *["---:"] * len(COLUMNS)])
        return "\n".join(f"| {' | '.join(row)} |" for row in cells)
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
