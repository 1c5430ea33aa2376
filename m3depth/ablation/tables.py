"""The report of an ablation: the paper's tables beside ours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from m3depth.ablation.config import budget_text
from m3depth.ablation.findings import PROVISIONAL, SKY
from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS, depth_range_text, number, table
from marssim.base.command.wording import counted

# Headings of the columns, by figure.
NAMES = {**DEPTH_COLUMNS, **{f"normal_{name}": f"normals, {text}" for name, text in NORMAL_COLUMNS.items()}}
FEWEST_SCENES, FEWEST_STEPS = 20, 200  # of a test set and a budget; from smaller ones nothing follows
VERDICTS = ("agrees", "disagrees", "undecided")  # of a comparison, in the order of the table


def markdown(about: Mapping[str, Any], studies: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the whole report as Markdown.

    Args:
        about: The content of ablation.json, with seeds, depth_range_m and versions.
        studies: findings by the name of the study.
    """
    budget = budget_text(about["steps"], about["minutes"])
    pairs = "" if about["limit"] is None else f" (at most {about['limit']} pairs)"
    data = ", ".join(f"`{folder}`" for folder in about["data"])
    recipe = f", recipe `{about['recipe']}`" if "recipe" in about else ""
    seeds = ", ".join(map(str, about["seeds"]))
    verdicts = [str(part["verdict"]) for study in studies.values() for part in study["comparisons"]]
    provisional = any(verdict.endswith(PROVISIONAL) for verdict in verdicts)
    one_seed = len(about["seeds"]) == 1
    lines = [
        "# Ablation",
        "",
        f"Preset `{about['preset']}`{recipe}. Every run: {budget} on split train of {data}, {about['batch']} crops of "
        f"{about['crop'][0]} x {about['crop'][1]} px a step, the same crops in the same order, seed {seeds}; scored on "
        f"split test of `{about['test']}`{pairs}. Figures here are means over images, over every pixel of "
        f"{depth_range_text(about['depth_range_m'])}. The paper's are of other data and of training without a budget: "
        "orders and changes can be compared, sizes cannot. The paper's unchanged row has three wavelet levels and, by "
        "its own tables, three iterations (five under levels); here it has those of the preset.",
        "",
        "Changes are relative. Their 95 % intervals over scenes are those of the paired bootstrap over the scenes of "
        "the test set, whose pairs are drawn together. They hold for the trained networks, without chance in training. "
        + ("" if one_seed else "Intervals over seeds are Student's, of the changes with each seed, and include it. ")
        + "Geometric mean: the change of the geometric mean of the images' figures. A few images with large errors do "
        "not decide it, as they may the mean, whose interval then holds the true change less often than it says. "
        "Agrees, disagrees: all intervals, those of the geometric mean too, lie on one side of zero, which is the "
        "paper's or the other. Undecided: they do not. Rows turned: pairs of rows in the opposite order of the "
        "paper's." + (" Provisional: of one seed, so chance in training may decide." if provisional else ""),
    ]
    lines += size_warning(studies.values()) + mixture_warning(studies.values())
    if failed := about.get("failed"):
        lines += ["", f"**Left out, since their loss was not finite: {', '.join(failed)}.**"]
    lines += ["", *table(["study", *VERDICTS, "rows turned"], [_summary(study) for study in studies.values()])]
    for name, study in studies.items():
        source = f"The paper's table `{study['source']}`." if study["source"] else "The paper has no such table."
        lines += ["", f"## {study['title']}", "", source, ""]
        common = sorted({int(seed) for row in study["rows"] for seed in row["by_seed"]})
        if not common:
            lines += ["No seed is scored for every row yet, so this table has no figures.", ""]
        elif common != sorted(about["seeds"]):
            names = ", ".join(map(str, common))
            lines += [f"Means over seed {names} only: the other seeds are not scored for every row.", ""]
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


def size_warning(studies: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return lines that warn of a test set or budget that is too small for any conclusion; none if neither is.

    A handful of scenes is not a sample of Mars, and networks of a few steps differ by their initial weights.
    """
    studies = list(studies)
    scenes = [study["all_scenes"] for study in studies if study["all_scenes"]]
    steps = [run["steps"] for study in studies for row in study["rows"] for run in row["runs"]]
    reasons = []
    if scenes and min(scenes) < FEWEST_SCENES:
        count = counted(min(scenes), "scene")
        reasons.append(f"{count} in the test set (under {FEWEST_SCENES}, intervals mean nothing)")
    if steps and min(steps) < FEWEST_STEPS:
        count = counted(min(steps), "step")
        reasons.append(f"{count} (under {FEWEST_STEPS}, a network has hardly begun to learn)")
    return ["", f"**Too small for any conclusion: {' and '.join(reasons)}.**"] if reasons else []


def mixture_warning(studies: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return lines that warn of runs of several states of the code, devices or runtimes; none if they are all alike."""
    runs = [run for study in studies for row in study["rows"] for run in row["runs"]]
    kinds = sorted({f"{run['code']} on {run.get('runtime') or run['device']}" for run in runs})
    if len(kinds) < 2:
        return []
    states = ", ".join(kinds)
    return [
        "",
        f"**These runs may not compare: they are of several states of the code, devices or runtimes ({states}).**",
    ]


def _summary(study: Mapping[str, Any]) -> list[str]:
    if not study["source"]:
        return [study["title"], *["-"] * (len(VERDICTS) + 1)]
    verdicts = [part["verdict"] for part in study["comparisons"]]
    turned = ", ".join(f"{part['turned']} of {part['of']}" for part in study["order"])
    return [study["title"], *(_count(verdicts, verdict) for verdict in VERDICTS), turned]


def _count(verdicts: Sequence[str | None], verdict: str) -> str:
    """Return how many comparisons have a verdict; all comparisons of a study have the same number of seeds."""
    provisional = verdicts.count(verdict + PROVISIONAL)
    return f"{provisional}{PROVISIONAL}" if provisional else str(verdicts.count(verdict))


def _figures(study: Mapping[str, Any], columns: Sequence[str]) -> list[str]:
    if not study["source"]:
        return table(["", *(NAMES[c] for c in columns)], [_our_row(row, columns) for row in study["rows"]])
    header = ["", *(text for column in columns for text in (f"{NAMES[column]} paper", "here"))]
    rows = [
        [row["label"], *(cell for c in columns for cell in (_printed(row["paper"].get(c)), _cell(row["here"][c])))]
        for row in study["rows"]
    ]
    return table(header, rows)


def _our_row(row: Mapping[str, Any], columns: Sequence[str]) -> list[str]:
    return [row["label"], *(_cell(row["here"][column]) for column in columns)]


def _left_out(pairs: int, all_pairs: int) -> list[str]:
    if pairs == all_pairs:
        return []
    return [f"Over {pairs} of the {all_pairs} test pairs: the others hold no pixel that has these figures.", ""]


def _cost(study: Mapping[str, Any]) -> list[str]:
    rows = []
    for row in study["rows"]:
        keys = ("steps", "minutes", "seconds_per_pair", *SKY)
        means = {key: _average([run[key] for run in row["runs"]]) for key in keys}
        size = _average([run["parameters"] for run in row["runs"]])
        steps = "-" if means["steps"] is None else f"{means['steps']:.0f}"
        millions = "-" if size is None else f"{size / 1e6:.2f}"
        sky = [_percent(means[key]) for key in SKY]
        rows.append([row["label"], millions, steps, _cell(means["minutes"]), _cell(means["seconds_per_pair"]), *sky])
    titles = ["near ground as sky [%] ↓", "sky missed [%] ↓"]
    return table(["", "parameters [M]", "steps", "minutes", "s/pair", *titles], rows)


def _average(values: Sequence[float | None]) -> float | None:
    valid = [value for value in values if value is not None]
    return float(np.mean(valid)) if valid else None


def _printed(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}"


def _cell(value: float | None) -> str:
    return "-" if value is None else number(value)
