"""The results of an ablation as numbers and sentences, and where they disagree with the paper's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from m3depth.ablation.studies import Comparison, Study
from m3depth.evaluation.bootstrap import interval, resampled_means, student_interval
from marssim.base.command.wording import counted

METHOD = "M3Depth"  # name of a run's network in its score
PROVISIONAL = ", provisional"  # after a verdict of one seed
INTERVALS = ("interval", "seed_interval", "typical_interval", "typical_seed_interval")  # of a change
# Names of the measures in sentences.
MEASURED = {"abs_rel": "Abs Rel", "normal_mean": "the mean error of the normals"}

# What a run's score says of the sky, by the names here.
SKY = {"near_ground_as_sky": "near_ground_as_sky", "sky_missed": "missed"}

RunScores = Mapping[int, Mapping[str, Any]]  # by seed, the score.json of a run
Figures = Mapping[int, np.ndarray]  # by seed, (pairs,) one figure of a run


@dataclass(frozen=True)
class Column:
    """One figure of all runs, on the pairs that have it in all of them.

    Attributes:
        by_run: Figures by variant and seed, (pairs,).
        scenes: (pairs,) scene of each pair.
    """

    by_run: dict[str, dict[int, np.ndarray]]
    scenes: list[str]


def findings(study: Study, scores: Mapping[str, RunScores]) -> dict[str, Any]:
    """Return everything that is reported of a study, as plain numbers and sentences.

    Figures are means over the test pairs, then over the seeds. Changes are relative, with the 95 % interval of the
    paired bootstrap over the scenes: views of one scene resemble each other, so its pairs are drawn together. Fewer
    than four scenes give no interval. With several seeds, there is also Student's interval over the seeds. A pair that
    holds no pixel of a figure is left out of that figure, in every run. A seed that is missing for one
    of the scored rows is left out of all rows.

    Args:
        study: The study.
        scores: score.json by seed, by the name of the variant; empty where nothing is scored yet.

    Raises:
        ValueError: The runs were not all scored on the same pairs.
    """
    runs = _of_common_seeds({row.variant.name: scores[row.variant.name] for row in study.rows})
    _check_same_pairs(runs)
    columns = {name: _column(runs, name) for name in study.columns}
    reference = study.rows[study.reference]
    rows = []
    for row in study.rows:
        seeds = runs[row.variant.name]
        figures = {name: column.by_run[row.variant.name] for name, column in columns.items()}
        rows.append(
            {
                "label": row.label,
                "paper": dict(row.paper),
                "here": {name: _mean(figures[name]) for name in study.columns},
                "by_seed": {
                    str(seed): {name: _mean({seed: figures[name][seed]}) for name in study.columns} for seed in seeds
                },
                "against_reference": {
                    name: {
                        "paper": _ratio(row.paper.get(name), reference.paper.get(name)),
                        **_change(columns[name], reference.variant.name, row.variant.name),
                    }
                    for name in study.columns
                },
                "runs": [
                    {key: score[key] for key in ("steps", "minutes", "parameters", "code", "device")}
                    | {"seconds_per_pair": score["result"]["seconds"]["median"]}
                    | {key: score["result"]["sky"][name] for key, name in SKY.items()}
                    | {key: score[key] for key in ("runtime",) if key in score}
                    for score in seeds.values()
                ],
            }
        )
    comparisons = [
        _compare(study, comparison, columns[name], name) for name in study.measures for comparison in study.comparisons
    ]
    return {
        "title": study.title,
        "source": study.source,
        "columns": list(study.columns),
        "measures": list(study.measures),
        "reference": study.reference,
        "pairs": {name: len(column.scenes) for name, column in columns.items()},
        "all_pairs": max((len(records) for records in _records(runs)), default=0),
        "all_scenes": max((len({record["scene"] for record in records}) for records in _records(runs)), default=0),
        "rows": rows,
        "comparisons": comparisons,
        "order": [_order(rows, n) for n in study.measures if sum(n in row.paper for row in study.rows) > 1],
    }


def _of_common_seeds(runs: Mapping[str, RunScores]) -> dict[str, RunScores]:
    """Return the scores of those seeds that are scored for every row; rows without any score do not count."""
    scored = [set(by_seed) for by_seed in runs.values() if by_seed]
    common = set.intersection(*scored) if scored else set()
    return {name: {seed: by_seed[seed] for seed in by_seed if seed in common} for name, by_seed in runs.items()}


def _check_same_pairs(runs: Mapping[str, RunScores]) -> None:
    by_run = {
        f"{name}-{seed}": [(record["index"], record["pair"]) for record in score["per_pair"]]
        for name, by_seed in runs.items()
        for seed, score in by_seed.items()
    }
    first = next(iter(by_run), "")
    for name, pairs in by_run.items():
        if pairs != by_run[first]:
            raise ValueError(
                f"run {name} was scored on other pairs than {first}: delete runs/{name}/score.json to score it again"
            )


def _records(runs: Mapping[str, RunScores]) -> list[Sequence[Mapping[str, Any]]]:
    """Return the records of the pairs of each run."""
    return [score["per_pair"] for by_seed in runs.values() for score in by_seed.values()]


def _column(runs: Mapping[str, RunScores], name: str) -> Column:
    """Return one figure of the pairs that have it in all of these runs."""
    values = {
        run: {seed: [pair[METHOD].get(name) for pair in score["per_pair"]] for seed, score in by_seed.items()}
        for run, by_seed in runs.items()
    }
    everything = [figures for by_seed in values.values() for figures in by_seed.values()]
    has = [place for place, figures in enumerate(zip(*everything, strict=True)) if None not in figures]
    by_run = {
        run: {seed: np.array([figures[place] for place in has], float) for seed, figures in by_seed.items()}
        for run, by_seed in values.items()
    }
    first = next(iter(_records(runs)), [])
    return Column(by_run, [first[place]["scene"] for place in has])


def _mean(figures: Figures) -> float | None:
    """Return the mean over the pairs and the seeds; None if there are none."""
    values = [*figures.values()]
    return float(np.mean(values)) if values and len(values[0]) else None


def _ratio(value: float | None, reference: float | None) -> float | None:
    return None if value is None or reference is None else value / reference - 1


def _change(column: Column, before_run: str, after_run: str) -> dict[str, Any]:
    """Return the relative change of a mean from one run to another, over the seeds that both have.

    Returns:
        "here": the change, "interval": its bounds over the scenes, "by_seed", "seed_interval": bounds over the seeds;
        "typical", "typical_interval", "typical_by_seed" and "typical_seed_interval": the same of the geometric mean of
        the pairs' ratios, which single pairs with large errors do not decide. None where it is not known.
    """
    before, after = column.by_run[before_run], column.by_run[after_run]
    common = sorted(before.keys() & after.keys())
    names = ("here", "interval", "seed_interval", "typical", "typical_interval", "typical_seed_interval")
    change: dict[str, Any] = dict.fromkeys(names) | {"by_seed": [], "typical_by_seed": []}
    if not common or not len(before[common[0]]) or not np.mean([before[seed] for seed in common]) > 0:
        return change
    first, second = (np.stack([run[seed] for seed in common], 1) for run in (before, after))  # (pairs, seeds)
    scenes = len(set(column.scenes))
    if min(first.min(), second.min()) > 0:
        ratios = np.log(second / first)
        change["typical"] = float(np.expm1(ratios.mean()))
        change["typical_by_seed"] = np.expm1(ratios.mean(0)).tolist()
        means = resampled_means(ratios.mean(1), column.scenes)
        for name, ends in (
            ("typical_interval", interval(means, float(ratios.mean()), scenes)),
            ("typical_seed_interval", student_interval(ratios.mean(0))),
        ):
            change[name] = None if ends is None else np.expm1(ends).tolist()
    change["here"] = float(second.mean() / first.mean() - 1)
    with np.errstate(divide="ignore", invalid="ignore"):  # a mean of 0 in some samples
        change["by_seed"] = (second.mean(0) / first.mean(0) - 1).tolist()
        change["seed_interval"] = student_interval(np.array(change["by_seed"]))
        means = resampled_means(np.stack([first.mean(1), second.mean(1)], 1), column.scenes)
        change["interval"] = interval(means[:, 1] / means[:, 0] - 1, change["here"], scenes, within=(-1, np.inf))
    return change


def _compare(study: Study, comparison: Comparison, column: Column, name: str) -> dict[str, Any]:
    """Return one comparison by one measure, with a sentence about it."""
    before, after = study.rows[comparison.before], study.rows[comparison.after]
    paper = _ratio(after.paper.get(name), before.paper.get(name))
    change = _change(column, before.variant.name, after.variant.name)
    verdict = _verdict(paper, change)
    claim = f"{MEASURED[name]} {_change_text(paper)}" if paper is not None else comparison.statement or "no figure"
    lead = f"Paper: {claim}; here" if study.source else "Here"
    if change["here"] is None:
        result = "it is not measured yet"
    else:
        result = f"{'it' if paper is not None else MEASURED[name]} {_change_text(change['here'])} "
        result += "(" + _interval_text(change["interval"], change["seed_interval"])
        if change["typical_interval"] is not None:
            result += f"; geometric mean {100 * change['typical']:+.1f} %, "
            result += _bounds_text(change["typical_interval"], change["typical_seed_interval"])
        result += ")"
    ending = f": **{verdict}**" if verdict else ""
    return {
        "what": comparison.change,
        "measure": name,
        "paper": paper,
        **change,
        "verdict": verdict,
        "sentence": f"{comparison.change}. {lead} {result}{ending}.",
    }


def _verdict(paper: float | None, change: Mapping[str, Any]) -> str | None:
    """Return whether the changes in the paper and here agree, provisionally with one seed; None if one is not known.

    All intervals must lie on one side of zero, those of the geometric mean too: where a few images with large errors
    decide the mean, its interval holds the true change too rarely.
    """
    if paper is None or change["here"] is None or change["interval"] is None:
        return None
    ends = [bound for name in INTERVALS for bound in change[name] or ()]
    if change["typical_interval"] is None or min(ends) <= 0 <= max(ends):
        return "undecided"
    verdict = "agrees" if (paper < 0) == (change["here"] < 0) else "disagrees"
    return verdict if len(change["by_seed"]) > 1 else verdict + PROVISIONAL


def _interval_text(of_scenes: Sequence[float] | None, of_seeds: Sequence[float] | None) -> str:
    return "no interval" if of_scenes is None else f"95 % interval {_bounds_text(of_scenes, of_seeds)}"


def _bounds_text(of_scenes: Sequence[float], of_seeds: Sequence[float] | None) -> str:
    scenes, *seeds = (f"{100 * low:+.1f} to {100 * high:+.1f} %" for low, high in filter(None, (of_scenes, of_seeds)))
    return f"{scenes} over scenes, {seeds[0]} over seeds" if seeds else scenes


def _change_text(change: float) -> str:
    return f"{'falls' if change < 0 else 'rises'} by {abs(100 * change):.1f} %"


def _order(rows: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """Return the rows from the best to the worst, and how many pairs of them are in another order than the paper's."""
    both = [row for row in rows if row["paper"].get(name) is not None and row["here"][name] is not None]
    paper = [row["label"] for row in sorted(both, key=lambda row: row["paper"][name])]
    order = [row["label"] for row in sorted(both, key=lambda row: row["here"][name])]
    turned = sum(order.index(a) > order.index(b) for i, a in enumerate(paper) for b in paper[i + 1 :])
    count = len(paper) * (len(paper) - 1) // 2
    sentence = (
        f"Order by {MEASURED[name]}, best first. Paper: {'; '.join(paper)}. Here: {'; '.join(order)}. "
        f"{turned} of {counted(count, 'pair')} of rows {'is' if turned == 1 else 'are'} in the opposite order."
    )
    return {"measure": name, "paper": paper, "here": order, "turned": turned, "of": count, "sentence": sentence}
