"""The settings of an evaluation of drives, and the episodes that follow from them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal
from zlib import crc32

import tyro

from envs.courses.course import CourseConfig, check_rocks
from envs.drivers.by_name import check_driver_name
from envs.drives.episodes import Cell, EpisodeRecord
from envs.drives.place_note import place_note
from envs.suites.conditions import CONDITIONS, condition_values, course_under, under, with_look
from envs.suites.suite import suite_note
from envs.world.arguments import ERROR_LIMITS
from envs.world.eyes import AS_IMAGES, FAST_PIXELS, EyesConfig
from envs.world.perception import GROUND_TRUTH
from envs.world.slip import SlipConfig
from envs.world.vehicle import DynamicsName, checked_dynamics, dynamics_of_name
from m3depth.runtimes.choice import RuntimeChoice
from marssim.base.command.limits import check_least
from marssim.physics.soil.soil_map import GroundName
from marssim.render.renderers.by_name import RendererName
from marssim.scene.look import LOOK_LIMITS
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS
from marssim.scene.scene import SceneConfig

SETTINGS = "evaluate.json"  # file in OUT with the settings of its episodes
LOOK_FLAGS = (  # flags that replace fields of the scene's LookConfig
    "sun_elevation_deg", "optical_depth", "albedo_contrast", "texture_strength", "pebbles", "wind_ripples",
)  # fmt: skip
DEV = "dev"  # the split to choose settings by
MOST_BYTES = 120  # of the names of driver and perception in the name of a record's file
CONDITION_HELP = (
    f"Conditions to drive under, each a physical cause by name: {', '.join(CONDITIONS)} (envs.suites.conditions). "
    "Their values replace those of the other flags; one with rocks or a slope of its own is refused beside --k or "
    "--slope-deg. With --suite: some of its conditions; left out, all of them."
)
GRID_K = (0.033, 0.07, 0.10, 0.15, 0.20)  # rock abundances of --grid
GRID_SLOPE_DEG = (0.0, 5.0, 10.0, 15.0)  # [deg] slopes of --grid
SHARD = re.compile(r"([0-9]{1,9})/([0-9]{1,9})")  # of --shard


@dataclass(frozen=True)
class EvaluateConfig:
    """Drive frozen episodes and report success, SPL, collisions and time."""

    out: Path
    """Folder for results.json, results.md, results.html, plots, maps, videos and the episodes."""
    driver: tuple[str, ...] = ("navigator",)
    """Who drives: navigator (plans on a map of its depth), oracle (the navigator, which knows the true heights of the
    whole course), straight (heads for the goal, blind), random, a policy of
    stable-baselines3 (FILE.zip), or package.module:Class. Several drivers are compared on the same courses."""
    perception: tuple[str, ...] = ("m3depth",)
    """Method that turns the images into depth: m3depth (the shipped weights), sgbm, ground_truth (true depth),
    m3depth:WEIGHTS (a .safetensors file), another classical method that m3depth.evaluate --baselines lists, or
    package.module:Class (a class with infer(left, right, rig)). Several methods are compared on the same courses."""
    episodes: int | None = None
    """Number of courses, 1 or more, for each --condition, --k and --slope-deg. Left out: 10, or all of --suite."""
    seed: int = 0
    """Seed of the courses, 0 or more."""
    workers: int = 1
    """Number of processes, 1 or more. The courses do not depend on it."""
    scheduler: str | None = None
    """Address of a dask scheduler, tcp://host:8786, whose workers drive instead."""
    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place of the courses: a preset, or the JSON file of a place (marssim.scene.place_file)."""
    sun_elevation_deg: float | None = None
    """Height of the sun above the horizon [deg], above 0 and up to 90. Left out: drawn from the scene's range."""
    optical_depth: float | None = None
    """Optical depth of the dust in the air, 0 to 12: 0.3 is a clear sky, 1 a hazy one, 3 or more a dust storm. Left
    out: drawn from the scene's range."""
    albedo_contrast: float | None = None
    """Contrast of the ground's pattern of bright and dark patches: 0 has none, 1 is typical, 3 the most. Left out:
    drawn from the scene's range."""
    texture_strength: float | None = None
    """Height of the relief that is finer than the mesh (texture, which stereo matches): 0 has none, 1 is typical, 3 the
    most. Left out: drawn from the scene's range."""
    pebbles: float | None = None
    """Number of the single pebbles of 0.5 to 8 cm on ground without sand, which the mesh does not hold: 0 has none, 1
    the most. Left out: drawn from the scene's range."""
    wind_ripples: float | None = None
    """Share of the ground without gravel that is sand with hand-wide ripples, 0 to 1. Left out: drawn from the scene's
    range."""
    eyes: Annotated[EyesConfig, tyro.conf.arg(name="")] = field(default_factory=EyesConfig)
    into_sun: bool = False
    """Put the sun over the goal, as seen from the start. Else its direction is drawn."""
    ditch: bool = False
    """Cut a ditch across the straight path to the goal, which the rover has to drive round."""
    condition: Annotated[tuple[str, ...], tyro.conf.arg(help=CONDITION_HELP)] = ()
    suite: str | None = None
    """Suite of episodes to drive: the name of one in the package (marsnav-v1), or the JSON file of one. It fixes the
    courses and the conditions, and refuses a simulator that builds other scenes."""
    split: str = DEV
    """Split of the suite: dev to choose settings by, test to report, or what a file of yours has."""
    shard: str | None = None
    """Drive one part of N of the courses, as 2/8 for the second of eight, 1 or more. All parts have the same settings
    but for --out; python -m envs.join joins their results."""
    k: tuple[float, ...] = ()
    """Rock abundances to drive in, Golombek's k, 0 to 0.4. Left out: that of the scene."""
    slope_deg: tuple[float, ...] = ()
    """Regional slopes to drive on [deg], 0 to 25. Left out: that of the scene."""
    grid: bool = False
    """Drive the frozen grid, k .033 .07 .10 .15 .20 by slopes 0 5 10 15 deg, instead of --k and --slope-deg."""
    goal_distance: float = 20.0
    """Distance from start to goal [m], 3 to 100, and 12 or more with --ditch."""
    dynamics: DynamicsName | None = None
    """How the rover moves: physics (rigid bodies in PyBullet) or kinematic (settling without dynamics, faster). Left
    out: physics, or kinematic where PyBullet is not installed."""
    renderer: RendererName = "embree"
    """Renderer of the cameras' images."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth: pytorch; openvino, on the CPU, with the extra `fast`; or auto, which is openvino if it
    is installed and there is no GPU, and else pytorch."""
    disparity_noise: float = 0.0
    """Standard deviation of an error added to the disparity [px of an image that is 512 px wide], 0 to 10. In one that
    is half as wide, half of it is added."""
    align_rows: bool = True
    """Align the rows of the two images where they lie significantly apart, before the perception sees them."""
    drift: float = 0.0
    """Error of the position by the rover's odometry: its standard deviation along each axis after 1 m of driving [m],
    0 to 1. It grows with the root of the distance: 0.02 is 2 cm after 1 m and 9 cm after 20 m."""
    yaw_drift_deg: float = 0.0
    """Error of the heading by the rover's odometry: its standard deviation after 1 m of driving [deg], 0 to 45. It
    grows with the root of the distance."""
    slip: GroundName | None = None
    """Let the wheels slip and sink: in the sand, crust and bedrock that the scene shows (scene), or in one of these
    everywhere. Left out: they do not slip."""
    slip_measured: float = 0.0
    """Share of the slip that the rover's odometry measures, with --slip, 0 to 1: 0 counts the wheels' turns, 1 sees the
    true path, as visual odometry does at best."""
    scores: tuple[Path, ...] = ()
    """Files results.json that m3depth.evaluate wrote. For each perception that they score, results.md then shows the
    depth error (Abs Rel) on that test set beside the one on the drives."""
    videos: bool = True
    """Film the best drive (the arrival with the highest SPL) and the worst (which covered least of its distance).
    There is one film if both are the same drive, and no best.mp4 if no drive arrived. For a film, the course is driven
    once more, with pictures of every step: that takes longer than the drive."""
    film_courses: tuple[int, ...] = ()
    """Numbers of courses, 0 to one less than --episodes, as the pictures in OUT/maps show them, and of --shard if that
    is given. Every drive over these courses is filmed too, into a file in OUT/videos."""
    bag_courses: tuple[int, ...] = ()
    """Numbers of courses, 0 to one less than --episodes, and of --shard if that is given. Every drive over these
    courses is driven once more and written as a ROS 2 bag into a folder in OUT/bags: images, depth, planned path,
    command, status and poses. It needs the extra `real`."""
    record: Literal["none", "failures", "all"] = "none"
    """Drives to record step by step into OUT/drives: none, failures (those that do not reach the goal) or all. Each
    gets a page, which OUT/results.html links and which opens in a browser: what the rover saw and weighed at each step,
    and why it went as it did. Drives without a record yet are driven again."""

    def __post_init__(self) -> None:
        check_least(self, workers=1, seed=0)
        if self.episodes is not None:
            check_least(self, episodes=1)
        if self.grid and (self.k or self.slope_deg):
            raise ValueError("--grid replaces --k and --slope-deg: give one or the others")
        for name in self.driver:
            check_driver_name(name)
        for flag, names in (("--driver", self.driver), ("--perception", self.perception)):
            for name in names:
                try:
                    name.encode()
                except UnicodeEncodeError:  # results and pages could not hold the name
                    raise ValueError(f"{flag} {name!r}: is not UTF-8 text; rename the file") from None
        for flag, values in vars(self).items():
            if isinstance(values, tuple) and len(set(values)) < len(values):
                given = ", ".join(map(str, values))
                raise ValueError(f"--{flag.replace('_', '-')} has a value twice: {given}; give each once")
        for flag, numbers in (("--k", self.k), ("--slope-deg", self.slope_deg)):
            if len({f"{number:.12g}" for number in numbers}) < len(numbers):
                given = ", ".join(map(str, numbers))
                raise ValueError(f"{flag} has values that are the same in 12 digits: {given}; give each once")
        for flag, most in ERROR_LIMITS.items():
            if not 0 <= getattr(self, flag) <= most:
                raise ValueError(f"--{flag.replace('_', '-')} must lie in [0, {most}], got {getattr(self, flag)}")
        if not 0 <= self.slip_measured <= 1:
            raise ValueError(f"--slip-measured must lie in [0, 1], got {self.slip_measured}")
        if self.slip_measured and self.slip is None:
            raise ValueError("--slip-measured needs --slip, as no wheel slips without it")
        if self.suite is None:
            self._check_conditions()
        shard_of(self.shard)  # raises ValueError for anything but I/N
        for name in LOOK_FLAGS:
            low, high = LOOK_LIMITS[name]
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"--{name.replace('_', '-')} must lie in [{low:g}, {high:g}], got {value:g}")
        for flag in ("film_courses", "bag_courses"):
            numbers = getattr(self, flag)
            most = self.courses if self.suite is None or self.episodes else max(numbers, default=0) + 1
            for number in numbers:
                if not 0 <= number < most:
                    raise ValueError(f"--{flag.replace('_', '-')} must lie in [0, {most - 1}], got {number}")
        if not self.driver or not self.perception:
            raise ValueError("--driver and --perception need at least one name")
        self.scene_config()  # raises ValueError for a value out of range
        for cell in self.cells:
            self.course_config(cell.k, cell.slope_deg)  # raises ValueError for a value out of range
        if self.suite is None:
            self._check_rocks()

    def _check_conditions(self) -> None:
        """Raise ValueError for a condition that is unknown, or does not go with other flags; without a suite."""
        if self.split != DEV:
            raise ValueError("--split needs --suite, which has the splits")
        for name in self.condition:
            values = condition_values(name)
            for flag in ("k", "slope_deg"):
                if flag in values and (self.grid or getattr(self, flag)):
                    given = "grid" if self.grid else flag.replace("_", "-")
                    raise ValueError(f"--{given} does not go with --condition {name}, which has its own {flag}")
            course_under(values, CourseConfig(self.goal_distance, into_sun=self.into_sun, ditch=self.ditch))

    def _check_rocks(self) -> None:
        """Raise ValueError for courses whose scenes cannot hold their rocks; without a suite."""
        for cell in self.cells:
            course = self.course_config(cell.k, cell.slope_deg)
            scene, course, _ = under(cell.condition or {}, load_place(self.scene), course, EyesConfig())
            check_rocks(scene, course)

    @property
    def courses(self) -> int:
        """Number of courses for each cell, without a suite's."""
        return 10 if self.episodes is None else self.episodes

    @property
    def cells(self) -> list[Cell]:
        """Every condition with every k and every slope."""
        ks, slopes = (GRID_K, GRID_SLOPE_DEG) if self.grid else (self.k, self.slope_deg)
        return [
            Cell(k, slope, condition)
            for condition, k, slope in product(self.condition or (None,), ks or (None,), slopes or (None,))
        ]

    @property
    def tasks(self) -> list[Task]:
        """Every episode of the shard, those of one course together."""
        part, parts = shard_of(self.shard)
        courses = list(product(range(self.courses), self.cells))[part::parts]
        return [
            Task(driver, perception, cell, episode)
            for (episode, cell), driver, perception in product(courses, self.driver, self.perception)
        ]

    def check_shard(self) -> None:
        """Raise ValueError if the part that --shard names has no course, or not those that another flag names."""
        if not self.tasks:
            courses = self.courses * len(self.cells)
            most = "there is only one course" if courses == 1 else f"use {courses} parts or fewer, one for each course"
            raise ValueError(f"--shard {self.shard} has no episode: {most}")
        for flag in ("film_courses", "bag_courses"):
            for number in getattr(self, flag):
                if number not in {task.episode for task in self.tasks}:
                    raise ValueError(
                        f"--{flag.replace('_', '-')} {number}: --shard {self.shard} drives no course of this number"
                    )

    def scene_config(self) -> SceneConfig:
        """Return the place with the given values instead of its ranges. Raises ValueError for a value out of range."""
        return with_look(load_place(self.scene), self.look_flags())

    def look_flags(self) -> dict[str, float]:
        """Return the values of the look that flags give, by their names."""
        return {name: getattr(self, name) for name in LOOK_FLAGS if getattr(self, name) is not None}

    def with_true_pixels(self) -> EvaluateConfig:
        """Return the settings with as many pixels of the true depth as of the images, where the two are compared.

        A suite says itself how many there are, and so may --ground-truth-pixels.
        """
        compared = GROUND_TRUTH in self.perception and len(self.perception) > 1
        if not compared or self.suite is not None or self.eyes.ground_truth_pixels is not None:
            return self
        return replace(self, eyes=replace(self.eyes, ground_truth_pixels=AS_IMAGES))

    def course_config(self, k: float | None = None, slope_deg: float | None = None) -> CourseConfig:
        """Return the settings of the courses. Raises ValueError for a value out of range."""
        return CourseConfig(self.goal_distance, k, slope_deg, into_sun=self.into_sun, ditch=self.ditch)

    def slip_config(self) -> SlipConfig | None:
        """Return how the wheels slip; None if they do not."""
        return None if self.slip is None else SlipConfig(self.slip, self.slip_measured)

    def content(self) -> dict[str, Any]:
        """Return the settings on which the outcome of an episode depends, beside its driver, perception, cell and
        number.
        """
        errors = {name: getattr(self, name) for name in ERROR_LIMITS if getattr(self, name)}
        slip = {} if self.slip is None else {"slip": self.slip, "slip_measured": self.slip_measured}
        eyes = {name: value for name, value in vars(self.eyes).items() if value != getattr(EyesConfig, name)}
        if self.eyes.ground_truth_pixels == FAST_PIXELS:
            del eyes["ground_truth_pixels"]
        course = {name: True for name in ("into_sun", "ditch") if getattr(self, name)}
        suite = {} if self.suite is None else suite_note(self.suite, self.split)
        return {
            "seed": self.seed, **place_note(self.scene), "goal_distance": self.goal_distance,
            "dynamics": dynamics_of_name(self.dynamics or checked_dynamics(None)), "renderer": self.renderer,
            "align_rows": self.align_rows, **errors, **slip, **self.look_flags(), **eyes, **course, **suite,
        }  # fmt: skip


@dataclass(frozen=True)
class Task:
    """One episode to drive."""

    driver: str
    """Name of the driver."""
    perception: str
    """Name of the perception."""
    cell: Cell
    """Rock abundance and slope."""
    episode: int
    """Number of the course."""

    @property
    def file(self) -> str:
        """Name of the record's file: letters, digits, "_", "-" and "." only, and different for each task.

        Of long names, such as paths, it has the end alone, since no file system takes more than 255 bytes.
        """
        names = f"{self.driver}-{self.perception}"
        short = _plain(names).encode()[-MOST_BYTES:].decode(errors="ignore")
        parts = [short, _plain(self.cell.name)]
        if short != names:  # names may differ only in letters that became "_", or in their beginning
            parts.append(f"{crc32(names.encode(errors='surrogateescape')):08x}")
        return f"{'-'.join(parts)}-{self.episode:04d}.json"

    def is_of(self, record: EpisodeRecord) -> bool:
        """Return whether a record is of this episode."""
        names = (self.driver, self.perception, self.cell.name, self.episode)
        return names == (record.driver, record.perception, record.cell, record.episode)


def shard_of(shard: str | None) -> tuple[int, int]:
    """Return which part of how many --shard names, the first being 0; (0, 1) for None.

    Raises:
        ValueError: It is not I/N with 1 <= I <= N and at most nine digits each.
    """
    if shard is None:
        return 0, 1
    matched = SHARD.fullmatch(shard)
    if matched is None or not 1 <= int(matched[1]) <= int(matched[2]):
        raise ValueError(f"shard must be I/N, such as 2/8 for the second part of eight, got {shard!r:.60}")
    return int(matched[1]) - 1, int(matched[2])


def _plain(words: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in words)
