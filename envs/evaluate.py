"""Score drivers and perceptions on frozen episodes of MarsNav-v0.

    python -m envs.evaluate --driver navigator --perception m3depth --episodes 10 --seed 1 --out out/eval
    python -m envs.evaluate --driver navigator straight --perception ground_truth --dynamics kinematic --grid \\
        --episodes 50 --workers 2 --out out/grid

All drivers and perceptions drive the same courses. Finished episodes stay in OUT/episodes: the same command continues
where it was stopped.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any
from zlib import crc32

import tyro

from envs.drivers.by_name import DRIVERS, make_driver
from envs.drivers.driver import Driver
from envs.drives.episodes import Cell, EpisodeRecord, Watch, run_episode
from envs.drives.metrics import best_and_worst, paired_difference, summarise
from envs.drives.records import DELETE_TO_REPEAT, read_record
from envs.drives.report import write_report
from envs.drives.resume import WEIGHTS, noted_digests
from envs.drives.step_lines import StepLines
from envs.drives.test_set_errors import errors_on_test_set
from envs.mars_nav import ERROR_LIMITS, MarsNavEnv
from envs.world.course import CourseConfig
from envs.world.perception import load_perception, perception_digest
from envs.world.place_note import place_note
from envs.world.vehicle import DynamicsName, chosen_dynamics, known_dynamics
from m3depth.estimator import Estimator
from marssim.base.command.notes import counted
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command
from marssim.base.compute.workers import run_tasks
from marssim.base.files.json_file import DatasetError, as_json, read_json, write_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import versions
from marssim.render.renderers.by_name import RendererName
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.scene import LOOK_LIMITS, PRESETS, SceneConfig

SETTINGS = "evaluate.json"  # file in OUT with the settings of its episodes
LOOK_FLAGS = (  # flags that replace fields of the scene's LookConfig
    "sun_elevation_deg", "optical_depth", "albedo_contrast", "texture_strength", "pebbles", "wind_ripples",
)  # fmt: skip
GRID_K = (0.033, 0.07, 0.10, 0.15, 0.20)  # rock abundances of --grid
GRID_SLOPE_DEG = (0.0, 5.0, 10.0, 15.0)  # [deg] slopes of --grid


@dataclass(frozen=True)
class EvaluateConfig:
    """Drive frozen episodes and report success, SPL, collisions and time."""

    out: Path
    """Folder for results.json, results.md, plots, maps, videos and the episodes."""
    driver: tuple[str, ...] = ("navigator",)
    """Who drives: navigator (plans on a map of its depth), straight (heads for the goal, blind), random, a policy of
    stable-baselines3 (FILE.zip), or package.module:Class. Several drivers are compared on the same courses."""
    perception: tuple[str, ...] = ("m3depth",)
    """Method that turns the images into depth: m3depth (the shipped weights), sgbm, ground_truth (true depth),
    m3depth:WEIGHTS (a .safetensors file), ssd, sad, ncc, ssd-sgm, sad-sgm, ncc-sgm, or package.module:Class (a class
    with infer(left, right, rig)). Several methods are compared on the same courses."""
    episodes: int = 10
    """Number of courses for each --k and --slope-deg."""
    seed: int = 0
    """Seed of the courses."""
    workers: int = 1
    """Number of processes. The courses do not depend on it."""
    scheduler: str | None = None
    """Address of a dask scheduler, tcp://host:8786, whose workers drive instead."""
    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place of the courses: a preset, or the JSON file of a place (marssim.scene.place_file)."""
    sun_elevation_deg: float | None = None
    """Height of the sun above the horizon [deg]. Left out: drawn from the scene's range."""
    optical_depth: float | None = None
    """Optical depth of the dust in the air: 0.3 is a clear sky, 1 a hazy one, 5 a dust storm. Left out: drawn from the
    scene's range."""
    albedo_contrast: float | None = None
    """Contrast of the ground's bright and dark patches, 0 to 3. Left out: drawn from the scene's range."""
    texture_strength: float | None = None
    """Strength of the relief below the mesh, 0 to 3. Stereo matches this texture, pebbles and wind ripples. Left out:
    drawn from the scene's range."""
    pebbles: float | None = None
    """Strength of pebbles and grain too small for the mesh, 0 to 1. Left out: drawn from the scene's range."""
    wind_ripples: float | None = None
    """Share of the ground with ripples a hand wide, 0 to 1. Left out: drawn from the scene's range."""
    k: tuple[float, ...] = ()
    """Rock abundances to drive in, Golombek's k. Left out: that of the scene."""
    slope_deg: tuple[float, ...] = ()
    """Regional slopes to drive on [deg]. Left out: that of the scene."""
    grid: bool = False
    """Drive the frozen grid, k .033 .07 .10 .15 .20 by slopes 0 5 10 15 deg, instead of --k and --slope-deg."""
    goal_distance: float = 20.0
    """Distance from start to goal [m]."""
    dynamics: DynamicsName | None = None
    """How the rover moves: physics (rigid bodies in PyBullet) or kinematic (settling without dynamics, faster). Left
    out: physics, or kinematic where PyBullet is not installed."""
    renderer: RendererName = "embree"
    """Renderer of the cameras' images."""
    disparity_noise: float = 0.0
    """Standard deviation of an error added to the disparity [px]."""
    drift: float = 0.0
    """Standard deviation of the odometry's position error after 1 m [m]."""
    yaw_drift_deg: float = 0.0
    """Standard deviation of the odometry's heading error after 1 m [deg]."""
    scores: tuple[Path, ...] = ()
    """Files results.json of m3depth.evaluate. The report sets the Abs Rel of m3depth and sgbm on the test set beside
    that on the way."""
    videos: bool = True
    """Film the best drive (the arrival with the highest SPL) and the worst (the one that covered least of its way).
    Both are driven once more for the film, and pictures of every step take longer than the drive."""
    film_courses: tuple[int, ...] = ()
    """Numbers of courses, as in maps/, of which all drives are filmed into OUT/videos too."""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ValueError(f"--episodes must be at least 1, got {self.episodes}")
        if self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        if self.grid and (self.k or self.slope_deg):
            raise ValueError("--grid is given instead of --k and --slope-deg")
        for name in self.driver:
            if name not in DRIVERS and ":" not in name and not name.endswith(".zip"):
                known = ", ".join(DRIVERS)
                raise ValueError(f"--driver {name!r} is unknown; choose from {known}, FILE.zip, package.module:Class")
        for flag, values in vars(self).items():
            if isinstance(values, tuple) and len(set(values)) < len(values):
                raise ValueError(f"--{flag.replace('_', '-')} has a value twice: {', '.join(map(str, values))}")
        for flag, most in ERROR_LIMITS.items():
            if not 0 <= getattr(self, flag) <= most:
                raise ValueError(f"--{flag.replace('_', '-')} must lie in [0, {most}], got {getattr(self, flag)}")
        for name in LOOK_FLAGS:
            low, high = LOOK_LIMITS[name]
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"--{name.replace('_', '-')} must lie in [{low:g}, {high:g}], got {value:g}")
        for number in self.film_courses:
            if not 0 <= number < self.episodes:
                raise ValueError(f"--film-courses must lie in [0, {self.episodes - 1}], got {number}")
        if not self.driver or not self.perception:
            raise ValueError("--driver and --perception need at least one name")
        self.scene_config()  # raises ValueError for a value out of range
        for cell in self.cells:
            CourseConfig(self.goal_distance, cell.k, cell.slope_deg)  # raises ValueError for a value out of range

    @property
    def cells(self) -> list[Cell]:
        """Every k with every slope."""
        ks, slopes = (GRID_K, GRID_SLOPE_DEG) if self.grid else (self.k, self.slope_deg)
        return [Cell(k, slope) for k in (ks or (None,)) for slope in (slopes or (None,))]

    def scene_config(self) -> SceneConfig:
        """Return the place with the given values instead of its ranges. Raises ValueError for a value out of range."""
        base = load_place(self.scene)
        fixed = {name: (getattr(self, name),) * 2 for name in LOOK_FLAGS if getattr(self, name) is not None}
        return replace(base, look=replace(base.look, **fixed))

    def content(self) -> dict[str, Any]:
        """Return the settings on which the outcome of an episode depends, beside its driver, perception, cell and
        number.
        """
        errors = {name: getattr(self, name) for name in ERROR_LIMITS if getattr(self, name)}
        look = {name: getattr(self, name) for name in LOOK_FLAGS if getattr(self, name) is not None}
        return {
            "seed": self.seed, **place_note(self.scene), "goal_distance": self.goal_distance,
            "dynamics": known_dynamics(self.dynamics), "renderer": self.renderer, **errors, **look,
        }  # fmt: skip


@dataclass(frozen=True)
class Task:
    """One episode to drive."""

    driver: str
    perception: str
    cell: Cell
    episode: int

    @property
    def file(self) -> str:
        """Name of the record's file: letters, digits, "_", "-" and "." only, and different for each task."""
        names = f"{self.driver}-{self.perception}"
        plain = _plain(f"{names}-{self.cell.name}")
        if _plain(names) != names:
            plain += f"-{crc32(names.encode()):08x}"  # names may differ only in letters that became "_"
        return f"{plain}-{self.episode:04d}.json"

    def is_of(self, record: EpisodeRecord) -> bool:
        """Return whether a record is of this episode."""
        names = (self.driver, self.perception, self.cell.name, self.episode)
        return names == (record.driver, record.perception, record.cell, record.episode)


def _plain(words: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in words)


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Drive the episodes that are missing, write the report, and return the content of results.json.

    Raises:
        DatasetError: If the folder holds episodes of other settings, or anything else.
        FolderInUse: If another command writes to the folder.
        ValueError: If a perception or a driver is unknown.
    """
    config = replace(config, dynamics=chosen_dynamics(config.dynamics))
    for name in config.perception:
        _perception(name)  # an unknown name is reported before anything is written or started
    for name in config.driver:
        make_driver(name)
    test_errors = errors_on_test_set(config.scores, {name: perception_digest(name) for name in config.perception})
    results = ResultFolder(config.out, "evaluation", SETTINGS, config.content(), notes=(WEIGHTS,))
    with results.claim():
        digests = noted_digests(results, (*config.perception, *config.driver))
        return _evaluate(config, digests, test_errors)


def _evaluate(config: EvaluateConfig, digests: dict[str, str], test_errors: dict[str, float]) -> dict[str, Any]:
    folder = config.out / "episodes"
    folder.mkdir(exist_ok=True)
    tasks = [
        Task(driver, perception, cell, episode)
        for episode, cell, driver, perception in product(
            range(config.episodes), config.cells, config.driver, config.perception
        )
    ]
    missing = [task for task in tasks if not (folder / task.file).is_file()]
    _run(config, missing, lambda task, record: write_json(folder / task.file, asdict(record)))
    records = [_read_record(folder, task) for task in tasks]
    content = {
        "config": as_json(asdict(config)),
        "driven_with": config.content(),
        "weights": digests,
        "code": dict(Counter(record.code for record in records)),
        "versions": versions(),
        "test_set_abs_rel": test_errors,
        "results": _results(config, records),
        "differences": _differences(config, records),
    }
    write_json(config.out / "results.json", content)
    write_report(config.out, content, records)
    _film(config, tasks, records)
    return content


def _results(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> list[dict[str, Any]]:
    """Return a row for each cell, driver and perception."""
    rows = []
    for cell in config.cells:
        for driver, perception in product(config.driver, config.perception):
            drives = [r for r in records if (r.driver, r.perception, r.cell) == (driver, perception, cell.name)]
            rows.append({"driver": driver, "perception": perception, "cell": asdict(cell), **summarise(drives)})
    return rows


def _differences(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> list[dict[str, Any]]:
    """Return success and SPL of every driver and perception less those of the first, paired, over all cells."""
    groups = list(product(config.driver, config.perception))
    drives = {group: [r for r in records if (r.driver, r.perception) == group] for group in groups}
    first = groups[0]
    return [
        {
            "driver": group[0], "perception": group[1], "less": list(first),
            **paired_difference(drives[group], drives[first]),
        }
        for group in groups[1:]
    ]  # fmt: skip


def _film(config: EvaluateConfig, tasks: Sequence[Task], records: Sequence[EpisodeRecord]) -> None:
    """Make the films that are asked for and missing; tasks: those of the records, in their order."""
    chosen: dict[str, Task] = {}
    if config.videos:
        best, worst = best_and_worst(records)
        chosen = {"best.mp4": tasks[best], "worst.mp4": tasks[worst]}
    for task in tasks:
        if task.episode in config.film_courses:
            chosen[f"videos/{Path(task.file).stem}.mp4"] = task
    if not chosen:
        return
    from envs.drives.film import Film

    noted = config.out / "videos.json"
    filmed = read_json(noted) if noted.is_file() else {}
    for name, task in chosen.items():
        path = config.out / name
        if filmed.get(name) == task.file and path.is_file():
            continue
        path.parent.mkdir(exist_ok=True)
        write_json(noted, {other: file for other, file in filmed.items() if other != name})  # until it is whole
        with Film(path, f"{task.driver}, {task.perception}: course {task.episode}, {task.cell.name}") as film:
            drive(config, task, film.watch)
        filmed[name] = task.file
        write_json(noted, filmed)


def _run(config: EvaluateConfig, tasks: list[Task], done: Callable[[Task, EpisodeRecord], None]) -> None:
    with progress(len(tasks), "episode", "drive") as bar:

        def finished(task: tuple[EvaluateConfig, Task], record: EpisodeRecord) -> None:
            done(task[1], record)
            bar.update()

        run_tasks(drive, [(config, task) for task in tasks], finished, config.workers, config.scheduler)


def _read_record(folder: Path, task: Task) -> EpisodeRecord:
    path = folder / task.file
    record = read_record(path)
    if not task.is_of(record):
        actual = f"{record.driver}, {record.perception}, course {record.episode}"
        raise DatasetError(f"{path}: is the record of {actual}{DELETE_TO_REPEAT}")
    return record


def drive(config: EvaluateConfig, task: Task, watch: Watch | None = None) -> EpisodeRecord:
    """Drive one episode. watch: as run_episode takes it."""
    driver = make_driver(task.driver)
    name = f"course {task.episode}, {task.cell.name}, {task.driver}, {task.perception}"
    lines = StepLines(name, lambda: _drives_done(config))

    def watched(env: MarsNavEnv, driver: Driver, step: int) -> None:
        lines.watch(env, driver, step)
        if watch is not None:
            watch(env, driver, step)

    env = MarsNavEnv(
        _perception(task.perception), known_dynamics(config.dynamics), config.renderer, config.scene_config(),
        config.goal_distance,
        mast=True, map_observation=bool(getattr(driver, "needs_map", False)),
        disparity_noise=config.disparity_noise, drift=config.drift, yaw_drift_deg=config.yaw_drift_deg,
    )  # fmt: skip
    try:
        return run_episode(env, driver, task.cell, config.seed, task.episode, (task.driver, task.perception), watched)
    finally:
        env.close()


def _drives_done(config: EvaluateConfig) -> str:
    """Return how many drives are finished, as a worker sees it from the files."""
    total = config.episodes * len(config.cells) * len(config.driver) * len(config.perception)
    return f"{len(list((config.out / 'episodes').glob('*.json')))} of {counted(total, 'drive')} done"


@cache
def _perception(name: str) -> str | Estimator:
    """Return what an environment takes as perception; each process loads a network once."""
    return load_perception(name) or name


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, EvaluateConfig, "python -m envs.evaluate", __doc__, args)


def _work(config: EvaluateConfig) -> None:
    content = evaluate(config)
    print((config.out / "results.md").read_text())
    rows = counted(len(content["results"]), "row")
    print(f"{rows} in {config.out / 'results.json'}, drives in {config.out / 'maps'}")


if __name__ == "__main__":
    from envs.evaluate import main as command  # not __main__, so that workers elsewhere can import what is pickled

    sys.exit(command())
