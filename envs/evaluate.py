"""Score a driver and a perception on frozen episodes of MarsNav-v0.

    python -m envs.evaluate --driver navigator --perception m3depth --episodes 10 --seed 1 --out out/eval

Several perceptions are driven over the same courses. Finished episodes stay in OUT/episodes: the same command goes on
where it was stopped.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal
from zlib import crc32

from tqdm import tqdm

from envs.course import CourseConfig
from envs.drivers import DRIVERS, make_driver
from envs.episodes import Cell, EpisodeRecord, run_episode
from envs.mars_nav import MarsNavEnv
from envs.metrics import summarise
from envs.report import write_report
from envs.sight import load_perception
from m3depth.estimator import Estimator
from marssim.command import counted, run_command
from marssim.dataset import DatasetError, read_json, write_json
from marssim.scene.scene import Place
from marssim.workers import run_tasks


@dataclass(frozen=True)
class EvaluateConfig:
    """Drive frozen episodes and report success, SPL, collisions and time."""

    out: Path
    """folder for results.json, results.md, map.png and the episodes"""
    driver: tuple[str, ...] = ("navigator",)
    """navigator (plans on a map of what it saw), straight (heads for the goal, blind), random; several are compared on
    the same courses"""
    perception: tuple[str, ...] = ("m3depth",)
    """what turns the images into depth: m3depth (the shipped weights), sgbm, ground_truth (true depth), m3depth:WEIGHTS
    (a .safetensors file) or package.module:Class (with infer(left, right, rig)); several are compared likewise"""
    episodes: int = 10
    """courses for each --k and --slope-deg"""
    seed: int = 0
    """seed of the courses"""
    workers: int = 1
    """processes; the courses do not depend on it"""
    scheduler: str | None = None
    """address of a dask scheduler, tcp://host:8786, whose workers drive instead"""
    scene: Place = "gale"
    """preset of the courses' scenes"""
    k: tuple[float, ...] = ()
    """rock abundances, Golombek's k, to go through; none given: the preset's"""
    slope_deg: tuple[float, ...] = ()
    """regional slopes [deg] to go through; none given: the preset's"""
    goal_distance: float = 20.0
    """distance from start to goal [m]"""
    dynamics: Literal["physics", "kinematic"] = "physics"
    """rigid bodies, or settling without dynamics (faster)"""
    renderer: Literal["embree", "pybullet"] = "embree"
    """what renders the cameras"""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ValueError(f"--episodes must be at least 1, got {self.episodes}")
        if self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        for name in self.driver:
            if name not in DRIVERS:
                raise ValueError(f"--driver {name!r} is unknown; choose from {', '.join(DRIVERS)}")
        for flag, values in vars(self).items():
            if isinstance(values, tuple) and len(set(values)) < len(values):
                raise ValueError(f"--{flag.replace('_', '-')} has a value twice: {', '.join(map(str, values))}")
        if not self.driver or not self.perception:
            raise ValueError("--driver and --perception need at least one name")
        for cell in self.cells:
            CourseConfig(self.goal_distance, cell.k, cell.slope_deg)  # says what is out of range

    @property
    def cells(self) -> list[Cell]:
        return [Cell(k, slope) for k in (self.k or (None,)) for slope in (self.slope_deg or (None,))]

    def content(self) -> dict[str, Any]:
        """What an episode's outcome depends on, beside its driver, perception, cell and number."""
        return {name: getattr(self, name) for name in ("seed", "scene", "goal_distance", "dynamics", "renderer")}


@dataclass(frozen=True)
class Task:
    """One episode to drive."""

    driver: str
    perception: str
    cell: Cell
    episode: int

    @property
    def file(self) -> str:
        plain = "".join(c if c.isalnum() or c in ".-" else "_" for c in f"{self.perception}-{self.cell.name}")
        if ":" in self.perception:
            plain += f"-{crc32(self.perception.encode()):08x}"  # paths may differ in nothing but what became "_"
        return f"{self.driver}-{plain}-{self.episode:04d}.json"


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Drive what is not driven yet, write the report, and return the content of results.json.

    Raises DatasetError if the folder holds other settings' episodes, ValueError for an unknown perception.
    """
    for name in config.perception:
        _perception(name)  # a name that means nothing is told before anything is written or started
    folder = config.out / "episodes"
    folder.mkdir(parents=True, exist_ok=True)
    weights = _same_settings(config)
    tasks = [
        Task(driver, perception, cell, episode)
        for episode in range(config.episodes)
        for cell in config.cells
        for driver in config.driver
        for perception in config.perception
    ]
    missing = [task for task in tasks if not (folder / task.file).is_file()]
    _run(config, missing, lambda task, record: write_json(folder / task.file, asdict(record)))
    records = [_read_record(folder / task.file) for task in tasks]
    results = []
    for cell in config.cells:
        for driver in config.driver:
            for perception in config.perception:
                chosen = [r for r in records if (r.driver, r.perception, r.cell) == (driver, perception, cell.name)]
                results.append({"driver": driver, "perception": perception, "cell": asdict(cell), **summarise(chosen)})
    content = {
        "config": json.loads(json.dumps({**asdict(config), "out": str(config.out)})),
        "weights": weights,
        "results": results,
    }
    write_json(config.out / "results.json", content)
    write_report(config.out, results, records)
    return content


def _same_settings(config: EvaluateConfig) -> dict[str, str]:
    """Check that the folder's episodes were driven under these settings and weights, and note both there.

    Returns the SHA-256 of the weights of each perception that has some. Raises DatasetError if they differ.
    """
    asked = config.out / "evaluate.json"
    weights = {name: digest for name in config.perception if (digest := _weights_digest(name))}
    if asked.is_file():
        before = read_json(asked)
        known = before.pop("weights", {})
        if before != config.content():
            raise DatasetError(f"{asked}: the folder holds episodes of other settings; choose another --out")
        for name in sorted(set(weights) & set(known)):
            if weights[name] != known[name]:
                raise DatasetError(f"{asked}: {name} drove with other weights then; choose another --out")
        weights = {**known, **weights}
    write_json(asked, {**config.content(), "weights": weights})
    return {name: weights[name] for name in config.perception if name in weights}


def _weights_digest(perception: str) -> str | None:
    name, _, path = perception.partition(":")
    if name != "m3depth":
        return None
    from m3depth.network.model import SHIPPED_WEIGHTS

    return hashlib.sha256((Path(path) if path else SHIPPED_WEIGHTS).read_bytes()).hexdigest()


def _run(config: EvaluateConfig, tasks: list[Task], done: Callable[[Task, EpisodeRecord], None]) -> None:
    with tqdm(total=len(tasks), unit="episode", desc="drive", disable=None) as bar:

        def finished(task: tuple[EvaluateConfig, Task], record: EpisodeRecord) -> None:
            done(task[1], record)
            bar.update()

        run_tasks(drive, [(config, task) for task in tasks], finished, config.workers, config.scheduler)


def _read_record(path: Path) -> EpisodeRecord:
    try:
        return EpisodeRecord(**read_json(path))
    except TypeError:
        raise DatasetError(f"{path}: not an episode of this version; delete it, and it is driven anew") from None


def drive(config: EvaluateConfig, task: Task) -> EpisodeRecord:
    """Drive one episode."""
    perception = _perception(task.perception)
    env = MarsNavEnv(perception, config.dynamics, config.renderer, config.scene, config.goal_distance, mast=True)
    try:
        driver = make_driver(task.driver)
        return run_episode(env, driver, task.cell, config.seed, task.episode, (task.driver, task.perception))
    finally:
        env.close()


@cache
def _perception(name: str) -> str | Estimator:
    """What an environment takes as perception, of this process: loading a network once is enough."""
    return load_perception(name) or name


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return run_command(_work, EvaluateConfig, "python -m envs.evaluate", __doc__, args)


def _work(config: EvaluateConfig) -> None:
    content = evaluate(config)
    print((config.out / "results.md").read_text())
    rows = counted(len(content["results"]), "row")
    print(f"{rows} in {config.out / 'results.json'}, drives in {config.out / 'map.png'}")


if __name__ == "__main__":
    from envs.evaluate import main as command  # by its own name, by which workers elsewhere can import it too

    sys.exit(command())
