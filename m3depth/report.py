"""Results of an evaluation as JSON, Markdown and a table for the terminal."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from m3depth.metrics import DEPTH_CAP, KINDS
from marssim.atomic import write_atomically

Results = Mapping[str, Mapping[str, Any]]

DEPTH_COLUMNS = {
    "abs_rel": "Abs Rel ↓", "sq_rel": "Sq Rel ↓", "rmse": "RMSE [m] ↓", "log10": "log10 ↓",
    "delta1": "δ1 ↑", "delta2": "δ2 ↑", "delta3": "δ3 ↑", "epe": "EPE [px] ↓", "bad1": "bad-1 ↓",
}  # fmt: skip
NORMAL_COLUMNS = {
    "mean": "mean [°] ↓", "median": "median [°] ↓", "rmse": "RMSE [°] ↓",
    "within_11.25": "11.25° ↑", "within_22.5": "22.5° ↑", "within_30": "30° ↑",
}  # fmt: skip
PACKAGES = ("mars-m3depth", "torch", "numpy", "opencv-python-headless")


def versions() -> dict[str, Any]:
    """Of what the figures depend on; the processor too, because seconds do."""
    found: dict[str, Any] = {"python": platform.python_version(), "machine": platform.machine(), "cpus": os.cpu_count()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    torch = sys.modules.get("torch")
    if torch is not None:
        found["torch_threads"] = torch.get_num_threads()
    return found


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Replace a JSON file in one step; what is not finite becomes null, so that every reader can read it."""
    write_atomically(path, (json.dumps(_finite(content), indent=1, allow_nan=False) + "\n").encode())


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def text_table(results: Results) -> str:
    """The main figures (mean over images), for the terminal."""
    header = ["", *DEPTH_COLUMNS.values(), "normal [°] ↓", "s/pair"]
    rows = [
        [
            name,
            *_figures(result["depth"]["all"]["per_image"], DEPTH_COLUMNS),
            *_figures(result["normal"]["all"]["per_image"], ["mean"]),
            f"{result['seconds']['median']:.2f}",
        ]
        for name, result in results.items()
    ]
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    return "\n".join("  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in [header, *rows])


def markdown_report(about: Mapping[str, Any], results: Results) -> str:
    """The whole report. about: data, split, pairs, weights, degrade, max_disparity_px, versions."""
    degrade = f", degraded by `{about['degrade']}` (seed {about['seed']})" if about["degrade"] else ""
    lines = [
        "# Evaluation",
        "",
        f"{about['pairs']} pairs, split {about['split']} of `{about['data']}`{degrade}. Weights: {about['weights']}.",
        "",
        f"Scored: true depth 0.5 to 15 m and at most {about['max_disparity_px']:g} px of disparity. No pixel is "
        f"dropped: unknown or infinite depth counts as {DEPTH_CAP:g} m. `density` is the share with a finite depth.",
    ]
    for key, title in (("per_image", "mean over images"), ("pooled", "pooled over all pixels")):
        lines += ["", f"## Depth, {title}", ""]
        lines += _table(
            ["method", *DEPTH_COLUMNS.values(), "density", "s/pair"],
            [
                [name, *_figures(r["depth"]["all"][key], [*DEPTH_COLUMNS, "density"]), f"{r['seconds']['median']:.3f}"]
                for name, r in results.items()
            ],
        )
        lines += ["", f"## Normals, {title}", ""]
        lines += _table(
            ["method", *NORMAL_COLUMNS.values()],
            [[name, *_figures(r["normal"]["all"][key], NORMAL_COLUMNS)] for name, r in results.items()],
        )
    lines += ["", "## By kind of pixel, pooled", "", f"`near`: more than {about['max_disparity_px']:g} px.", ""]
    kind_rows = []
    for kind in KINDS:
        for name, r in results.items():
            depth, normal = r["depth"][kind], r["normal"][kind]
            figures = _figures(depth["pooled"], ["abs_rel", "rmse", "epe", "bad1"])
            kind_rows.append([kind, name, *figures, *_figures(normal["pooled"], ["mean"]), str(depth["pixels"])])
    lines += _table(["pixels", "method", "Abs Rel", "RMSE [m]", "EPE [px]", "bad-1", "normal [°]", "count"], kind_rows)
    lines += ["", "## By true depth, pooled", ""]
    names = list(results)
    interval_rows = []
    for i, interval in enumerate(results[names[0]]["intervals"]):
        pooled = [r["intervals"][i]["pooled"] for r in results.values()]
        figures = [_figures(p, [key])[0] for key in ("mae", "abs_rel") for p in pooled]
        interval_rows.append([f"{interval['from_m']:g}-{interval['to_m']:g} m", *figures, str(interval["pixels"])])
    lines += _table(
        ["depth", *(f"{n} MAE [m]" for n in names), *(f"{n} Abs Rel" for n in names), "count"], interval_rows
    )
    lines += ["", "## Sky predicted nearer than 15 m", ""]
    lines += _table(
        ["method", "share", "sky pixels"],
        [[name, *_figures(r["sky"], ["predicted_near"]), str(r["sky"]["pixels"])] for name, r in results.items()],
    )
    lines += ["", "![comparison](comparison.png)", "", "![error by depth](error_by_depth.png)"]
    found = ", ".join(f"{name} {value}" for name, value in about["versions"].items() if value is not None)
    return "\n".join([*lines, "", f"Seconds are medians of one run on this machine. {found}.", ""])


def _figures(values: Mapping[str, float | None], names: Mapping[str, str] | Sequence[str]) -> list[str]:
    return ["-" if (value := values.get(name)) is None else _number(value) for name in names]


def _number(value: float) -> str:
    return f"{value:.4f}" if abs(value) < 1 else f"{value:.3f}" if abs(value) < 10 else f"{value:.2f}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---", *("---:" for _ in header[1:])]
    return ["| " + " | ".join(row) + " |" for row in (header, rule, *rows)]
