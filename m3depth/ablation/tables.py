"""What an ablation found: the paper's tables beside ours, and where the two disagree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from m3depth.ablation.config import said_budget
from m3depth.ablation.studies import Comparison, Study
from m3depth.evaluation import bootstrap
from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS, depths_said, number, table
from marssim.base.command.notes import counted

NAMES = {**DEPTH_COLUMNS, **{f"normal_{name}": f"normals, {text}" for name, text in NORMAL_COLUMNS.items()}}
METHOD = "M3Depth"  # what a run's network is called in its score
MEASURED = {"abs_rel": "Abs Rel", "normal_mean": "the mean error of the normals"}
FEWEST_SCENES, FEWEST_STEPS = 20, 200  # of a test set and a budget from which anything can be told
VERDICTS = ("agrees", "disagrees", "undecided")

Scores = Mapping[int, Mapping[str, Any]]  # by seed, the score.json of a run
Figures = Mapping[int, np.ndarray]  # by seed, (pairs,) one figure of a run


@dataclass(frozen=True)
class Column:
    """One figure of all runs, on the pairs that have it in all of them. by_run: Figures by variant; scenes: (pairs,)
    what each pair shows."""

    by_run: dict[str, dict[int, np.ndarray]]
    scenes: list[str]


def findings(study: Study, scores: Mapping[str, Scores]) -> dict[str, Any]:
    """Everything that is said of a study, as plain numbers and sentences.

    scores: by the name of the variant, score.json by seed; empty where nothing is scored yet. Figures are means
    over the test pairs, then over the seeds. Changes are relative, with the 95 % interval of the paired bootstrap over
    the scenes, whose pairs are drawn together: views of one scene are alike; a single scene gives none. A pair that
    holds no pixel of a figure is left out of that figure, in every run. Raises ValueError if the runs were not all
    scored on the same pairs.
    """
    runs = {row.variant.name: scores[row.variant.name] for row in study.rows}
    _check_same_pairs(runs)
    columns = {name: _column(runs, name) for name in study.columns}
    reference = study.rows[study.reference]
    rows = []
    for row in study.rows:
        seeds = scores[row.variant.name]
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
                    for score in seeds.values()
                ],
            }
        )
    said = [
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
        "comparisons": said,
        "order": [_order(study, rows, name) for name in study.measures],
    }


def _check_same_pairs(runs: Mapping[str, Scores]) -> None:
    named = {
        f"{name}-{seed}": [(record["index"], record["pair"]) for record in score["per_pair"]]
        for name, by_seed in runs.items()
        for seed, score in by_seed.items()
    }
    first = next(iter(named), "")
    for name, pairs in named.items():
        if pairs != named[first]:
            raise ValueError(f"run {name} was scored on other pairs than {first}: delete its score.json")


def _records(runs: Mapping[str, Scores]) -> list[Sequence[Mapping[str, Any]]]:
    """The records of the pairs, of each run."""
    return [score["per_pair"] for by_seed in runs.values() for score in by_seed.values()]


def _column(runs: Mapping[str, Scores], name: str) -> Column:
    """A figure of each pair that has it in all of these runs: everywhere the same pairs."""
    found = {
        run: {seed: [pair[METHOD].get(name) for pair in score["per_pair"]] for seed, score in by_seed.items()}
        for run, by_seed in runs.items()
    }
    everything = [figures for by_seed in found.values() for figures in by_seed.values()]
    has = [place for place, figures in enumerate(zip(*everything, strict=True)) if None not in figures]
    by_run = {
        run: {seed: np.array([figures[place] for place in has], float) for seed, figures in by_seed.items()}
        for run, by_seed in found.items()
    }
    first = next(iter(_records(runs)), [])
    return Column(by_run, [first[place]["scene"] for place in has])


def _mean(figures: Figures) -> float | None:
    """Over the pairs and the seeds; None if there are none."""
    values = [*figures.values()]
    return float(np.mean(values)) if values and len(values[0]) else None


def _ratio(value: float | None, reference: float | None) -> float | None:
    return None if value is None or reference is None else value / reference - 1


def _change(column: Column, before_run: str, after_run: str) -> dict[str, Any]:
    """Relative change of a mean from one run to another, by the seeds that both have; its interval over the scenes."""
    before, after = column.by_run[before_run], column.by_run[after_run]
    common = sorted(before.keys() & after.keys())
    if not common or not len(before[common[0]]) or not np.mean([before[seed] for seed in common]) > 0:
        return {"here": None, "interval": None, "by_seed": []}
    first, second = (np.stack([run[seed] for seed in common], 1) for run in (before, after))  # (pairs, seeds)
    found: dict[str, Any] = {"here": float(second.mean() / first.mean() - 1), "interval": None}
    with np.errstate(divide="ignore", invalid="ignore"):
        found["by_seed"] = (second.mean(0) / first.mean(0) - 1).tolist()
        if len(set(column.scenes)) > 1:
            means = bootstrap.resampled_means(np.stack([first.mean(1), second.mean(1)], 1), column.scenes)
            bounds = [*bootstrap.interval(means[:, 1] / means[:, 0] - 1)]
            found["interval"] = bounds if np.isfinite(bounds).all() else None  # a mean of 0 in some samples
    return found


def _compare(study: Study, asked: Comparison, column: Column, name: str) -> dict[str, Any]:
    """One comparison by one measure, and the sentence about it."""
    before, after = study.rows[asked.before], study.rows[asked.after]
    paper = _ratio(after.paper.get(name), before.paper.get(name))
    found = _change(column, before.variant.name, after.variant.name)
    verdict = _verdict(paper, **found)
    claim = f"{MEASURED[name]} {_moves(paper)}" if paper is not None else asked.said or "no figure"
    if found["here"] is None:
        here = "here it is not measured yet"
    else:
        here = f"here {'it' if paper is not None else MEASURED[name]} {_moves(found['here'])} "
        here += "(" + _bounds(found["interval"])
        if len(found["by_seed"]) > 1:
            alike = sum((change > 0) == (found["here"] > 0) for change in found["by_seed"])
            here += f"; the same sign with {alike} of {len(found['by_seed'])} seeds"
        here += ")"
    ending = f": **{verdict}**" if verdict else ""
    return {
        "what": asked.what,
        "measure": name,
        "paper": paper,
        **found,
        "verdict": verdict,
        "sentence": f"{asked.what}. Paper: {claim}; {here}{ending}.",
    }


def _verdict(
    paper: float | None, here: float | None, interval: Sequence[float] | None, by_seed: Sequence[float]
) -> str | None:
    """Of the changes in the paper and here; None if one of them is not known."""
    if paper is None or here is None or interval is None:
        return None
    if interval[0] <= 0 <= interval[1] or any((change < 0) != (here < 0) for change in by_seed):
        return "undecided"
    return "agrees" if (paper < 0) == (here < 0) else "disagrees"


def _bounds(interval: Sequence[float] | None) -> str:
    if interval is None:
        return "no interval"
    return f"95 % interval {100 * interval[0]:+.1f} to {100 * interval[1]:+.1f} %"


def _moves(change: float) -> str:
    return f"{'falls' if change < 0 else 'rises'} by {abs(100 * change):.1f} %"


def _order(study: Study, rows: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """Rows from the best to the worst, and how many pairs of them stand the other way round than in the paper."""
    both = [row for row in rows if row["paper"].get(name) is not None and row["here"][name] is not None]
    paper = [row["label"] for row in sorted(both, key=lambda row: row["paper"][name])]
    here = [row["label"] for row in sorted(both, key=lambda row: row["here"][name])]
    turned = sum(here.index(a) > here.index(b) for i, a in enumerate(paper) for b in paper[i + 1 :])
    count = len(paper) * (len(paper) - 1) // 2
    sentence = (
        f"Order by {MEASURED[name]}, best first. Paper: {'; '.join(paper)}. Here: {'; '.join(here)}. "
        f"{turned} of {counted(count, 'pair')} of rows stand the other way round."
    )
    return {"measure": name, "paper": paper, "here": here, "turned": turned, "of": count, "sentence": sentence}


def markdown(about: Mapping[str, Any], found: Mapping[str, Mapping[str, Any]]) -> str:
    """The whole report.

    about: what ablation.json holds, seeds, depth_range_m and versions. found: findings by study.
    """
    budget = said_budget(about["steps"], about["minutes"])
    pairs = "" if about["limit"] is None else f" (at most {about['limit']} pairs)"
    data = ", ".join(f"`{folder}`" for folder in about["data"])
    seeds = ", ".join(map(str, about["seeds"]))
    lines = [
        "# Ablation",
        "",
        f"Preset `{about['preset']}`. Every run: {budget} on split train of {data}, {about['batch']} crops of "
        f"{about['crop'][0]} x {about['crop'][1]} px a step, the same crops in the same order, seed {seeds}; scored on "
        f"split test of `{about['test']}`{pairs}. Figures here are means over images, over every pixel of "
        f"{depths_said(about['depth_range_m'])}; the paper's are of other data, and of training without the limit of a "
        "budget, so orders and changes compare, not sizes. The paper's unchanged row has three wavelet levels and, by "
        "its own tables, three iterations (five under levels); here it has those of the preset.",
        "",
        "Changes are relative, their 95 % intervals those of the paired bootstrap over the scenes of the test set, "
        "whose pairs are drawn together. Agrees, disagrees: the interval leaves zero out, on the paper's side or the "
        "other; undecided: it holds zero, or seeds differ in sign. Rows turned: pairs of rows that stand the other way "
        "round than in the paper."
        + (" With one seed, chance in training is not in these intervals." if len(about["seeds"]) == 1 else ""),
    ]
    lines += too_little(found.values()) + several_kinds(found.values())
    lines += ["", *table(["study", *VERDICTS, "rows turned"], [_summary(study) for study in found.values()])]
    for name, study in found.items():
        lines += ["", f"## {study['title']}", "", f"The paper's table `{study['source']}`.", ""]
        normals = [column for column in study["columns"] if column.startswith("normal_")]
        for columns in ([c for c in study["columns"] if c not in normals], normals):
            if columns:
                lines += [*_figures(study, columns), ""]
                lines += _left_out(study["pairs"][columns[0]], study["all_pairs"])
        lines += [*_cost(study), ""]
        lines += [f"- {part['sentence']}" for part in (*study["comparisons"], *study["order"])]
        lines += ["", f"![{name}]({name}.png)"]
    versions = ", ".join(f"{name} {value}" for name, value in about["versions"].items() if value is not None)
    return "\n".join([*lines, "", f"{versions}.", ""])


def too_little(studies: Iterable[Mapping[str, Any]]) -> list[str]:
    """Lines that say that test set or budget are too small to tell, with the rule; none if neither is.

    An interval of the bootstrap over a handful of scenes is far too narrow, and networks of a few steps differ by how
    they begin.
    """
    studies = list(studies)
    scenes = [study["all_scenes"] for study in studies if study["all_scenes"]]
    steps = [run["steps"] for study in studies for row in study["rows"] for run in row["runs"]]
    said = []
    if scenes and min(scenes) < FEWEST_SCENES:
        said.append(f"{counted(min(scenes), 'scene')} in the test set (under {FEWEST_SCENES}, intervals mean nothing)")
    if steps and min(steps) < FEWEST_STEPS:
        said.append(f"{counted(min(steps), 'step')} (under {FEWEST_STEPS}, a network has hardly begun to learn)")
    return ["", f"**Too little to tell anything, agreement or not: {' and '.join(said)}.**"] if said else []


def several_kinds(studies: Iterable[Mapping[str, Any]]) -> list[str]:
    """Lines that say that the runs are not all of one state of the code and one kind of device; none if they are."""
    runs = [run for study in studies for row in study["rows"] for run in row["runs"]]
    kinds = sorted({f"{run['code']} on {run['device']}" for run in runs})
    if len(kinds) < 2:
        return []
    return ["", f"**These runs may not compare, of several states of the code or devices: {', '.join(kinds)}.**"]


def _summary(study: Mapping[str, Any]) -> list[str]:
    verdicts = [part["verdict"] for part in study["comparisons"]]
    turned = ", ".join(f"{part['turned']} of {part['of']}" for part in study["order"])
    return [study["title"], *(str(verdicts.count(verdict)) for verdict in VERDICTS), turned]


def _figures(study: Mapping[str, Any], columns: Sequence[str]) -> list[str]:
    header = ["", *(text for column in columns for text in (f"{NAMES[column]} paper", "here"))]
    rows = [
        [row["label"], *(cell for c in columns for cell in (_printed(row["paper"].get(c)), _cell(row["here"][c])))]
        for row in study["rows"]
    ]
    return table(header, rows)


def _left_out(pairs: int, of: int) -> list[str]:
    return (
        [f"Over {pairs} of the {of} test pairs: the others hold no pixel that is scored so.", ""] if pairs < of else []
    )


def _cost(study: Mapping[str, Any]) -> list[str]:
    rows = []
    for row in study["rows"]:
        means = {key: _average([run[key] for run in row["runs"]]) for key in ("steps", "minutes", "seconds_per_pair")}
        size = _average([run["parameters"] for run in row["runs"]])
        steps = "-" if means["steps"] is None else f"{means['steps']:.0f}"
        millions = "-" if size is None else f"{size / 1e6:.2f}"
        rows.append([row["label"], millions, steps, _cell(means["minutes"]), _cell(means["seconds_per_pair"])])
    return table(["", "parameters [M]", "steps", "minutes", "s/pair"], rows)


def _average(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _printed(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def _cell(value: float | None) -> str:
    return "-" if value is None else number(value)
