"""Count the rocks that the navigator's map shows as obstacles, from single frames of predicted depth.

    python -m envs.rocks --data DIR [DIR ...] --split all --perception m3depth sgbm ground_truth --out out/rocks

Each pair of the datasets is one look: its depth goes into an empty elevation map as the navigator's does, but without
the alignment of rows, and the map shows what stands out of the ground (envs/rock_map.py defines what counts).
m3depth.evaluate scores rocks on the depth map itself; this command scores them in the navigator's map. The rows of
ground_truth show the best that the map can do.
Writes results.json, results.md and rocks.png.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from envs.rock_map import RULES, MapRockCounts, count_rocks, frame_map, true_rocks
from envs.world.perception import load_perception
from envs.world.user_code import errors_of
from m3depth.checked_inference import checked_prediction
from m3depth.datasets.config import Split
from m3depth.estimator import Estimator
from m3depth.evaluation.report import EDGES, edges_table, has_edges, rocks_table, sky_table
from m3depth.evaluation.rock_scene import rock_scene
from m3depth.evaluation.rock_scores import HIGH_AND_NEAR
from m3depth.evaluation.running_sums import SkyCounts
from m3depth.runtimes.choice import RuntimeChoice, recorded_runtime, runtime_sentence
from m3depth.stereo.degradation import Degradation
from marssim.base.command.limits import check_least
from marssim.base.command.progress import watched
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import versions

STEPS = (0.10, 0.12, 0.15, 0.20, 0.25)  # [m] heights from which cells are obstacles, counted beside --step


@dataclass(frozen=True)
class RocksConfig:
    """Count the rocks that the navigator's map shows, from single frames of a dataset."""

    data: tuple[Path, ...]
    """Dataset folders, as marssim.generate writes them; all go into one count."""
    out: Path
    """Folder for results.json, results.md and rocks.png; those of an earlier count are replaced."""
    split: Split = "test"
    """Part of each dataset. Take "all" for data on which no training was done."""
    perception: tuple[str, ...] = ("m3depth", "ground_truth")
    """Methods that turn the images into depth: m3depth (the shipped weights), sgbm, ground_truth (true depth),
    m3depth:WEIGHTS (a .safetensors file), another classical method that m3depth.evaluate --baselines lists, or
    package.module:Class (a class with infer(left, right, rig))."""
    step: float = 0.15
    """Height above the ground from which a cell is an obstacle [m], above 0, for rocks found and for false obstacles. A
    rock of 0.2 m may be measured 5 cm too low. results.md has other heights too."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth: pytorch; openvino, on the CPU, with the extra `fast`; or auto, which is openvino if it
    is installed and there is no GPU, and else pytorch."""
    limit: int | None = None
    """Number of pairs to look at, 1 or more, spread evenly; left out: all."""
    degrade: str | None = None
    """Degradation of the images before they are matched, as contrast=.33,blur=1,noise=2.5: contrast (a factor), blur
    (sigma [px]) and noise (sigma [grey levels]) of both images; vertical (offset downwards [px]) and gain (brightness
    relative to the left) of the right one alone."""
    seed: int = 0
    """Seed of the noise that --degrade adds, 0 or more."""

    def __post_init__(self) -> None:
        if not self.step > 0:
            raise ValueError(f"step must be positive, got {self.step}")
        check_least(self, limit=1, seed=0)
        if not self.perception or len(set(self.perception)) < len(self.perception):
            raise ValueError("perception must name one or more, each once")
        if not self.data:
            raise ValueError("data must name one folder or more")


def rocks_seen(config: RocksConfig) -> dict[str, Any]:
    """Count, write the report, and return the content of results.json.

    Raises:
        DatasetError: If the dataset cannot be read or holds no poses, or --out holds other results.
        ValueError: If a perception is unknown or returns no whole Prediction.
    """
    folder = ResultFolder(config.out, "count of rocks", results_key="by_step")
    folder.check()
    pairs = _pairs(config)
    methods = {name: load_perception(name, config.runtime) for name in config.perception}
    degradation = None if config.degrade is None else Degradation.parse(config.degrade)
    with folder.claim():
        return _count(config, pairs, methods, degradation)


def _count(
    config: RocksConfig,
    pairs: list[tuple[StereoDataset, int]],
    methods: Mapping[str, Estimator | None],
    degradation: Degradation | None,
) -> dict[str, Any]:
    steps = sorted({config.step, *STEPS})
    counts_by_method = {name: {step: MapRockCounts() for step in steps} for name in methods}
    sky_by_method = {name: SkyCounts() for name in methods}
    records: list[dict[str, Any]] = []
    for index, (dataset, number) in enumerate(watched(pairs, "pair", "rocks")):
        sample = dataset[number]
        scene = rock_scene(sample)
        if scene is None:
            continue
        left, right = sample.left, sample.right
        if degradation is not None:
            rng = np.random.default_rng((config.seed, index))
            left, right = degradation.apply(left, right, rng)
        record: dict[str, Any] = {
            "data": str(dataset.path), "pair": dataset.names[number], "scene": dataset.scenes[number],
        }  # fmt: skip
        turn = np.asarray(sample.meta["pose"], float)[:3, :3]
        rover = sample.rock < 0  # the rover itself, which no map holds
        true_depth = np.where(rover, np.nan, sample.depth)
        true = frame_map(true_depth, None, sample.rig, turn)
        truth = true_rocks(scene, true, sample.rock > 0, sample.rig.fb)
        for name, method in methods.items():
            if method is None:
                shown = true
                sky_by_method[name].add(true_depth, true_depth)
            else:
                with errors_of(method):
                    prediction = method.infer(left.copy(), right.copy(), sample.rig)  # it may write into them
                prediction = checked_prediction(method, prediction, left.shape[:2])
                shown = frame_map(np.where(rover, np.nan, prediction.depth), prediction.confidence, sample.rig, turn)
                sky_by_method[name].add(prediction.depth, true_depth)
            for step, counts in counts_by_method[name].items():
                of_pair = MapRockCounts()
                count_rocks(of_pair, shown, scene, truth, step)
                counts.merge(of_pair)
                if step == config.step:
                    record[name] = vars(of_pair)
        records.append(record)
    results = {
        name: {step: counts.result() for step, counts in by_step.items()} for name, by_step in counts_by_method.items()
    }
    sky = {name: counts.result() for name, counts in sky_by_method.items()}
    return _report(config, results, sky, records, left_out=len(pairs) - len(records))


def _pairs(config: RocksConfig) -> list[tuple[StereoDataset, int]]:
    """Return the chosen pairs of all datasets."""
    datasets = [StereoDataset(path, None if config.split == "all" else config.split) for path in config.data]
    for path, dataset in zip(config.data, datasets):
        if not len(dataset):
            raise ValueError(f"{path}: split {config.split} holds no pairs; choose another --split")
    pairs = [(dataset, number) for dataset in datasets for number in range(len(dataset))]
    count = len(pairs) if config.limit is None else min(config.limit, len(pairs))
    return [pairs[i] for i in np.unique(np.linspace(0, len(pairs) - 1, count).round().astype(int))]


def _report(
    config: RocksConfig,
    by_step: dict[str, dict[float, dict[str, Any]]],
    sky: dict[str, dict[str, Any]],
    records: list[dict[str, Any]],
    left_out: int,
) -> dict[str, Any]:
    """Write the files, and return the content of results.json.

    Args:
        config: The command's flags.
        by_step: MapRockCounts.result() by method and height of an obstacle [m].
        sky: SkyCounts.result() by method.
        records: The counts of each pair at --step, by method.
        left_out: Number of pairs without a pose, or that show no ground.
    """
    results = {name: steps[config.step] for name, steps in by_step.items()}
    named = ", ".join(map(str, config.data))
    images = max((counts["images"] for counts in results.values() if counts), default=0)
    if not images:
        raise ValueError(f"{named}: no pair of split {config.split} shows ground and holds the pose of its camera")
    runtime = recorded_runtime(config.perception, config.runtime)
    about = {
        "data": [str(path) for path in config.data], "split": config.split, "images": images, "left_out": left_out,
        "step_m": config.step, "degrade": config.degrade, "seed": config.seed,
        "runtime": runtime, "versions": versions(),
    }  # fmt: skip
    curve = {name: [_curve_point(step, counts) for step, counts in steps.items()] for name, steps in by_step.items()}
    content = {**about, "methods": results, "by_step": curve, "sky": sky, "per_pair": records}
    write_json(config.out / "results.json", content, sort_keys=False)
    from m3depth.figures.rocks import rocks_figure  # not at the top, since it loads matplotlib

    rocks_figure(results, config.out / "rocks.png")
    degraded = f", degraded by `{config.degrade}`" if config.degrade else ""
    lines = [
        "# Rocks in the navigator's map",
        "",
        f"{counted(images, 'frame')} of `{named}`, split {config.split}{degraded}; each alone in an empty map. "
        f"Obstacles are cells that stand out of the ground by {config.step:g} m and more. "
        f"{runtime_sentence(runtime)}".rstrip(),
        "",
        RULES,
        "",
        *rocks_table(results, config.step),
        "",
        *_edges(results),
        "Rocks of 0.2 m and more within 8 m, and obstacles that belong to no rock, for other heights of an obstacle:",
        "",
        *_curve_table(curve),
        "",
        *sky_table(sky),
        "",
        "![rocks](rocks.png)",
        "",
    ]
    write_atomically(config.out / "results.md", "\n".join(lines).encode())
    return content


def _edges(results: dict[str, dict[str, Any]]) -> list[str]:
    """Return the lines on the edges of slabs; none where there are none."""
    edges = {name: result["slab_edges"] for name, result in results.items()}
    return [EDGES, "", *edges_table(edges), ""] if has_edges(edges) else []


def _curve_point(step: float, result: dict[str, Any]) -> dict[str, Any]:
    return {"step_m": step, "all_false": result["false"], "all_displaced": result["displaced"], **result[HIGH_AND_NEAR]}


def _curve_table(curve: dict[str, list[dict[str, Any]]]) -> list[str]:
    lines = [
        "| method | obstacle from | found | of those seen by both eyes | missed, left unknown | false | displaced |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, points in curve.items():
        for p in points:
            shares = f"{p['found']} of {p['rocks']}", f"{p['both_eyes_found']} of {p['both_eyes']}"
            last = f"{p['unknown']} | {p['all_false']} | {p['all_displaced']} |"
            lines.append(f"| {name} | {p['step_m']:g} m | {shares[0]} | {shares[1]} | {last}")
    return lines


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, RocksConfig, "python -m envs.rocks", __doc__, args, "nothing was written")


def _work(config: RocksConfig) -> None:
    content = rocks_seen(config)
    for name, counts in content["methods"].items():
        figures = counts[HIGH_AND_NEAR]
        shares = (figures["found_share"], figures["both_eyes_share"])
        share, both = ("-" if value is None else f"{100 * value:.1f} %" for value in shares)
        error = "-" if figures["height_error_m"] is None else f"{100 * figures['height_error_m']:.1f} cm"
        print(
            f"{name}: of {counted(figures['rocks'], 'rock')} of 0.2 m and more within 8 m {share} found ({both} of "
            f"those that both eyes see; of those missed {figures['unknown']} left unknown), height error {error} "
            f"(median); {counted(counts['false'], 'false obstacle')} and {counts['displaced']} displaced in "
            f"{counted(counts['images'], 'frame')}"
        )
    if left_out := content["left_out"]:
        print(f"{counted(left_out, 'pair')} left out: no pose of the camera, or no ground in sight")
    print(f"by height and range: {config.out / 'results.md'}")


if __name__ == "__main__":
    sys.exit(main())
