"""The ablation studies: the networks and losses that are trained, and the paper's figures.

Each study is a table with one row a run: those of the paper, and two of what `lite` has beside the paper's network. A
run is a preset with a few fields changed. A run that several studies share is trained once (`distinct`), and a row that
equals an earlier one of its study is left out (`without_repeats`), such as that without a part that a preset lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

from m3depth.network.config import PLAIN_UPSAMPLING, PRESETS, M3DepthConfig
from m3depth.training.config import RECIPES, Recipe
from m3depth.training.loss_config import LossConfig

# Columns of the paper's tables, by the names of our figures.
DEPTH = ("abs_rel", "sq_rel", "rmse", "log10", "delta1")
NORMAL = ("normal_mean", "normal_median", "normal_rmse", "normal_within_11.25")
PLAIN = (0, 0)  # wavelet levels of a network without WEFE


@dataclass(frozen=True)
class Variant:
    """A preset with some fields of the network and of the loss changed.

    Attributes:
        name: Name of its run folder.
        network: Changed fields of the network's config.
        loss: Changed weights of the loss.
    """

    name: str
    network: Mapping[str, Any] = field(default_factory=dict)
    loss: Mapping[str, Any] = field(default_factory=dict)

    def resolved(self, preset: str, recipe: Recipe = "own") -> tuple[M3DepthConfig, LossConfig]:
        """Return the network and the loss that are trained with a preset and a recipe of m3depth.train."""
        loss = replace(RECIPES[recipe].loss, **self.loss)
        if loss.depth:  # this error has no relative term
            loss = replace(loss, relative=LossConfig().relative)
        return replace(PRESETS[preset], **self.network), loss


@dataclass(frozen=True)
class Row:
    """A row of a table.

    Attributes:
        label: What the table calls it.
        variant: The run that gives its figures.
        paper: The paper's figures, by the names of ours.
    """

    label: str
    variant: Variant
    paper: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """A change from one row to another, as in "WEFE, without IRM".

    Attributes:
        change: The change in words.
        before: Number of the row without it.
        after: Number of the row with it.
        statement: What the paper says about it where it gives no figure.
    """

    change: str
    before: int
    after: int
    statement: str = ""


@dataclass(frozen=True)
class Study:
    """A table of runs, of the paper or of our own.

    Attributes:
        title: Its title here.
        source: Its label in the paper; empty for a table that the paper does not have.
        columns: Names of its figures.
        rows: Its rows.
        reference: Number of the row that the figure draws the others against.
        comparisons: The changes that are compared with the paper's.
        measures: Columns in which rows are compared; smaller is better in them.
    """

    title: str
    source: str
    columns: Sequence[str]
    rows: Sequence[Row]
    reference: int
    comparisons: Sequence[Comparison]
    measures: Sequence[str] = ("abs_rel",)


BASE = Variant("base")  # the unchanged preset
NO_IRM = Variant("no-irm", PLAIN_UPSAMPLING)  # nor any other part that corrects or upsamples the first maps


def _row(label: str, variant: Variant, columns: Sequence[str], figures: Iterable[float]) -> Row:
    return Row(label, variant, dict(zip(columns, figures)))


def _components() -> Study:
    columns = (*DEPTH, *NORMAL)
    neither = Variant("no-wefe-no-irm", {"wavelet_levels": PLAIN, **PLAIN_UPSAMPLING})
    irm = Variant("no-wefe", {"wavelet_levels": PLAIN})
    rows = (  # the text says RMSE 0.311 of (d), the tables 0.314
        _row("(a) neither", neither, columns, (0.121, 0.083, 0.562, 0.055, 0.825, 33.5, 24.2, 50.9, 0.179)),
        _row("(b) IRM", irm, columns, (0.115, 0.071, 0.462, 0.051, 0.871, 29.6, 20.8, 46.9, 0.275)),
        _row("(c) WEFE", NO_IRM, columns, (0.113, 0.066, 0.418, 0.049, 0.882, 25.3, 17.2, 40.7, 0.361)),
        _row("(d) WEFE and IRM", BASE, columns, (0.089, 0.058, 0.314, 0.038, 0.905, 20.6, 12.3, 34.2, 0.435)),
    )
    comparisons = (
        Comparison("IRM, without WEFE", 0, 1),
        Comparison("WEFE, without IRM", 0, 2),
        Comparison("WEFE beside IRM", 1, 3),
        Comparison("IRM beside WEFE", 2, 3),
    )
    measures = ("abs_rel", "normal_mean")
    return Study("Components: WEFE and IRM", "ablation, ablation_normal", columns, rows, 3, comparisons, measures)


def _loss() -> Study:
    columns = ("abs_rel", "sq_rel", "rmse", "delta1", "normal_mean")  # the paper has no normals here

    def weights(disparity: float, normal: float, consistency: float) -> Variant:
        changes = {"disparity": disparity, "normal": normal, "consistency": consistency}
        name = "loss-" + "-".join(f"{value:g}" for value in changes.values())
        return Variant(name, {}, changes)

    rows = (
        _row("λd 2, λn 1, λc 3", weights(2, 1, 3), columns, (0.089, 0.058, 0.314, 0.905)),
        _row("no consistency: 2, 1, 0", weights(2, 1, 0), columns, (0.132, 0.091, 0.402, 0.863)),
        _row("1, 2, 3", weights(1, 2, 3), columns, (0.115, 0.074, 0.370, 0.875)),
        _row("3, 2, 1", weights(3, 2, 1), columns, (0.125, 0.082, 0.390, 0.868)),
        _row("1, 3, 2", weights(1, 3, 2), columns, (0.102, 0.065, 0.348, 0.891)),
        _row("depth alone: 2, 0, 0", weights(2, 0, 0), columns, ()),
    )
    comparisons = (
        Comparison("Leaving out the consistency loss", 0, 1),
        Comparison("Weights 1, 2, 3 instead of 2, 1, 3", 0, 2),
        Comparison("Weights 3, 2, 1 instead of 2, 1, 3", 0, 3),
        Comparison("Weights 1, 3, 2 instead of 2, 1, 3", 0, 4),
        Comparison("Leaving out normals and consistency", 0, 5, "normals make depth more accurate, without a figure"),
    )
    return Study("Weights of the loss", "lambda", columns, rows, 0, comparisons)


def _consistency() -> Study:
    """Return the first two rows of `_loss` as a study, so that they alone can be repeated with several seeds."""
    study = _loss()
    return replace(
        study, title="The consistency loss alone", rows=study.rows[:2], comparisons=study.comparisons[:1],
        measures=("abs_rel", "normal_mean"),
    )  # fmt: skip


def _ladder(
    title: str, source: str, quantity: str, change: Callable[[int], Mapping[str, Any]],
    figures: Mapping[int, Sequence[float]], reference: int, statements: Mapping[int, str] | None = None,
) -> Study:  # fmt: skip
    """Return a study of how many of something are best: a row for each number, compared with the previous one."""
    columns = ("abs_rel", "sq_rel", "rmse", "delta1")
    rows = tuple(_row(str(n), Variant(f"{quantity}-{n}", change(n)), columns, paper) for n, paper in figures.items())
    steps = enumerate(pairwise(figures))
    comparisons = tuple(
        Comparison(f"{more} {quantity} instead of {less}", i, i + 1, (statements or {}).get(more, ""))
        for i, (less, more) in steps
    )
    return Study(title, source, columns, rows, [*figures].index(reference), comparisons)


def _iterations() -> Study:
    figures = {
        1: (0.112, 0.076, 0.368, 0.876),
        2: (0.098, 0.071, 0.338, 0.885),
        3: (0.089, 0.065, 0.314, 0.905),
        4: (0.086, 0.061, 0.310, 0.910),
        5: (0.084, 0.059, 0.308, 0.912),
        6: (),
    }
    study = _ladder(
        "Iterations of the IRM, trained and run alike", "irm_iterations", "iterations", lambda n: {"refine_steps": n},
        figures, 1, {6: "Abs Rel hardly changes"},
    )  # fmt: skip
    *rows, last = study.rows
    return replace(study, rows=(*rows, replace(last, paper={"delta1": 0.913})))  # the text gives no other figure of six


def _levels() -> Study:
    figures = {
        2: (0.095, 0.076, 0.330, 0.890),
        3: (0.084, 0.059, 0.308, 0.912),
        4: (0.088, 0.063, 0.318, 0.905),
        5: (0.093, 0.071, 0.327, 0.892),
    }
    return _ladder(
        "Levels of the wavelet transform", "wt_levels", "levels", lambda n: {"wavelet_levels": (n, n)}, figures, 3
    )


def _parts() -> Study:
    """Return the study of what stands beside the recurrent steps in `lite`: switched off one by one, and together.

    A network without steps has no lookup either, which the steps alone use.
    """
    lookup, match, upsampling = {"lookup_levels": 0}, {"fine_width": 0}, {"convex_upsampling": False}
    rows = (
        Row("all parts", BASE),
        Row("no correlation lookup", Variant("no-lookup", lookup)),
        Row("no match at half the resolution", Variant("no-fine", match)),
        Row("no convex upsampling", Variant("no-convex", upsampling)),
        Row("recurrent steps alone", Variant("steps-alone", {**lookup, **match, **upsampling})),
        Row("no recurrent steps", Variant("no-steps", {"refine_steps": 0, **lookup})),
        Row("none of these parts", NO_IRM),
    )
    comparisons = (
        Comparison("Correlation lookup", 1, 0),
        Comparison("Match at half the resolution", 2, 0),
        Comparison("Convex upsampling", 3, 0),
        Comparison("Recurrent steps, beside the other parts", 5, 0),
        Comparison("Recurrent steps, without the other parts", 6, 4),
        Comparison("The other parts, without recurrent steps", 6, 5),
    )
    columns = ("abs_rel", "sq_rel", "rmse", "delta1", "normal_mean")
    measures = ("abs_rel", "normal_mean")
    return Study("Parts beside the recurrent steps", "", columns, rows, 0, comparisons, measures)


def _additions() -> Study:
    """Return the study of what else `lite` adds to the paper's network and loss: each taken back alone."""
    weights = {"relative": 0.0, "rock": 1.0, "edge": 1.0, "one_eye": 1.0, "rover": 1.0}
    taken_back = {
        "channels of their own for the comparison at 1/8": Variant("plain-match", {"match_channels": 0}),
        "residual blocks at 1/4 and 1/8": Variant("plain-blocks", {"feature_skips": False}),
        "left features in SNNet": Variant("snnet-blind", {"normal_context": 0}),
        "three dilated convolutions a slice of SNNet": Variant(
            "plain-slices", {"slice_layers": 2, "slice_dilated": False}
        ),
        "the normals that the disparity implies, in each step": Variant("not-implied", {"implied_geometry": False}),
        "scores by a weighted sum of the groups": Variant("wide-scores", {"score_kernel": 3}),
        "heads of the state alone": Variant("heads-see-all", {"heads_see_all": True}),
        "weights of pixels in the loss": Variant("loss-plain", {}, weights),
    }
    rows = (Row("all additions", BASE), *(Row(f"without: {part}", variant) for part, variant in taken_back.items()))
    comparisons = tuple(
        Comparison(part[0].upper() + part[1:], number, 0) for number, part in enumerate(taken_back, start=1)
    )
    columns = ("abs_rel", "sq_rel", "rmse", "delta1", "normal_mean")
    return Study("Other additions of lite", "", columns, rows, 0, comparisons, ("abs_rel", "normal_mean"))


STUDIES: dict[str, Study] = {
    "components": _components(), "loss": _loss(), "consistency": _consistency(), "iterations": _iterations(),
    "levels": _levels(), "parts": _parts(), "additions": _additions(),
}  # fmt: skip


def without_repeats(study: Study, preset: str, recipe: Recipe = "own") -> Study:
    """Return a study without the rows whose network and loss are those of an earlier row.

    Comparisons with such a row are made with the earlier one; those of a row with itself are left out.

    Args:
        study: The study.
        preset: "lite", "paper" or "paper-thin".
        recipe: "own" or "paper", by which all runs are trained.
    """
    resolved = [row.variant.resolved(preset, recipe) for row in study.rows]
    kept = list(dict.fromkeys(resolved))
    place = [kept.index(networks) for networks in resolved]
    return replace(
        study,
        rows=[study.rows[resolved.index(networks)] for networks in kept],
        reference=place[study.reference],
        comparisons=[
            replace(comparison, before=place[comparison.before], after=place[comparison.after])
            for comparison in study.comparisons
            if place[comparison.before] != place[comparison.after]
        ],
    )


def distinct(studies: Iterable[Study], preset: str, recipe: Recipe = "own") -> dict[str, Variant]:
    """Return the run that gives the figures of each variant, by the variant's name.

    That is its own run, or an earlier one of the same network and loss. The unchanged preset comes first.

    Args:
        studies: The studies, whose rows name the variants.
        preset: "lite", "paper" or "paper-thin".
        recipe: "own" or "paper", by which all runs are trained.
    """
    first = {BASE.resolved(preset, recipe): BASE}
    rows = (row for study in studies for row in study.rows)
    return {row.variant.name: first.setdefault(row.variant.resolved(preset, recipe), row.variant) for row in rows}
