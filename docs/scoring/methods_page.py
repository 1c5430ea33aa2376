"""The Markdown page of docs/scoring/compare_methods.py: tables of cost, commands, scores and errors by depth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from method_records import COLUMNS, FAILED_ABS_REL, RATIOS, VISIBLE

from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS, marked, number, table
from marssim.base.command.wording import counted

DIGEST = 12  # shown characters of a digest


def markdown(content: Mapping[str, Any]) -> str:
    """Return the page. Its tables put the method of the lowest Abs Rel first, and those with the true depth last."""
    runs = titled(content["runs"], content["runs"])
    lines = [f"# {content['title']}", "", "Means over images, with 95 % intervals over scenes:", ""]
    lines += _summary(content)
    if runs:
        threads = counted(content["versions"]["torch_threads"], "thread")
        measured = f"Seconds and memory are those of a pair of 512 x 512 px; PyTorch computed with {threads}. Those of"
        lines += ["", f"{measured} methods without training do not include the filling of their gaps.", ""]
        lines += [*_cost_table(runs, content["untrained"]), "", "## Commands", ""]
        lines += [*_starts(runs), "", _scored_by(content["commits"])]
    if content["other_renderings"]:
        lines += ["", _rendered_elsewhere(content["other_renderings"], content["reference"])]
    for name, part in content["sets"].items():
        lines += _set_section(name, part, content["runs"], content["reference"])
    return "\n".join([*lines, ""])


def _summary(content: Mapping[str, Any]) -> list[str]:
    """Return the table of the figures that most readers want: a row a method."""
    sets, runs = content["sets"], content["runs"]
    costs = {**content["untrained"], **runs}
    first = next(iter(sets))
    columns = [(name, "abs_rel", "Abs Rel") for name in sets]
    columns += [(first, VISIBLE, "EPE, non-occluded [px]"), (first, "normal_mean", "normals, mean [°]")]
    scored = sets[first]["intervals"]
    rows = [
        [
            title,
            *(_cell(sets[name]["metrics"][label][key]) for name, key, _ in columns[:-1]),
            _cell(sets[first]["metrics"][label]["normal_mean"])
            + ", planes fitted" * scored[label]["normals_are_fitted"],
            f"{costs[label]['seconds']:.2f}" if label in costs else "-",
            _millions(costs[label]) if label in costs else "-",
        ]
        for label, title in sorted(_titles(sets[first], runs).items(), key=lambda item: _rank(sets[first], item[0]))
    ]
    headings = [f"{title}, {name}" for name, _, title in columns]
    return table(["method", *headings, "s for a pair", "parameters"], rows)


def _millions(cost: Mapping[str, Any]) -> str:
    return f"{cost['parameters'] / 1e6:.2f} M" + " + M3Depth" * cost["on_m3depth"] if "parameters" in cost else "-"


def _cost_table(runs: Mapping[str, Any], untrained: Mapping[str, Any]) -> list[str]:
    rows = [
        [
            name, _millions(run), *_seconds_and_memory(run), str(run["steps"]), f"{run['processor_minutes']:.0f}",
            f"{run['minutes']:.0f}",
        ]
        for name, run in runs.items()
    ]  # fmt: skip
    rows += [[name, _millions(cost), *_seconds_and_memory(cost), "-", "-", "-"] for name, cost in untrained.items()]
    columns = ["method", "parameters", "s for a pair", "memory [MiB]"]
    return table([*columns, "steps", "processor minutes of training", "minutes of training"], rows)


def _seconds_and_memory(cost: Mapping[str, Any]) -> tuple[str, str]:
    return f"{cost['seconds']:.2f}", "-" if cost["memory_mib"] is None else f"{cost['memory_mib']:.0f}"


def _starts(runs: Mapping[str, Any]) -> list[str]:
    """Return a table with a row for each run, with all of its commits and data, its last command and its weights."""
    rows = [
        [
            name,
            *(_all(run["starts"], "seed"), _all(run["starts"], "commit"), _all(run["starts"], "data")),
            _command(run["starts"][-1]) if run["starts"] else "-",
            run["weights_sha256"][:DIGEST],
        ]
        for name, run in runs.items()
    ]
    return table(["method", "seed", "commit", "data", "command", "SHA-256 of the weights"], rows)


def _command(start: Mapping[str, Any]) -> str:
    processes = start.get("processes", 1)
    return f"`{start['command']}`" + f" in {processes} processes of torchrun" * (processes > 1)


def _scored_by(commits: Mapping[str, Sequence[str | None]]) -> str:
    """Return a sentence with the commits of the code that scored the methods, as far as the records have them."""
    methods: dict[str, list[str]] = {}
    for method, of_method in commits.items():
        for commit in of_method:
            methods.setdefault(commit or "commits that were not recorded", []).append(method)
    parts = [f"{commit} ({', '.join(names)})" for commit, names in methods.items()]
    return f"Scored with the code of {'; '.join(parts)}."


def _rendered_elsewhere(others: Mapping[str, Sequence[str]], reference: str) -> str:
    """Return a sentence on the pairs whose digests differ between methods. others: of other_renderings."""
    parts = [f"{place} ({', '.join(methods)})" for place, methods in others.items()]
    return (
        f"The pairs of these places have another digest than those that {reference} was scored on, with the same true "
        f"depth by interval, as where another processor or version renders them: {'; '.join(parts)}."
    )


def _all(starts: Sequence[Mapping[str, Any]], key: str) -> str:
    return ", ".join(dict.fromkeys(str(start.get(key, "-"))[:DIGEST] for start in starts)) or "-"


def _set_section(name: str, part: Mapping[str, Any], runs: Mapping[str, Any], reference: str) -> list[str]:
    """Return the tables of a set."""
    titles = _titles(part, runs)
    of_planes = {k: t + ", planes fitted" * part["intervals"][k]["normals_are_fitted"] for k, t in titles.items()}
    order = sorted(part["metrics"], key=partial(_rank, part))
    lines = ["", f"## {name}", ""]
    lines += [f"{counted(part['pairs'], 'pair')} of {counted(part['scenes'], 'scene')}; means over images, with 95 %"]
    lines[-1] += " intervals over scenes."
    for prefix, columns, names in (("", [*DEPTH_COLUMNS, VISIBLE], titles), ("normal_", NORMAL_COLUMNS, of_planes)):
        keys = [prefix + key for key in columns]
        cells = [[names[label], *(_cell(part["metrics"][label][key]) for key in keys)] for label in order]
        lines += ["", *table(["method", *(COLUMNS[key] for key in keys)], cells)]
    lines += ["", f"Errors over those of {titles[reference]} on the same pairs, with intervals of the paired bootstrap"]
    lines[-1] += " over scenes:"
    cells = [
        [titles[label], *(_cell(part["metrics"][label][key], "ratio") for key in RATIOS)]
        for label in order
        if label != reference
    ]
    lines += ["", *table(["method", *RATIOS.values()], cells)]
    decided = "Where one scene has a tenth of the sum or more, intervals of the mean hold less often than 95 %:"
    lines += ["", f"Abs Rel over the pairs. {decided}", ""]
    spreads = [(titles[label], part["spread"][label]) for label in order]
    cells = [
        [title, number(each["median"]), *(f"{100 * each[share]:.1f} %" for share in ("failed", "largest_scene"))]
        for title, each in spreads
    ]
    columns = ["median", f"pairs of {FAILED_ABS_REL:g} or more", "share of one scene in the sum"]
    lines += table(["method", *columns], cells)
    over_scenes = any("mae_interval" in row for each in part["intervals"].values() for row in each["intervals"])
    known = ", with 95 % intervals over scenes for methods whose scores have them" if over_scenes else ""
    lines += [
        "",
        f"Mean absolute error [m] by true depth, over all pixels{known}; - where no pixel has such a depth:",
        "",
    ]
    depths = [f"{r['from_m']:g}-{r['to_m']:g} m" for r in part["intervals"][order[0]]["intervals"]]
    cells = [[depth, *(_mae(part, label, i) for label in order)] for i, depth in enumerate(depths)]
    return [*lines, *table(["depth", *(titles[label] for label in order)], cells)]


def titled(results: Mapping[str, Any], runs: Mapping[str, Any]) -> dict[str, Any]:
    """Return results of methods by the names that the page has for them, which say whose depth a method is given.

    Args:
        results: By method, with "gets_truth".
        runs: By method that was trained, with "on_m3depth".
    """
    titles = {}
    for label, (title, result) in zip(results, marked(dict(results)).items(), strict=True):
        given = label in runs and runs[label]["on_m3depth"]
        titles[f"{title}, given M3Depth's depth" if given else title] = result
    return titles


def _titles(part: Mapping[str, Any], runs: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of the methods of a set as the tables have them."""
    return dict(zip(part["intervals"], titled(part["intervals"], runs), strict=True))


def _rank(part: Mapping[str, Any], label: str) -> tuple[bool, float]:
    """Return what the methods of a set are sorted by."""
    abs_rel = part["metrics"][label]["abs_rel"]["value"]
    return part["intervals"][label]["gets_truth"], math.inf if abs_rel is None else abs_rel


def _cell(metric: Mapping[str, Any], key: str = "value") -> str:
    """Return a metric, or its ratio to the reference, with its interval."""
    if metric[key] is None:
        return "-"
    limits = metric["interval" if key == "value" else f"{key}_interval"]
    return number(metric[key]) + ("" if limits is None else f" ({number(limits[0])} to {number(limits[1])})")


def _mae(part: Mapping[str, Any], label: str, index: int) -> str:
    row = part["intervals"][label]["intervals"][index]
    return _cell({"value": row["pooled"]["mae"], "interval": row.get("mae_interval")})
