"""All figures of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m3depth.evaluation.example import Example
from m3depth.evaluation.scoring import Evaluation
from m3depth.figures.comparison import comparison_figure
from m3depth.figures.errors import distribution_figure, interval_figure, sparsification_figure
from m3depth.figures.pairs import pairs_figure
from m3depth.figures.qualitative import qualitative_figure, zoom_figure
from m3depth.figures.rocks import rocks_figure

COMPARED = 3  # methods in comparison.png, which shows the errors too; qualitative.png shows all


def draw_evaluation(evaluation: Evaluation, out: Path) -> None:
    """Write every figure of an evaluation into the folder `out`."""
    comparison_figure(evaluation.examples, out / "comparison.png", most=COMPARED)
    qualitative_figure(evaluation.examples, out / "qualitative.png")
    zoom_figure(evaluation.examples, out / "zoom.png")
    pairs_figure(evaluation.worst, out / "worst.png")
    interval_figure(evaluation.results, out / "error_by_depth.png", _common_fb(evaluation.examples))
    distribution_figure(evaluation.results, out / "error_distribution.png")
    sparsification_figure(evaluation.results, out / "sparsification.png")
    rocks_figure({name: result["rocks"] for name, result in evaluation.results.items()}, out / "rocks.png")


def _common_fb(examples: Sequence[Example]) -> float | None:
    """Return focal length times baseline [px m] if all examples share it."""
    values = {round(e.truth.rig.fb, 3) for e in examples}
    return values.pop() if len(values) == 1 else None
