"""Frozen episodes: the same course for every driver and perception, by seed, rock abundance and slope."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from time import perf_counter
from typing import Any

import numpy as np

from envs.courses.course import series_seed
from envs.drivers.driver import Driver, Stop
from envs.mars_nav import MarsNavEnv
from envs.world.action import ActionError
from envs.world.look_scores import GroundAsSky, RockErrors, is_blind, look_abs_rel, look_ground_as_sky, look_rock_errors
from envs.world.user_code import UserCodeError, code_digest, errors_of
from marssim.physics.state import RoverState
from marssim.scene.scene import Scene

RELIEF_CELL = 1.0  # [m] between the heights that a record keeps, roughly
NEAR_MISS = 0.10  # [m] of clearance (envs.courses.clearance) below which a drive without collision is a near miss

# Called with environment, driver and step: after the reset (step 0), after every step, and once more after the last one
# if the driver ends the drive: env.outcome then names its reason.
Watch = Callable[[MarsNavEnv, Driver, int], None]


@dataclass(frozen=True)
class Cell:
    """A cell of the grid of an evaluation: the conditions of an episode."""

    k: float | None = None
    """Rock abundance, Golombek's k; None for that of the scene preset."""
    slope_deg: float | None = None
    """Regional slope [deg]; None for that of the scene preset."""
    condition: str | None = None
    """Name of the condition that the environment was made with, for the record (envs.suites.conditions); None for
    none."""

    @property
    def name(self) -> str:
        """The cell in words, as records and tables have it."""
        if self.condition is not None and self.k is None and self.slope_deg is None:
            return f"condition={self.condition}"
        k, slope = ("preset" if value is None else f"{value:.12g}" for value in (self.k, self.slope_deg))
        values = f"k={k}, slope={slope}"
        return values if self.condition is None else f"condition={self.condition}, {values}"

    @property
    def options(self) -> dict[str, float]:
        """The options of MarsNavEnv.reset that the cell sets."""
        values = {"k": self.k, "slope_deg": self.slope_deg}
        return {name: value for name, value in values.items() if value is not None}

    def content(self) -> dict[str, Any]:
        """Return the cell as results.json has it: k, slope_deg, and the condition if there is one."""
        return {name: value for name, value in vars(self).items() if name != "condition" or value is not None}


class Cause(StrEnum):
    """Why a drive of the navigator failed (envs.recording.failure_cause)."""

    ODOMETRY = "odometry error"
    """It ended away from the goal or beyond the ground, and believed otherwise; or it hit, or tilted on, an obstacle
    that the map of true depth shows only where true poses make it."""
    KNOWN_OBSTACLE = "known obstacle"
    """It hit, or tilted on, an obstacle that the navigator's map shows."""
    MISSED_OBSTACLE = "missed obstacle"
    """It hit, or tilted on, an obstacle that the navigator's map lacks, and that of true depth shows."""
    UNSEEN_OBSTACLE = "unseen obstacle"
    """It hit, or tilted on, something that even the map of true depth does not show as an obstacle."""
    FALSE_OBSTACLES = "false obstacles"
    """Obstacles that are not there block the path: with the true ground in their place, a path is open."""
    UNMEASURED_GROUND = "unmeasured ground"
    """Ground without depth blocks the path: with the true ground there, a path is open."""
    BOTH = "false obstacles and unmeasured ground"
    """A path is open only if both are corrected."""
    OTHER_ERRORS = "other map errors"
    """No path is open even then, but one is on the map of true depth."""
    NO_TRUE_PATH = "no path with true depth"
    """On the map of true depth, no path is open either."""
    NO_PROGRESS = "no progress"
    """A path was open on the navigator's map, and the rover was stuck."""
    DETOUR = "detour"
    """A path was open when the drive ended: it had taken too long, or left the ground."""


def causes_of(outcome: str) -> frozenset[Cause]:
    """Return the causes that a drive of the navigator can have by its outcome."""
    contact = {Cause.KNOWN_OBSTACLE, Cause.MISSED_OBSTACLE, Cause.UNSEEN_OBSTACLE}
    if outcome == "goal":
        return frozenset()
    if outcome == "elsewhere":
        return frozenset({Cause.ODOMETRY})
    if outcome in ("collision", "tilt"):
        return frozenset(contact | {Cause.ODOMETRY})
    path = set(Cause) - contact - {Cause.ODOMETRY, Cause.NO_PROGRESS}
    if outcome == "out_of_bounds":
        return frozenset(path | {Cause.ODOMETRY})
    return frozenset(path - {Cause.DETOUR} | {Cause.NO_PROGRESS} if outcome == "stuck" else path)


@dataclass
class EpisodeRecord:
    """The outcome of one episode, as a file in the folder of an evaluation keeps it.

    Records of earlier releases lack headings, shortest_path and relief, and their abs_rel leaves out unknown depth.
    """

    driver: str
    """Name of the driver."""
    perception: str
    """Name of the perception."""
    cell: str
    """Name of the cell (Cell.name)."""
    episode: int
    """Number of the course."""
    outcome: str
    """The outcome as MarsNavEnv's info names it, or the driver's reason to stop (envs.drivers.Stop): "no_path" if it
    gave up, "elsewhere" if it believed that it was at the goal and was not, as happens when the odometry drifts."""
    steps: int
    """Number of steps."""
    distance: float
    """Distance to the goal at the end [m]."""
    start_distance: float
    """Distance to the goal at the start [m]."""
    shortest: float
    """Length of the shortest passable path [m]."""
    path_length: float
    """Length of the way driven [m]."""
    min_clearance: float
    """Least clearance from rocks that block, drops and steep ground [m], as in MarsNavEnv's info."""
    max_tilt_deg: float
    """Largest tilt [deg]."""
    reward: float
    """Sum of the rewards."""
    step_seconds: float
    """Mean time of a step: driver, perception and simulation [s]."""
    perception_seconds: float
    """Mean time of the perception in a step [s]."""
    redraws: int
    """Number of courses that were rejected, as no way led to their goal or an end was too near to steep ground."""
    goal: list[float]
    """x, y of the goal [m]."""
    abs_rel: float | None = None
    """Mean over the looks of their Abs Rel, as m3depth.evaluate scores a pair; None with the ground truth."""
    blind: int | None = None
    """Number of looks that measured nothing of the ground within 15 m; None where that was not recorded."""
    looks: int | None = None
    """Number of looks; None where that was not recorded, and the rover looked after every step."""
    rocks: int | None = None
    """Number of rocks of 0.2 m and more within 8 m that the looks showed, counted once a look; None with the ground
    truth, and where that was not recorded."""
    rocks_missed: int | None = None
    """Those of `rocks` of which the depth did not show half the height (m3depth.evaluation.rock_scores)."""
    false_obstacles: int | None = None
    """Number of obstacles of 0.2 m and more within 8 m that the depth showed and that were not there, over all looks;
    None as `rocks`."""
    near_ground: int | None = None
    """Number of pixels with a true depth below 8 m, over all looks; None as `rocks`."""
    near_ground_as_sky: int | None = None
    """Number of those that the depth took for sky."""
    near_miss: bool = False
    """Whether there was no collision, but the clearance was below NEAR_MISS."""
    slip: float | None = None
    """Share of the wheels' way that the rover did not make, mean over the steps in which it was to drive; below 0 if it
    slid downhill. None for wheels that do not slip, and for a drive without such a step."""
    energy: float | None = None
    """Energy of the wheels' motors [J]; None for wheels that do not slip."""
    cause: str | None = None
    """Why the drive failed, a value of Cause; None for one that reached the goal, that was not recorded, or that the
    navigator did not drive."""
    code: str = ""
    """State of the sources that drove (envs.world.user_code.code_digest); "" where that was not recorded."""
    obstacles: list[list[float]] = field(default_factory=list)
    """x, y, diameter of the rocks that block [m]."""
    track: list[list[float]] = field(default_factory=list)
    """x, y after every step, the start first [m]."""
    headings: list[float] = field(default_factory=list)
    """Yaw at the places of `track` [rad]."""
    shortest_path: list[list[float]] = field(default_factory=list)
    """Corners x, y of the shortest passable path, whose length is `shortest` [m]."""
    half: float = 0.0
    """Half the side of the square that `relief` covers [m]."""
    relief: list[list[float]] = field(default_factory=list)
    """Heights of the ground [m] in rows of constant y, over a square from -half to half."""


def is_near_miss(outcome: str, min_clearance: float) -> bool:
    """Return whether a drive came nearer to an obstacle than NEAR_MISS without a collision.

    Args:
        outcome: Of the drive.
        min_clearance: Its least clearance [m].
    """
    return outcome != "collision" and min_clearance < NEAR_MISS


def course_options(cell: Cell, seed: int, episode: int) -> dict[str, Any]:
    """Return the options of MarsNavEnv.reset that make the course of an episode.

    Its scene_seed depends on (seed, episode) alone.

    Args:
        cell: Rock abundance and slope. Its condition is the environment's affair.
        seed: Seed of the series of courses.
        episode: Number of the course.
    """
    return {"scene_seed": series_seed(seed, episode), **cell.options}


def run_episode(
    env: MarsNavEnv,
    driver: Driver,
    cell: Cell,
    seed: int,
    episode: int,
    names: tuple[str, str] = ("", ""),
    watch: Watch | None = None,
) -> EpisodeRecord:
    """Drive one episode to its end. The course depends on (seed, episode) and the cell alone.

    Args:
        env: The environment.
        driver: The driver.
        cell: Rock abundance and slope, which the reset sets, and the condition that `env` was made with.
        seed: Seed of the series of courses.
        episode: Number of the course.
        names: Driver and perception, for the record.
        watch: Called as watch(env, driver, step) after the reset (step 0), after every step, and again with the last
            step's number where the driver ends the drive; env.outcome then is the driver's reason.

    Returns:
        The record.

    Raises:
        ValueError: If the cell names a condition, and the environment was made with another or without any.
        ActionError: If the driver returns neither an action nor a Stop; the message names driver, step and course.
        UserCodeError: If a driver or a perception of the user raises an exception; the message names step and course.
    """
    code = code_digest()  # before the drive, as the sources may be edited during it
    log = _Log()
    try:
        _drive(env, driver, cell, course_options(cell, seed, episode), log, watch)
    except (ActionError, UserCodeError) as error:
        where = f"step {len(log.states)} of course {episode}, {cell.name}"
        if isinstance(error, ActionError):
            raise ActionError(f"driver {names[0]!r}, {where}: {error}") from None
        raise UserCodeError(f"{where}, by {names[0]} and {names[1]}: {error}") from error.__cause__
    assert env.course is not None
    steps, info = len(log.states) - 1, log.info
    return EpisodeRecord(
        driver=names[0], perception=names[1], cell=cell.name, episode=episode, outcome=info["outcome"], steps=steps,
        distance=info["distance"], start_distance=log.start_distance, shortest=info["shortest"],
        path_length=info["path_length"], min_clearance=info["min_clearance"], reward=log.reward,
        max_tilt_deg=float(np.rad2deg(max((state.tilt for state in log.states[1:]), default=0.0))),
        step_seconds=log.seconds / max(steps, 1), perception_seconds=log.perception_seconds / max(steps, 1),
        redraws=info["redraws"], goal=[float(v) for v in env.course.goal], abs_rel=mean_of_measured(log.errors),
        blind=log.blind, looks=log.looks, **log.depth_errors(),
        near_miss=is_near_miss(info["outcome"], info["min_clearance"]),
        slip=mean_of_measured(log.slips), energy=info.get("energy"), cause=None, code=code, obstacles=_obstacles(env),
        track=[[float(v) for v in state.position[:2]] for state in log.states],
        headings=[round(float(state.yaw), 4) for state in log.states],
        shortest_path=_rounded(env.course.ground.way_to_goal(*env.course.start[:2])),
        half=env.course.scene.half, relief=_relief(env.course.scene),
    )  # fmt: skip


@dataclass
class _Log:
    """Notes taken during a drive."""

    states: list[RoverState] = field(default_factory=list)
    errors: list[float | None] = field(default_factory=list)
    info: dict[str, Any] = field(default_factory=dict)
    start_distance: float = 0.0
    reward: float = 0.0
    seconds: float = 0.0
    perception_seconds: float = 0.0
    blind: int = 0
    looks: int = 0
    slips: list[float | None] = field(default_factory=list)
    rocks: list[RockErrors] = field(default_factory=list)
    near_ground: list[GroundAsSky] = field(default_factory=list)

    def note_step(self, env: MarsNavEnv, info: dict[str, Any]) -> None:
        """Note where the rover stands, and its look if it took one."""
        assert env.vehicle is not None and env.sight is not None
        self.info = info
        self.states.append(env.vehicle.state())
        if env.gaze.fresh:
            self.looks += 1
            self.errors.append(look_abs_rel(env.sight))
            self.blind += is_blind(env.sight)
            rocks = look_rock_errors(env.sight)
            self.rocks += [] if rocks is None else [rocks]
            ground = look_ground_as_sky(env.sight)
            self.near_ground += [] if ground is None else [ground]

    def depth_errors(self) -> dict[str, int]:
        """Return rocks, rocks_missed, false_obstacles, near_ground and near_ground_as_sky over all looks; nothing with
        the ground truth."""
        return {
            **_sums(("rocks", "rocks_missed", "false_obstacles"), self.rocks),
            **_sums(("near_ground", "near_ground_as_sky"), self.near_ground),
        }


def _sums(names: Sequence[str], looks: Sequence[tuple[int, ...]]) -> dict[str, int]:
    """Return the sums of the numbers of all looks by name; nothing without looks."""
    columns = zip(*looks, strict=True)
    return {name: sum(numbers) for name, numbers in zip(names, columns, strict=True)} if looks else {}


def _check_condition(cell: Cell, driven: str | Mapping[str, Any]) -> None:
    """Raise ValueError if the name of a cell's condition cannot be that of what the environment drives.

    Values without a name may be those of any condition, since suites have conditions of their own.
    """
    fits = cell.condition == driven if isinstance(driven, str) else driven or cell.condition == "clear"
    if cell.condition is not None and not fits:
        has = f"the condition {driven}" if driven else "none"
        raise ValueError(
            f"cell has the condition {cell.condition}, and the environment has {has}; make it by "
            f"MarsNavEnv(condition={cell.condition!r})"
        )


def _drive(
    env: MarsNavEnv, driver: Driver, cell: Cell, options: dict[str, Any], log: _Log, watch: Watch | None
) -> None:
    observation, info = env.reset(seed=options["scene_seed"], options=options)
    assert env.settings is not None
    _check_condition(cell, env.settings.condition)
    with errors_of(driver):
        driver.reset(env, options["scene_seed"])
    log.start_distance = info["distance"]
    log.note_step(env, info)
    if watch:
        watch(env, driver, 0)
    done = False
    while not done:
        begin = perf_counter()
        with errors_of(driver):
            action = driver.act(env, observation)
        if isinstance(action, Stop):
            log.info = {**log.info, "outcome": action.value}
            env.outcome = action.value
            if watch:
                watch(env, driver, len(log.states) - 1)
            return
        observation, reward, terminated, truncated, info = env.step(action)
        log.seconds += perf_counter() - begin
        log.perception_seconds += info["perception_seconds"]
        log.reward += float(reward)
        log.slips.append(info.get("slip") if env.last_action[:2].any() else None)
        log.note_step(env, info)
        done = terminated or truncated
        if watch:
            watch(env, driver, len(log.states) - 1)


def mean_of_measured(values: Sequence[float | None]) -> float | None:
    """Return the mean of the values that were measured; None if none was."""
    numbers = [value for value in values if value is not None]
    return float(np.mean(numbers)) if numbers else None


def _relief(scene: Scene) -> list[list[float]]:
    axis = np.linspace(-scene.half, scene.half, round(2 * scene.half / RELIEF_CELL) + 1)
    return _rounded(scene.terrain.height_at(*np.meshgrid(axis, axis)))


def _rounded(values: np.ndarray) -> list[list[float]]:
    return [[round(float(v), 2) for v in row] for row in values]


def _obstacles(env: MarsNavEnv) -> list[list[float]]:
    assert env.course is not None
    rocks, half = env.course.scene.bodies, env.course.scene.half
    block = (rocks.height >= env.rover_spec.obstacle_height) & (np.abs(rocks.centre[:, :2]).max(axis=1) < half)
    return _rounded(np.column_stack([rocks.centre[block, :2], rocks.diameter[block]]))
