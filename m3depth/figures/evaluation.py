"""All figures of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m3depth.evaluation.example import Example
from m3depth.evaluation.scoring import Evaluation
from m3depth.figures.comparison import comparison_figure
from m3depth.figures.errors import distribution_figure, interval_figure, sparsification_figure
from m3depth.figures.qualitative import qualitative_figure, zoom_figure
from m3depth.figures.rocks import rocks_figure
from m3depth.figures.worst import worst_figure

COMPARED = 3  # methods in comparison.png, which shows the errors too; qualitative.png shows all


def draw_evaluation(done: Evaluation, out: Path) -> None:
    """Write every figure of an evaluation into the folder `out`."""
    comparison_figure(done.examples, out / "comparison.png", most=COMPARED)
    qualitative_figure(done.examples, out / "qualitative.png")
    zoom_figure(done.examples, out / "zoom.png")
    worst_figure(done.worst, out / "worst.png")
    interval_figure(done.results, out / "error_by_depth.png", _common_fb(done.examples))
    distribution_figure(done.results, out / "error_distribution.png")
    sparsification_figure(done.results, out / "sparsification.png")
    rocks_figure({name: result["rocks"] for name, result in done.results.items()}, out / "rocks.png")


def _common_fb(examples: Sequence[Example]) -> float | None:
    """Return focal length times baseline [px m] if all examples share it."""
    values = {round(e.truth.rig.fb, 3) for e in examples}
    return values.pop() if len(values) == 1 else None
