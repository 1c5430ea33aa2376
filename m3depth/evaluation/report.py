"""Results of an evaluation as JSON, Markdown and a table for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from m3depth.evaluation.metrics import DEPTH_CAP, KINDS
from m3depth.evaluation.rock_scores import HIGH_AND_NEAR, OBSTACLE
from m3depth.evaluation.running_sums import NEAR_GROUND
from m3depth.runtimes.choice import runtime_sentence
from marssim.base.command.wording import counted
from marssim.base.files.markdown import in_table

Results = Mapping[str, Mapping[str, Any]]

DEPTH_COLUMNS = {
    "abs_rel": "Abs Rel ↓", "sq_rel": "Sq Rel ↓", "rmse": "RMSE [m] ↓", "log10": "log10 ↓",
    "delta1": "δ1 ↑", "delta2": "δ2 ↑", "delta3": "δ3 ↑", "epe": "EPE [px] ↓", "bad1": "bad-1 ↓",
}  # fmt: skip
OUTLIER_COLUMNS = {"bad2": "bad-2 ↓", "bad3": "bad-3 ↓", "d1": "D1 ↓"}  # of results.md alone
NORMAL_COLUMNS = {
    "mean": "mean [°] ↓", "median": "median [°] ↓", "rmse": "RMSE [°] ↓",
    "within_11.25": "11.25° ↑", "within_22.5": "22.5° ↑", "within_30": "30° ↑",
}  # fmt: skip
SKY_COLUMNS = {
    "near_ground_as_sky": "near ground predicted as sky ↓", "missed": "sky missed ↓",
    "predicted_near": "sky predicted nearer than 15 m ↓",
}  # fmt: skip
ROCK_COLUMNS = ("found", "share", "seen by both eyes", "found", "height error [m]", "bias [m]")
EDGES = (
    "Edges of slabs: connected parts of slabs and ledges that stand 0.1 m and more above the ground around them. Their "
    "slabs count among the rocks too."
)
AS_RECORDED = "As recorded: maps that were read, of images that were neither degraded nor aligned by this command."
# Decimals in the table for the terminal.
DECIMALS = {
    "abs_rel": 4, "sq_rel": 4, "rmse": 3, "log10": 4, "delta1": 4, "delta2": 4, "delta3": 4, "epe": 3, "bad1": 4,
    "mean": 2,
}  # fmt: skip
FIGURES = (
    "comparison", "qualitative", "zoom", "worst", "error_by_depth", "error_distribution", "sparsification", "rocks",
)  # fmt: skip


def marked(results: Results) -> Results:
    """Return results by the names that tables have for them.

    A method that gets the true depth is marked, and recorded maps beside methods that got changed images.
    """
    return {
        name
        + (", given the true depth" if result.get("gets_truth") else "")
        + (", as recorded" if result.get("as_recorded") else ""): result
        for name, result in results.items()
    }


def text_table(results: Results) -> str:
    """Return the main figures (means over images) as a table for the terminal."""
    results = marked(results)
    header = ["", *DEPTH_COLUMNS.values(), "normal [°] ↓", "s/pair"]
    rows = [
        [
            name,
            *_rounded(result["depth"]["all"]["per_image"], DEPTH_COLUMNS),
            *_rounded(result["normal"]["all"]["per_image"], ["mean"]),
            _seconds(result, 2),
        ]
        for name, result in results.items()
    ]
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    return "\n".join("  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in [header, *rows])


def on_fewer_pixels(about: Mapping[str, Any]) -> str:
    """Return what a report says of max_pixels, which results may not have: nothing where it is not given."""
    most = about.get("max_pixels")
    return "" if most is None else f", by networks on at most {most} pixels of an image"


def markdown_report(about: Mapping[str, Any], results: Results, true_depth_normals: Mapping[str, Any]) -> str:
    """Return the whole report as Markdown.

    Args:
        about: data, split, pairs, weights, max_pixels, degrade, align_rows, depth_range_m, max_disparity_px, runtime
            and versions.
        results: Evaluation.results.
        true_depth_normals: Figures of the normals of planes fitted to the true depth, by kind of pixel.
    """
    results = marked(results)
    degrade = f", degraded by `{about['degrade']}` (seed {about['seed']})" if about["degrade"] else ""
    aligned = ", rows aligned where they lay significantly apart" if about.get("align_rows") else ""
    recorded = [AS_RECORDED, ""] if any(result.get("as_recorded") for result in results.values()) else []
    lines = [
        "# Evaluation",
        "",
        f"{counted(about['pairs'], 'pair')}, split {about['split']} of `{about['data']}`{degrade}{aligned}"
        f"{on_fewer_pixels(about)}. "
        f"Weights: {about['weights']}.",
        "",
        *recorded,
        f"Scored: every pixel of {depth_range_text(about['depth_range_m'])} and at most "
        f"{about['max_disparity_px']:g} px of disparity. None is dropped: unknown or infinite depth counts as "
        f"{DEPTH_CAP:g} m. `density` is the share with a finite depth. Seconds: median, without the first call of each "
        "method. MiB: the most that the whole process held during a call.",
    ]
    for key, title in (("per_image", "mean over images"), ("pooled", "pooled over all pixels")):
        lines += ["", f"## Depth, {title}", ""]
        lines += table(
            ["method", *DEPTH_COLUMNS.values(), *OUTLIER_COLUMNS.values(), "density", "s/pair", "MiB"],
            [
                [
                    name,
                    *_figures(r["depth"]["all"][key], [*DEPTH_COLUMNS, *OUTLIER_COLUMNS, "density"]),
                    _seconds(r, 3),
                    _memory(r),
                ]
                for name, r in results.items()
            ],
        )
        lines += ["", f"## Normals, {title}", "", "Fitted: planes in 15 x 15 px of the disparity.", ""]
        lines += table(
            ["method", *NORMAL_COLUMNS.values()],
            [
                [name, *_figures(kinds["all"][key], NORMAL_COLUMNS)]
                for name, kinds in _normal_rows(results, true_depth_normals)
            ],
        )
    lines += _by_kind(results, about["max_disparity_px"]) + _by_depth(results)
    lines += _rocks(results) + _confidence(results)
    lines += ["", "## Sky", "", *sky_table({name: result["sky"] for name, result in results.items()})]
    for figure in FIGURES:
        lines += ["", f"![{figure.replace('_', ' ')}]({figure}.png)"]
    versions = ", ".join(f"{name} {value}" for name, value in about["versions"].items() if value is not None)
    return "\n".join([*lines, "", f"One run on one machine. {runtime_sentence(about['runtime'])}{versions}.", ""])


def sky_table(counts: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the lines on sky that was missed and near ground that was predicted as sky. counts: SkyCounts.result() by
    method."""
    return [
        f"Near ground has a true depth under {NEAR_GROUND:g} m; as sky it reads as free.",
        "",
        *table(
            ["method", *SKY_COLUMNS.values(), "sky pixels"],
            [
                [name, *(_percent(of_method.get(column)) for column in SKY_COLUMNS), str(of_method["pixels"])]
                for name, of_method in counts.items()
            ],
        ),
    ]


def depth_range_text(depth_range: Sequence[float]) -> str:
    """Return the range of scored depths, nearest and farthest [m], in words."""
    low, high = depth_range
    if math.isinf(high):
        return f"true depth of {low:g} m and more" if low else "known true depth"
    return f"true depth {low:g} to {high:g} m"


def _normal_rows(results: Results, true_depth_normals: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    rows: list[tuple[str, Mapping[str, Any]]] = []
    for name, r in results.items():
        if r["normal"]["all"]["pixels"] or not r["fitted_normal"]["all"]["pixels"]:
            rows.append((name, r["normal"]))
        if r["fitted_normal"]["all"]["pixels"]:
            rows.append((f"{name}, fitted to its depth", r["fitted_normal"]))
    return [*rows, ("fitted to the true depth", true_depth_normals)]


def _by_kind(results: Results, max_disparity: float) -> list[str]:
    rows = []
    for kind in KINDS:
        for name, r in results.items():
            depth, normal = r["depth"][kind], r["normal"][kind]
            figures = _figures(depth["pooled"], ["abs_rel", "rmse", "epe", "bad1"])
            rows.append([kind, name, *figures, *_figures(normal["pooled"], ["mean"]), str(depth["pixels"])])
    columns = ["pixels", "method", "Abs Rel", "RMSE [m]", "EPE [px]", "bad-1", "normal [°]", "count"]
    about = (
        f"`near`: more than {max_disparity:g} px; `texture_poor`: grey levels vary by less than 2.5 in 9 x 9 px; "
        "`rover`: the rover itself, which counts in `all` too."
    )
    return ["", "## By kind of pixel, pooled", "", about, "", *table(columns, rows)]


def _by_depth(results: Results) -> list[str]:
    names, rows = list(results), []
    for i, interval in enumerate(results[names[0]]["intervals"]):
        pooled = [r["intervals"][i]["pooled"] for r in results.values()]
        figures = [_figures(p, [key])[0] for key in ("mae", "abs_rel") for p in pooled]
        rows.append([f"{interval['from_m']:g}-{interval['to_m']:g} m", *figures, str(interval["pixels"])])
    columns = ["depth", *(f"{n} MAE [m]" for n in names), *(f"{n} Abs Rel" for n in names), "count"]
    return ["", "## By true depth, pooled", "", *table(columns, rows)]


def _rocks(results: Results) -> list[str]:
    """Return the section on rocks; nothing if no sample records the pose of its camera."""
    rocks = {name: r["rocks"] for name, r in results.items() if r["rocks"]}
    if not rocks:
        return []
    images = next(iter(rocks.values()))["images"]
    about = (
        "Found: the rock's predicted top stands at least half as high as the true one. Height error: median magnitude "
        "and median with sign, over the rocks found. False: regions away from rocks, in the sky too, that are "
        f"predicted to stand 0.2 m and more above the true ground, in {images} images."
    )
    lines = ["", "## Rocks", "", about, "", *rocks_table(rocks, OBSTACLE)]
    edges = {name: r["slab_edges"] for name, r in rocks.items()}
    return lines + (["", EDGES, "", *edges_table(edges)] if has_edges(edges) else [])


def rocks_table(results: Mapping[str, Mapping[str, Any]], least_false: float) -> list[str]:
    """Return the lines of a table of rocks by method, height and distance.

    Args:
        results: RockCounts.result() by method.
        least_false: Height from which false obstacles were searched [m].
    """
    rows = [
        [*_rock_row(name, figures), "-" if figures["height_to_m"] <= least_false else str(figures["false"])]
        for name, rocks in results.items()
        for figures in (rocks[HIGH_AND_NEAR], *rocks["bins"])
    ]
    return table(["method", "height", "range", "rocks", *ROCK_COLUMNS, "false"], rows)


def has_edges(results: Mapping[str, Mapping[str, Any]]) -> bool:
    """Return whether any edge of a slab was counted; results: RockCounts.result()["slab_edges"] by method."""
    return any(figures["rocks"] for edges in results.values() for figures in edges["bins"])


def edges_table(results: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the lines of a table of edges of slabs by method, height and distance.

    Args:
        results: RockCounts.result()["slab_edges"] by method.
    """
    rows = [
        _rock_row(name, figures)
        for name, edges in results.items()
        for figures in (edges[HIGH_AND_NEAR], *edges["bins"])
        if figures["rocks"]
    ]
    return table(["method", "height", "range", "edges", *ROCK_COLUMNS], rows)


def _rock_row(name: str, figures: Mapping[str, Any]) -> list[str]:
    """Return the cells of outcome_figures of a method."""
    low, high = figures["height_from_m"], figures["height_to_m"]
    return [
        name,
        f"{low:g} m and more" if high == math.inf else f"{low:g}-{high:g} m",
        f"{figures['range_from_m']:g}-{figures['range_to_m']:g} m",
        *(str(figures[key]) for key in ("rocks", "found")),
        *_figures(figures, ["found_share"]),
        *(str(figures[key]) for key in ("both_eyes", "both_eyes_found")),
        *_figures(figures, ["height_error_m", "height_bias_m"]),
    ]


def _confidence(results: Results) -> list[str]:
    rows = []
    for name, r in results.items():
        if curve := r["sparsification"]:
            whole, tenth, third = (curve["dropped"].index(share) for share in (0.0, 0.1, 0.3))
            figures: dict[str, float] = {}
            for key in ("bad1", "epe"):
                figures |= {f"{key} {i}": curve[key][i] for i in (whole, tenth, third)}
                figures |= {f"oracle {key} {i}": curve[f"oracle_{key}"][i] for i in (tenth, third)}
            names = list(figures)
            rows.append([name, *_figures(figures, names), *_figures(curve, ["ause_bad1", "ause_epe"])])
    if not rows:
        return []
    part = ["all", "-10 %", "-30 %", "oracle -10 %", "oracle -30 %"]
    columns = ["method", *(f"bad-1 {p}" for p in part), *(f"EPE {p}" for p in part), "AUSE bad-1", "AUSE EPE"]
    about = "What is left without the least confident 10 and 30 % of the pixels, and without the worst (oracle)."
    return ["", "## Confidence, pooled", "", about, "", *table(columns, rows)]


def _seconds(result: Mapping[str, Any], digits: int) -> str:
    return "-" if result["seconds"] is None else f"{result['seconds']['median']:.{digits}f}"


def _memory(result: Mapping[str, Any]) -> str:
    memory = (result["memory_mib"] or {}).get("process")
    return "-" if memory is None else f"{memory:.0f}"


def _figures(values: Mapping[str, float | None], names: Mapping[str, str] | Sequence[str]) -> list[str]:
    return ["-" if (value := values.get(name)) is None else number(value) for name in names]


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.3g} %"


def _rounded(values: Mapping[str, float | None], names: Iterable[str]) -> list[str]:
    """Return figures with the decimals of their column, so that those of all methods can be compared at a glance."""
    return ["-" if (value := values.get(name)) is None else f"{value:.{DECIMALS[name]}f}" for name in names]


def number(value: float) -> str:
    """Return a figure with about four digits."""
    return f"{value:.4f}" if abs(value) < 1 else f"{value:.3f}" if abs(value) < 10 else f"{value:.2f}"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table; all columns but the first are aligned right.

    Args:
        header: Names of the columns.
        rows: The cells of each row. The first ones may be names of others.
    """
    rule = ["---", *("---:" for _ in header[1:])]
    named = ([in_table(row[0]), *row[1:]] for row in rows)
    return ["| " + " | ".join(row) + " |" for row in (header, rule, *named)]
