"""Writes the page that compares trained networks: scores, error by depth, cost and training, from their folders.

python docs/compare_methods.py --scores out/manifest --runs runs/lite runs/raft-stereo --out out/methods

SCORES is the --out of docs/score_manifest.py, whose call had the weights of all runs. Methods that it scored beside
them, such as SGBM, are in the tables too. Errors of each method are also given over those of a reference, on the same
pairs. Rows of a method that got the true depth are marked, and come last. --out gets methods.md, methods.json,
error_by_depth_SET.png and curves.png.
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
from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS, marked, number, table
from m3depth.figures.drawing import METHOD_COLOURS, METHOD_MARKERS, save
from m3depth.figures.errors import interval_figure
from m3depth.kinds.networks import load_network
from m3depth.rivals.normal_network import NormalNetwork
from marssim.base.camera import NATECAM
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, read_json, write_json

POOLED = ("mae", "rmse", "abs_rel", "bad1")  # figures of an interval of depth
RATIOS = {"abs_rel": "Abs Rel", "epe": "EPE", "normal_mean": "mean error of the normals"}  # over those of the reference
SHIFT = 8  # disparity of the pair that is timed [px]
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
    reference: str | None = None
    """Method whose errors the others are divided by, as the tables call it. Without it, that of the first of --runs."""

    def __post_init__(self) -> None:
        names = [run.name for run in self.runs]
        if not names or len(set(names)) < len(names):
            raise ValueError("runs must name one folder or more, each with a name of its own")

    @property
    def reference_name(self) -> str:
        """The method whose errors the others are divided by."""
        return self.runs[0].name if self.reference is None else self.reference


def read_scores(options: Options) -> dict[str, list[dict[str, Any]]]:
    """Return results.json of m3depth.evaluate of every place, by set of the manifest.

    Raises:
        DatasetError: There are none, or a run or the reference has no scores in them.
    """
    scores: dict[str, list[dict[str, Any]]] = {}
    for path in sorted(options.scores.glob(f"depth/{options.size}/*/*/results.json")):
        scores.setdefault(path.parts[-3], []).append({"place": path.parts[-2], **read_json(path)})
    if not scores:
        raise DatasetError(f"--scores {options.scores}: holds no scores of {options.size} px of score_manifest")
    for name, parts in scores.items():
        for part in parts:
            if part["methods"].keys() != parts[0]["methods"].keys():
                raise DatasetError(f"--scores {options.scores}: {name}/{part['place']} has other methods than the rest")
        for run in options.runs:
            if run.name not in parts[0]["methods"]:
                raise DatasetError(f"--runs {run}: {options.scores} has no scores of {run.name} in {name}")
        if options.reference_name not in parts[0]["methods"]:
            methods = ", ".join(parts[0]["methods"])
            raise DatasetError(f"--reference {options.reference_name}: {name} has scores of {methods} alone")
    return scores


def metrics(parts: Sequence[Mapping[str, Any]], reference: str) -> dict[str, dict[str, Any]]:
    """Return the means over images of the paper's seven depth and six normal metrics, with intervals over scenes.

    Args:
        parts: The places of a set.
        reference: The method whose errors the others are divided by.

    Returns:
        By method and metric, "value" and "interval"; for RATIOS "ratio" too, to the reference on the same pairs, and
        "ratio_interval", of the paired bootstrap over the scenes. None where it is not known.
    """
    pairs = [(part["place"], pair) for part in parts for pair in part["per_pair"]]
    scenes = [(place, pair["scene"]) for place, pair in pairs]
    rivals = [pair[reference] for _, pair in pairs]
    columns = {**DEPTH_COLUMNS, **{f"normal_{name}": title for name, title in NORMAL_COLUMNS.items()}}
    terms = {name: Term(title, partial(_of_image, name), ratio=name in RATIOS) for name, title in columns.items()}
    result = {}
    for label in parts[0]["methods"]:
        records = [pair[label] for _, pair in pairs]
        result[label] = {name: _metric(term, records, scenes, rivals) for name, term in terms.items()}
    return result


def _metric(
    term: Term, records: Sequence[Mapping[str, Any]], scenes: Sequence[Any], rivals: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return a metric, whose ratio is to the reference here; arguments as of manifest_summary.figure."""
    names = {"to_sgbm": "ratio", "to_sgbm_interval": "ratio_interval"}
    return {names.get(key, key): value for key, value in figure(term, records, scenes, rivals).items()}


def _of_image(name: str, record: Mapping[str, Any]) -> tuple[float, float]:
    value = record.get(name)
    return (0.0, 0.0) if value is None else (value, 1.0)


def intervals(parts: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the errors by true depth over all pixels of a set, in the form of Scores.result() of m3depth.evaluate."""
    return {
        label: {
            "intervals": _joined([p["methods"][label] for p in parts]),
            "gets_truth": bool(first.get("gets_truth")),
        }
        for label, first in parts[0]["methods"].items()
    }


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

    Where other programs kept the processor busy, the minutes of the processor, which the log counts from each start on,
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
                "normal": line.get("normal"),
            }
            for line in lines
            if line["kind"] == "val"
        ],
    }


def cost(weights: Path) -> dict[str, Any]:
    """Return the parameters of a network, its seconds for a pair of 512 x 512 px and its process's most memory [MiB].

    It runs in a process of its own, with as many threads as PyTorch takes. "gets_truth" and "on_m3depth": whether it
    is given the true depth, or that of an M3Depth, which runs too and whose parameters are not counted.
    """
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_cost, (weights,))


def _cost(weights: Path) -> dict[str, Any]:
    random = np.random.default_rng(0)
    shape = (NATECAM.camera.height, NATECAM.camera.width)
    left = random.integers(0, 256, shape, dtype=np.uint8)
    right = np.roll(left, -SHIFT, axis=1)
    network = load_network(weights)
    infer = network.infer
    if isinstance(network, NormalNetwork):
        infer = network.with_truth(np.full(shape, SHIFT, np.float32)).infer
    infer(left, right, NATECAM)
    costs = [measured(infer, left, right, NATECAM)[1] for _ in range(REPEATS)]
    return {
        "gets_truth": network.takes_truth,
        "on_m3depth": isinstance(network, NormalNetwork) and not network.takes_truth,
        "parameters": sum(p.numel() for p in network.parameters()),
        "seconds": statistics.median(cost.seconds for cost in costs),
        "memory_mib": costs[-1].peak_mib,
    }


def curves_figure(runs: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Write a PNG of the errors of disparity and of normals on validation pairs over the training's processor time.

    The disparity of a method for normals is that of M3Depth or the true one, so that its curve is flat or missing. The
    panel of the normals is left out where no method has any.
    """
    panels = {"epe": "EPE on validation pairs [px]", "normal": "mean error of the normals on validation pairs [°]"}
    if not any(point["normal"] for run in runs.values() for point in run["validations"]):
        del panels["normal"]
    drawing = Figure(figsize=(7 * len(panels), 4.4), layout="constrained", dpi=120)
    axes = drawing.subplots(1, len(panels), squeeze=False)[0]
    for ax, (key, label) in zip(axes, panels.items(), strict=True):
        for i, (name, run) in enumerate(runs.items()):
            points = [p for p in run["validations"] if p[key]]  # without an error, there is none to draw on this scale
            ax.plot(
                [p["processor_minutes"] for p in points], [p[key] for p in points], label=name, ms=4,
                color=METHOD_COLOURS[i % len(METHOD_COLOURS)], marker=METHOD_MARKERS[i % len(METHOD_MARKERS)],
            )  # fmt: skip
        ax.set_yscale("log")
        ax.set_xlabel("processor time of the training [min]")
        ax.set_ylabel(label)
        ax.grid(True, which="both", color="0.9")
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].legend(frameon=False)
    save(drawing, path)


def markdown(content: Mapping[str, Any]) -> str:
    """Return the page. Its tables put the method of the lowest Abs Rel first, and those with the true depth last."""
    runs = marked(content["runs"])
    lines = ["# Methods compared", ""]
    rows = [
        [
            name, f"{run['parameters'] / 1e6:.2f} M" + " + M3Depth" * run["on_m3depth"], f"{run['seconds']:.2f}",
            "-" if run["memory_mib"] is None else f"{run['memory_mib']:.0f}", str(run["steps"]),
            f"{run['processor_minutes']:.0f}", f"{run['minutes']:.0f}",
        ]
        for name, run in runs.items()
    ]  # fmt: skip
    columns = ["method", "parameters", "s for a pair", "memory [MiB]"]
    lines += table([*columns, "steps", "processor minutes of training", "minutes of training"], rows)
    lines += ["", "## Commands", "", *table(["method", "seed", "commit", "command"], _starts(runs))]
    for name, part in content["sets"].items():
        titles = dict(zip(part["intervals"], marked(part["intervals"]), strict=True))
        order = sorted(part["metrics"], key=partial(_rank, part))
        lines += [
            "",
            f"## {name}",
            "",
            f"{counted(part['pairs'], 'pair')} of {counted(part['scenes'], 'scene')}; means",
        ]
        lines[-1] += " over images, with 95 % intervals over scenes."
        for columns, prefix in ((DEPTH_COLUMNS, ""), (NORMAL_COLUMNS, "normal_")):
            cells = [
                [titles[label], *(_cell(part["metrics"][label][prefix + key]) for key in columns)] for label in order
            ]
            lines += ["", *table(["method", *columns.values()], cells)]
        reference = content["reference"]
        lines += ["", f"Errors over those of {titles[reference]} on the same pairs, with intervals of the paired"]
        lines[-1] += " bootstrap over scenes:"
        cells = [
            [titles[label], *(_cell(part["metrics"][label][key], "ratio") for key in RATIOS)]
            for label in order
            if label != reference
        ]
        lines += ["", *table(["method", *RATIOS.values()], cells)]
        lines += ["", "Mean absolute error [m] by true depth, over all pixels:", ""]
        depths = [f"{r['from_m']:g}-{r['to_m']:g} m" for r in part["intervals"][order[0]]["intervals"]]
        cells = [[depth, *(_mae(part, label, i) for label in order)] for i, depth in enumerate(depths)]
        lines += table(["depth", *(titles[label] for label in order)], cells)
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


def _rank(part: Mapping[str, Any], label: str) -> tuple[bool, float]:
    """Return what the methods of a set are sorted by."""
    return part["intervals"][label]["gets_truth"], part["metrics"][label]["abs_rel"]["value"]


def _cell(metric: Mapping[str, Any], key: str = "value") -> str:
    """Return a metric, or its ratio to the reference, with its interval."""
    if metric[key] is None:
        return "-"
    limits = metric["interval" if key == "value" else f"{key}_interval"]
    return number(metric[key]) + ("" if limits is None else f" ({number(limits[0])} to {number(limits[1])})")


def _mae(part: Mapping[str, Any], label: str, index: int) -> str:
    value = part["intervals"][label]["intervals"][index]["pooled"]["mae"]
    return "-" if value is None else number(value)


def work(options: Options) -> None:
    """Read the scores and the runs, measure the networks, and write the page."""
    trained = {run.name: training(run) for run in options.runs}
    scores = read_scores(options)
    options.out.mkdir(parents=True, exist_ok=True)
    content: dict[str, Any] = {
        "reference": options.reference_name,
        "runs": {run.name: {**trained[run.name], **cost(run / "weights.safetensors")} for run in options.runs},
        "sets": {
            name: {
                "pairs": sum(len(part["per_pair"]) for part in parts),
                "scenes": sum(len({pair["scene"] for pair in part["per_pair"]}) for part in parts),
                "metrics": metrics(parts, options.reference_name),
                "intervals": intervals(parts),
            }
            for name, parts in scores.items()
        },
    }
    for name, part in content["sets"].items():
        interval_figure(dict(marked(part["intervals"])), options.out / f"error_by_depth_{name}.png", NATECAM.fb)
    curves_figure(trained, options.out / "curves.png")
    write_json(options.out / "methods.json", content, sort_keys=False)
    write_atomically(options.out / "methods.md", markdown(content).encode())
    print(f"{counted(len(trained), 'run')}; the page is {options.out / 'methods.md'}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/compare_methods.py", __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
