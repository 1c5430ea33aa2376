"""Writes the page that compares methods: scores, error by depth, cost and training.

    python docs/scoring/compare_methods.py --scores out/manifest --runs runs/lite runs/raft-stereo --out out/methods
    python docs/scoring/compare_methods.py --records out/a/records/lite.json out/b/records/hit-net.json --out out/all

SCORES is the --out of docs/scoring/score_manifest.py, whose call had the weights of all runs. Methods that it scored
beside them, such as SGBM, are in the tables too. OUT/records gets a file for each method (method_records.py), and
another call takes such files beside scores or without them, from trainings on other days or machines. All methods must
have been scored on the same pairs. Errors of each method are also given over those of a reference, on the same pairs.
Rows of a method for normals say whose depth it got; those with the true depth come last. --out gets methods.md,
methods.json, curves.png and error_by_depth_SET.png too; the last leaves out methods whose names end with " unfilled".
The time and memory of a network are measured by this command, with random weights, and so are those of the shipped
network and of the methods without training that the package has.
"""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from manifest_summary import Term, figure
from method_records import (
    COLUMNS,
    FAILED_ABS_REL,
    POOLED,
    RATIOS,
    SHARES,
    check_same_pairs,
    of_all_places,
    other_renderings,
    read_record,
    record_of_run,
    scored_methods,
)
from methods_page import markdown
from training_curves import curves_figure

from m3depth.estimator import BUILT_IN, M3DEPTH, EstimatorName, load_estimator
from m3depth.evaluation.cost import measured
from m3depth.evaluation.metrics import INTERVAL_EDGES
from m3depth.evaluation.report import marked
from m3depth.figures.errors import interval_figure
from m3depth.kinds.config import config_from_dict
from m3depth.kinds.networks import new_network
from m3depth.rivals.config import NormalConfig
from m3depth.rivals.normal_network import NormalNetwork
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import NATECAM
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, json_text, read_json, write_json
from marssim.base.results.code_state import versions

SHIPPED_LABEL = EstimatorName(M3DEPTH).label()  # what the scores call the package's weights
SHIFT = 8  # disparity of the pair that is timed [px]
REPEATS = 5  # timed predictions of a network, of which the median counts
SAME = 1e-3  # relative difference up to which two scorings of one method without training are the same


@dataclass(frozen=True)
class Options:
    """Writes the page that compares methods: scores, error by depth, cost and training."""

    out: Path
    """Folder for the page, its figures, methods.json and the records."""
    scores: Path | None = None
    """Folder that docs/scoring/score_manifest.py wrote, for the weights of all runs."""
    runs: tuple[Path, ...] = ()
    """Folders that m3depth.train wrote. Their names are those of the methods."""
    records: tuple[Path, ...] = ()
    """Records of further methods, which an earlier call wrote into the folder records of its --out."""
    size: int = 512
    """Width of the pairs in --scores [px], one of the manifest's sizes."""
    reference: str | None = None
    """Method whose errors the others are divided by, as the tables call it. Without it, the first of --runs, else the
    first of --scores, else the first of --records."""
    title: str = "All tables of the methods"
    """Title of the page."""
    rendered_elsewhere: bool = False
    """Also take records of the same pairs with other digests, as another processor or version renders them, if as many
    pixels lie in each interval of true depth. The page names them."""

    def __post_init__(self) -> None:
        names = [run.name for run in self.runs]
        if len(set(names)) < len(names):
            raise ValueError("runs must have different names")
        if self.scores is None and not self.records:
            raise ValueError("give --scores, --records or both")
        if self.runs and self.scores is None:
            raise ValueError("runs needs --scores, the --out of docs/scoring/score_manifest.py for these weights")


def read_records(options: Options) -> list[dict[str, Any]]:
    """Return the records of all methods: first those of the runs, then others in the scores, then those of files.

    A method without training, such as SGBM, gives the same scores each time, and counts once.

    Raises:
        DatasetError: Something is missing or malformed, the scores are not those of the runs' weights, two different
            methods have one name, or the methods were scored on different pairs.
    """
    records: list[dict[str, Any]] = []
    if options.scores is not None:
        methods = scored_methods(options.scores, options.size)
        trained = {run.name: record_of_run(run) for run in options.runs}
        for name, run in zip(trained, options.runs):
            if name not in methods:
                raise DatasetError(f"--runs {run}: {options.scores} has no scores of {name}")
            scored = EstimatorName(f"m3depth:{run / 'weights.safetensors'}").digest()  # with the source of one's own
            if {*of_all_places(methods[name], "weights_sha256")} != {scored}:
                raise DatasetError(
                    f"--runs {run}: has other weights, or another source of the network, than those that "
                    f"{options.scores} has scores of; run score_manifest again"
                )
        records += [
            {"name": name, "size": options.size, "run": trained.get(name), "sets": methods[name]}
            for name in (*trained, *(label for label in methods if label not in trained))
        ]
    for path in options.records:
        record = read_record(path)
        same = next((other for other in records if other["name"] == record["name"]), None)
        if same is None:
            records.append(record)
            continue
        check_same_pairs([same, record], options.rendered_elsewhere)
        if record["run"] or same["run"] or not _same_scores(record, same):
            raise DatasetError(f"--records {path}: another method is called {record['name']} too")
    check_same_pairs(records, options.rendered_elsewhere)
    return records


def _gets_truth(record: Mapping[str, Any]) -> bool:
    return any(of_all_places(record["sets"], "gets_truth"))


def _same_scores(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two records of the same pairs have the same mean Abs Rel in every set."""
    means = ({name: _mean_abs_rel(of_set) for name, of_set in record["sets"].items()} for record in (one, other))
    first, second = means
    return all(math.isclose(first[name], second[name], rel_tol=SAME) for name in first)


def _mean_abs_rel(of_set: Mapping[str, Any]) -> float:
    values = [figures["abs_rel"] for figures in pairs_of(of_set)[0]]
    return statistics.fmean(value for value in values if value is not None)


def pairs_of(of_set: Mapping[str, Any]) -> tuple[list[dict[str, float | None]], list[tuple[str, str]]]:
    """Return the figures of each pair of a set of a record, and its scene, which a place has for itself."""
    figures, scenes = [], []
    for place, part in sorted(of_set["places"].items()):  # in one order, so that pairs of two records meet
        columns = part["figures"]
        figures += [dict(zip(columns, values)) for values in zip(*columns.values(), strict=True)]
        scenes += [(place, scene) for scene in part["scenes"]]
    return figures, scenes


def metrics(of_set: Mapping[str, Any], reference: Mapping[str, Any]) -> dict[str, Any]:
    """Return the means over images of the paper's seven depth and six normal metrics, with intervals over scenes.

    Args:
        of_set: A set of a record.
        reference: The same set of the method whose errors the others are divided by.

    Returns:
        By metric, "value" and "interval"; for RATIOS "ratio" too, to the reference on the same pairs, and
        "ratio_interval", of the paired bootstrap over the scenes. None where it is not known.
    """
    pairs, scenes = pairs_of(of_set)
    others, _ = pairs_of(reference)
    return {
        name: figure(
            Term(title, partial(_of_image, name), ratio=name in RATIOS, share=name in SHARES), pairs, scenes, others
        )
        for name, title in COLUMNS.items()
    }


def _of_image(name: str, record: Mapping[str, Any]) -> tuple[float, float]:
    value = record.get(name)
    return (0.0, 0.0) if value is None else (value, 1.0)


def spread(of_set: Mapping[str, Any]) -> dict[str, float]:
    """Return how Abs Rel is spread over the pairs of a set.

    A few pairs with very large errors can determine the mean; the median shows the others.

    Returns:
        "median"; "failed", the share of pairs that failed; and "largest_scene", the share that the scene with the
        largest errors has in their sum.
    """
    pairs, scenes = pairs_of(of_set)
    known = [(pair["abs_rel"], scene) for pair, scene in zip(pairs, scenes, strict=True) if pair["abs_rel"] is not None]
    errors = np.array([error for error, _ in known])
    sums: dict[tuple[str, str], float] = {}
    for error, scene in known:
        sums[scene] = sums.get(scene, 0.0) + error
    total = float(errors.sum())
    return {
        "median": float(np.median(errors)),
        "failed": float((errors >= FAILED_ABS_REL).mean()),
        "largest_scene": max(sums.values()) / total if total else 0.0,
    }


def intervals(of_set: Mapping[str, Any]) -> dict[str, Any]:
    """Return the errors by true depth over all pixels of a set, in the form of Scores.result() of m3depth.evaluate.

    Each interval of depth also has "mae_interval", that of the mean absolute error over scenes, None where fewer than
    four scenes have such depths. Scores of earlier versions have none.
    """
    parts = [*of_set["places"].values()]
    of_scenes = [sums for part in parts for sums in part.get("scene_intervals", {}).values()]
    if not all(part.get("scene_intervals") for part in parts):
        of_scenes = []
    rows = []
    for i in range(len(INTERVAL_EDGES) - 1):
        cells = [part["intervals"][i] for part in parts if part["intervals"][i]["pixels"]]
        pixels = np.array([cell["pixels"] for cell in cells], float)
        pooled: dict[str, float | None] = {}
        for name in POOLED:
            power = 2 if name == "rmse" else 1
            values = np.array([cell["pooled"][name] for cell in cells]) ** power
            pooled[name] = float((values @ pixels / pixels.sum()) ** (1 / power)) if cells else None
        edges = {"from_m": float(INTERVAL_EDGES[i]), "to_m": float(INTERVAL_EDGES[i + 1])}
        rows.append({**edges, "pixels": int(pixels.sum()), "pooled": pooled})
        if of_scenes:
            mae = Term("", partial(_absolute_error, i))
            rows[-1]["mae_interval"] = figure(mae, of_scenes, range(len(of_scenes)))["interval"]
    return {
        "intervals": rows,
        "gets_truth": any(part["gets_truth"] for part in parts),
        "normals_are_fitted": any(part["normals_are_fitted"] for part in parts),
    }


def _absolute_error(index: int, sums: Mapping[str, Sequence[float]]) -> tuple[float, float]:
    return sums["absolute_error_m"][index], sums["pixels"][index]


def cost(network: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a network, its seconds for a pair of 512 x 512 px and its process's most memory [MiB].

    It runs with random weights in a process of its own, with as many threads as PyTorch takes. "gets_truth" and
    "on_m3depth": whether it is given the true depth, or that of an M3Depth, which runs too and whose parameters are not
    counted: that of its training if its weights lie where they lay then, else that of the package.

    Args:
        network: Its sizes, as a record has them.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:  # which reports a process that is killed
        return pool.submit(_cost, network).result()


def _cost(sizes: Mapping[str, Any]) -> dict[str, Any]:
    config = config_from_dict(dict(sizes))
    if isinstance(config, NormalConfig) and not Path(config.depth_weights).is_file():
        config = replace(config, depth_weights="", depth_sha256="")
    network = new_network(config).eval()
    infer = network.infer
    if isinstance(network, NormalNetwork):
        infer = network.with_truth(np.full(_timed_pair()[0].shape, SHIFT, np.float32)).infer
    return {
        "gets_truth": network.takes_truth,
        "on_m3depth": isinstance(network, NormalNetwork) and not network.takes_truth,
        "parameters": sum(p.numel() for p in network.parameters()),
        **_timed(infer),
    }


def untrained_cost(label: str) -> dict[str, Any] | None:
    """Return the seconds and the memory of a method without a run, as `cost` does for a network.

    Args:
        label: The method as the tables call it, such as "SGBM-HH".

    Returns:
        "seconds" and "memory_mib", without the filling of gaps, and all of `cost` for the shipped network; None for a
        method that the package does not have, and for one whose package is not installed.
    """
    if label == SHIPPED_LABEL:
        return cost(read_json(SHIPPED_WEIGHTS.with_suffix(".json")))
    if (name := label.lower()) not in BUILT_IN:
        return None
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_untrained_cost, name).result()


def _untrained_cost(name: str) -> dict[str, Any] | None:
    try:
        return _timed(load_estimator(name).infer)
    except ImportError:
        return None


def _timed(infer: Callable[..., object]) -> dict[str, Any]:
    pair = _timed_pair()
    infer(*pair, NATECAM)
    costs = [measured(infer, *pair, NATECAM)[1] for _ in range(REPEATS)]
    return {"seconds": statistics.median(cost.seconds for cost in costs), "memory_mib": costs[-1].peak_mib}


def _timed_pair() -> tuple[np.ndarray, np.ndarray]:
    shape = (NATECAM.camera.height, NATECAM.camera.width)
    left = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    return left, np.roll(left, -SHIFT, axis=1)


def compared(records: Sequence[Mapping[str, Any]], reference: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page shows of the sets: "pairs", "scenes", and "metrics", "spread" and "intervals" by method.

    Args:
        records: The methods, of the same pairs.
        reference: The one whose errors the others are divided by.
    """
    sets = {}
    for name, of_set in reference["sets"].items():
        _, scenes = pairs_of(of_set)
        sets[name] = {
            "pairs": len(scenes),
            "scenes": len(set(scenes)),
            "metrics": {record["name"]: metrics(record["sets"][name], of_set) for record in records},
            "spread": {record["name"]: spread(record["sets"][name]) for record in records},
            "intervals": {record["name"]: intervals(record["sets"][name]) for record in records},
        }
    return sets


def work(options: Options) -> None:
    """Read the scores, runs and records, measure the networks, and write the page."""
    records = read_records(options)
    reference = options.reference or records[0]["name"]
    # Those with a training, which the curves show, come first in all figures, and of these last those with the true
    # depth, which have no errors by depth: so a method has one colour in all.
    records.sort(key=lambda record: (record["run"] is None, _gets_truth(record), record["name"] != reference))
    named = {record["name"]: record for record in records}
    if reference not in named:
        raise DatasetError(f"--reference {reference}: no such method; choose one of {', '.join(named)}")
    for record in records:
        file = f"{record['name'].replace('/', '-')}.json"
        write_atomically(options.out / "records" / file, (json_text(record) + "\n").encode())
    trained = {name: record["run"] for name, record in named.items() if record["run"]}
    content: dict[str, Any] = {
        "title": options.title,
        "reference": reference,
        "versions": versions(),
        "runs": {
            name: {**run["training"], "weights_sha256": run["weights_sha256"], **cost(run["network"])}
            for name, run in trained.items()
        },
        "untrained": {
            name: measured_cost for name in named if name not in trained and (measured_cost := untrained_cost(name))
        },
        "commits": {name: [*dict.fromkeys(of_all_places(record["sets"], "commit"))] for name, record in named.items()},
        "other_renderings": other_renderings(records, named[reference]),
        "sets": compared(records, named[reference]),
    }
    for name, part in content["sets"].items():
        shown = {method: errors for method, errors in part["intervals"].items() if not errors["gets_truth"]}
        shown = shown or part["intervals"]
        shown = {method: errors for method, errors in shown.items() if not method.endswith(" unfilled")} or shown
        titles = dict(marked(shown))
        untrained = [title for title, method in zip(titles, shown, strict=True) if method not in trained]
        interval_figure(titles, options.out / f"error_by_depth_{name}.png", NATECAM.fb, untrained)
    if trained:
        curves_figure({name: run["training"] for name, run in trained.items()}, options.out / "curves.png")
    write_json(options.out / "methods.json", content, sort_keys=False)
    write_atomically(options.out / "methods.md", markdown(content).encode())
    print(f"{counted(len(records), 'method')}; the page is {options.out / 'methods.md'}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/scoring/compare_methods.py", __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
