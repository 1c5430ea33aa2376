"""Writes the page that compares trained networks: scores, error by depth, cost and training, from their folders.

python docs/compare_methods.py --scores out/manifest --runs runs/lite runs/raft-stereo --out out/methods

SCORES is the --out of docs/score_manifest.py, whose call had the weights of all runs. Methods that it scored beside
them, such as SGBM, are in the tables too. --out gets methods.md, methods.json, error_by_depth_SET.png and curves.png.
"""

from __future__ import annotations

import json
import multiprocessing
import statistics
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from manifest_summary import Term, figure
from matplotlib.figure import Figure

from m3depth.evaluation.cost import measured
from m3depth.evaluation.metrics import INTERVAL_EDGES
from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS, number, table
from m3depth.figures.drawing import METHOD_COLOURS, METHOD_MARKERS, save
from m3depth.figures.errors import interval_figure
from m3depth.kinds.networks import load_network
from marssim.base.camera import NATECAM
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, read_json, write_json

POOLED = ("mae", "rmse", "abs_rel", "bad1")  # figures of an interval of depth
REPEATS = 5  # timed predictions of a network, of which the median counts


@dataclass(frozen=True)
class Options:
    """Writes the page that compares trained networks: scores, error by depth, cost and training, from their folders."""

    scores: Path
    """Folder that docs/score_manifest.py wrote, for the weights of all runs."""
    runs: tuple[Path, ...]
    """Folders that m3depth.train wrote. Their names are those of the methods."""
    out: Path
    """Folder for the page, its figures and methods.json."""
    size: int = 512
    """Width of the pairs [px], one of the manifest's sizes."""

    def __post_init__(self) -> None:
        names = [run.name for run in self.runs]
        if not names or len(set(names)) < len(names):
            raise ValueError("runs must name one folder or more, each with a name of its own")


def read_scores(options: Options) -> dict[str, list[dict[str, Any]]]:
    """Return results.json of m3depth.evaluate of every place, by set of the manifest.

    Raises:
        DatasetError: There are none, or a run has no scores in them.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for path in sorted(options.scores.glob(f"depth/{options.size}/*/*/results.json")):
        found.setdefault(path.parts[-3], []).append({"place": path.parts[-2], **read_json(path)})
    if not found:
        raise DatasetError(f"--scores {options.scores}: holds no scores of {options.size} px of score_manifest")
    for name, parts in found.items():
        for part in parts:
            if part["methods"].keys() != parts[0]["methods"].keys():
                raise DatasetError(f"--scores {options.scores}: {name}/{part['place']} has other methods than the rest")
        for run in options.runs:
            if run.name not in parts[0]["methods"]:
                raise DatasetError(f"--runs {run}: {options.scores} has no scores of {run.name} in {name}")
    return found


def metrics(parts: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the means over images of the paper's seven depth and six normal metrics, with intervals over scenes.

    Args:
        parts: The places of a set.
    """
    pairs = [(part["place"], pair) for part in parts for pair in part["per_pair"]]
    scenes = [(place, pair["scene"]) for place, pair in pairs]
    columns = {**DEPTH_COLUMNS, **{f"normal_{name}": title for name, title in NORMAL_COLUMNS.items()}}
    return {
        label: {
            name: figure(Term(title, partial(_of_image, name)), [pair[label] for _, pair in pairs], scenes)
            for name, title in columns.items()
        }
        for label in parts[0]["methods"]
    }


def _of_image(name: str, record: Mapping[str, Any]) -> tuple[float, float]:
    value = record.get(name)
    return (0.0, 0.0) if value is None else (value, 1.0)


def intervals(parts: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the errors by true depth over all pixels of a set, in the form of Scores.result() of m3depth.evaluate."""
    return {label: {"intervals": _joined([p["methods"][label] for p in parts])} for label in parts[0]["methods"]}


def _joined(results: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    rows = []
    for i, (near, far) in enumerate(pairwise(INTERVAL_EDGES)):
        cells = [result["intervals"][i] for result in results if result["intervals"][i]["pixels"]]
        pixels = np.array([cell["pixels"] for cell in cells], float)
        pooled = {}
        for name in POOLED:
            power = 2 if name == "rmse" else 1
            values = np.array([cell["pooled"][name] for cell in cells]) ** power
            pooled[name] = float((values @ pixels / pixels.sum()) ** (1 / power)) if len(cells) else None
        rows.append({"from_m": float(near), "to_m": float(far), "pixels": int(pixels.sum()), "pooled": pooled})
    return rows


def training(run: Path) -> dict[str, Any]:
    """Return the steps, the minutes, the starts and the errors at the validations of a run.

    Where other programs kept the processor busy, the minutes of the processor, which the log counts anew at each start,
    compare runs better than those of the clock.

    Raises:
        DatasetError: It is no folder of a run.
    """
    log = run / "log.jsonl"
    if not log.is_file():
        raise DatasetError(f"--runs {run}: has no log.jsonl of m3depth.train")
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    steps = [line for line in lines if line["kind"] == "train"]
    if not steps:
        raise DatasetError(f"--runs {run}: its log.jsonl has no step")
    processor, before, last = [], 0.0, 0.0
    for line in lines:
        if line["kind"] == "start":
            before, last = before + last, 0.0
        elif line["kind"] == "train":
            last = line["processor_minutes"]
            processor.append(before + last)
    at = [line["step"] for line in steps]
    return {
        "steps": steps[-1]["step"],
        "minutes": steps[-1]["minutes"],
        "processor_minutes": processor[-1],
        "starts": [line for line in lines if line["kind"] == "start"],
        "validations": [
            {
                "step": line["step"],
                "processor_minutes": float(np.interp(line["step"], at, processor)),
                "epe": line["epe"],
            }
            for line in lines
            if line["kind"] == "val"
        ],
    }


def cost(weights: Path) -> dict[str, Any]:
    """Return the parameters of a network, its seconds for a pair of 512 x 512 px and its process's most memory [MiB].

    It runs in a process of its own, with as many threads as PyTorch takes.
    """
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_cost, (weights,))


def _cost(weights: Path) -> dict[str, Any]:
    random = np.random.default_rng(0)
    shape = (NATECAM.camera.height, NATECAM.camera.width)
    left = random.integers(0, 256, shape, dtype=np.uint8)
    right = np.roll(left, -8, axis=1)
    network = load_network(weights)
    network.infer(left, right, NATECAM)
    costs = [measured(network.infer, left, right, NATECAM)[1] for _ in range(REPEATS)]
    return {
        "parameters": sum(p.numel() for p in network.parameters()),
        "seconds": statistics.median(cost.seconds for cost in costs),
        "memory_mib": costs[-1].peak_mib,
    }


def curves_figure(runs: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Write a PNG of the error on validation pairs over the processor time of the training."""
    drawing = Figure(figsize=(7, 4.4), layout="constrained", dpi=120)
    ax = drawing.subplots()
    for i, (name, run) in enumerate(runs.items()):
        points = run["validations"]
        ax.plot(
            [p["processor_minutes"] for p in points], [p["epe"] for p in points], label=name, ms=4,
            color=METHOD_COLOURS[i % len(METHOD_COLOURS)], marker=METHOD_MARKERS[i % len(METHOD_MARKERS)],
        )  # fmt: skip
    ax.set_yscale("log")
    ax.set_xlabel("processor time of the training [min]")
    ax.set_ylabel("EPE on validation pairs [px]")
    ax.grid(True, which="both", color="0.9")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False)
    save(drawing, path)


def markdown(content: Mapping[str, Any]) -> str:
    """Return the page. Its tables put the method of the lowest Abs Rel first."""
    lines = ["# Methods compared", ""]
    rows = [
        [
            name, f"{run['parameters'] / 1e6:.2f} M", f"{run['seconds']:.2f}",
            "-" if run["memory_mib"] is None else f"{run['memory_mib']:.0f}", str(run["steps"]),
            f"{run['processor_minutes']:.0f}", f"{run['minutes']:.0f}",
        ]
        for name, run in content["runs"].items()
    ]  # fmt: skip
    columns = ["method", "parameters", "s for a pair", "memory [MiB]"]
    lines += table([*columns, "steps", "processor minutes of training", "minutes of training"], rows)
    lines += ["", "## Commands", "", *table(["method", "seed", "commit", "command"], _starts(content["runs"]))]
    for name, part in content["sets"].items():
        order = sorted(part["metrics"], key=lambda label: part["metrics"][label]["abs_rel"]["value"])
        lines += [
            "",
            f"## {name}",
            "",
            f"{counted(part['pairs'], 'pair')} of {counted(part['scenes'], 'scene')}; means",
        ]
        lines[-1] += " over images, with 95 % intervals over scenes."
        for columns, prefix in ((DEPTH_COLUMNS, ""), (NORMAL_COLUMNS, "normal_")):
            cells = [[label, *(_cell(part["metrics"][label][prefix + key]) for key in columns)] for label in order]
            lines += ["", *table(["method", *columns.values()], cells)]
        lines += ["", "Mean absolute error [m] by true depth, over all pixels:", ""]
        depths = [f"{r['from_m']:g}-{r['to_m']:g} m" for r in part["intervals"][order[0]]["intervals"]]
        cells = [[depth, *(_mae(part, label, i) for label in order)] for i, depth in enumerate(depths)]
        lines += table(["depth", *order], cells)
    return "\n".join([*lines, ""])


def _starts(runs: Mapping[str, Any]) -> list[list[str]]:
    """Return a row for each run, with all of its commits and its last command."""
    return [
        [
            name,
            *(
                ", ".join(dict.fromkeys(str(start[key]) for start in run["starts"])) or "-"
                for key in ("seed", "commit")
            ),
            f"`{run['starts'][-1]['command']}`" if run["starts"] else "-",
        ]
        for name, run in runs.items()
    ]


def _cell(value: Mapping[str, Any]) -> str:
    if value["value"] is None:
        return "-"
    limits = value["interval"]
    return number(value["value"]) + ("" if limits is None else f" ({number(limits[0])} to {number(limits[1])})")


def _mae(part: Mapping[str, Any], label: str, index: int) -> str:
    value = part["intervals"][label]["intervals"][index]["pooled"]["mae"]
    return "-" if value is None else number(value)


def work(options: Options) -> None:
    """Read the scores and the runs, measure the networks, and write the page."""
    trained = {run.name: training(run) for run in options.runs}
    scores = read_scores(options)
    options.out.mkdir(parents=True, exist_ok=True)
    content: dict[str, Any] = {
        "runs": {run.name: {**trained[run.name], **cost(run / "weights.safetensors")} for run in options.runs},
        "sets": {
            name: {
                "pairs": sum(len(part["per_pair"]) for part in parts),
                "scenes": sum(len({pair["scene"] for pair in part["per_pair"]}) for part in parts),
                "metrics": metrics(parts),
                "intervals": intervals(parts),
            }
            for name, parts in scores.items()
        },
    }
    for name, part in content["sets"].items():
        interval_figure(part["intervals"], options.out / f"error_by_depth_{name}.png", NATECAM.fb)
    curves_figure(trained, options.out / "curves.png")
    write_json(options.out / "methods.json", content, sort_keys=False)
    write_atomically(options.out / "methods.md", markdown(content).encode())
    print(f"{counted(len(trained), 'run')}; the page is {options.out / 'methods.md'}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/compare_methods.py", __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
