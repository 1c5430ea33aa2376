"""Frozen episodes: the same course for every driver and perception, by seed, rock abundance and slope."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from envs.drivers import Driver, Stop
from envs.mars_nav import ActionError, MarsNavEnv
from envs.resumption import code_digest
from envs.sight import Sight
from marssim.camera import MAX_DEPTH, MIN_DEPTH

NEAR_MISS = 0.10  # [m] between the rover's footprint and an obstacle (envs.flank)


@dataclass(frozen=True)
class Cell:
    """Where an episode is driven: k None and slope_deg None leave the scene preset's own."""

    k: float | None = None
    slope_deg: float | None = None

    @property
    def name(self) -> str:
        k, slope = ("preset" if value is None else f"{value:.12g}" for value in (self.k, self.slope_deg))
        return f"k={k}, slope={slope}"


@dataclass
class EpisodeRecord:
    """What became of one episode. Lengths [m], times [s]; track: (x, y) after every step, start first; obstacles:
    x, y, diameter of the rocks that block; abs_rel: mean over the looks of |Z - Z*| / Z* up to 15 m where a depth was
    given, None with the ground truth as it is; near_miss: no collision, but the rover's footprint came nearer than
    NEAR_MISS to the outline of a rock that blocks; min_clearance: how near, as in MarsNavEnv's info.

    outcome: as MarsNavEnv's info names it, or as the driver ended the drive (envs.drivers.Stop): "no_path" where it
    gave up, "elsewhere" where it believed to be at the goal and was not, as happens by odometry that drifts. code: the
    state of the sources that drove (envs.resumption.code_digest), "" where that was not noted.
    """

    driver: str
    perception: str
    cell: str
    episode: int
    outcome: str
    steps: int
    distance: float
    start_distance: float
    shortest: float
    path_length: float
    min_clearance: float
    max_tilt_deg: float
    reward: float
    step_seconds: float
    perception_seconds: float
    redraws: int
    goal: list[float]
    abs_rel: float | None = None
    near_miss: bool = False
    code: str = ""
    obstacles: list[list[float]] = field(default_factory=list)
    track: list[list[float]] = field(default_factory=list)


def course_options(cell: Cell, seed: int, episode: int) -> dict[str, Any]:
    """Options of MarsNavEnv.reset that make the course of an episode: its scene_seed is of (seed, episode) alone."""
    scene_seed = int(np.random.SeedSequence((seed, episode)).generate_state(1)[0])
    return {"scene_seed": scene_seed, **{name: value for name, value in vars(cell).items() if value is not None}}


def run_episode(
    env: MarsNavEnv,
    driver: Driver,
    cell: Cell,
    seed: int,
    episode: int,
    names: tuple[str, str] = ("", ""),
    watch: Callable[[MarsNavEnv, Driver, int], None] | None = None,
) -> EpisodeRecord:
    """Drive one episode to its end.

    The course follows from (seed, episode) and the cell alone. names: driver and perception, for the record.
    watch(env, driver, step) is called after the reset (step 0) and after every step. Raises ActionError that names the
    driver for an answer that is neither an action nor a Stop.
    """
    options = course_options(cell, seed, episode)
    observation, info = env.reset(seed=options["scene_seed"], options=options)
    driver.reset(env, options["scene_seed"])
    assert env.vehicle is not None and env.course is not None
    track = [[float(v) for v in env.vehicle.state().position[:2]]]
    start_distance = info["distance"]
    total, seconds, seeing, tilt = 0.0, 0.0, 0.0, 0.0
    errors = [_abs_rel(env.sight)]
    steps, done = 0, False
    if watch:
        watch(env, driver, 0)
    while not done:
        begin = perf_counter()
        action = driver.act(env, observation)
        if isinstance(action, Stop):
            info = {**info, "outcome": action.value}
            break
        try:
            observation, reward, terminated, truncated, info = env.step(action)
        except ActionError as error:
            raise ActionError(f"driver {names[0]!r}: {error}") from None
        seconds += perf_counter() - begin
        seeing += info["perception_seconds"]
        total += float(reward)
        steps += 1
        state = env.vehicle.state()
        tilt = max(tilt, float(np.rad2deg(state.tilt)))
        errors.append(_abs_rel(env.sight))
        track.append([float(v) for v in state.position[:2]])
        done = terminated or truncated
        if watch:
            watch(env, driver, steps)
    return EpisodeRecord(
        driver=names[0], perception=names[1], cell=cell.name, episode=episode, outcome=info["outcome"], steps=steps,
        distance=info["distance"], start_distance=start_distance, shortest=info["shortest"],
        path_length=info["path_length"], min_clearance=info["min_clearance"], max_tilt_deg=tilt, reward=total,
        step_seconds=seconds / max(steps, 1), perception_seconds=seeing / max(steps, 1), redraws=info["redraws"],
        goal=[float(v) for v in env.course.goal], abs_rel=_mean(errors),
        near_miss=info["outcome"] != "collision" and info["min_clearance"] < NEAR_MISS,
        code=code_digest(), obstacles=_obstacles(env), track=track,
    )  # fmt: skip


def _abs_rel(sight: Sight | None) -> float | None:
    """Mean |Z - Z*| / Z* of one look over the true depths of 0.5 m to 15 m where something was measured."""
    if sight is None or sight.true_depth is None or sight.true_depth is sight.depth:
        return None
    true = sight.true_depth
    known = (true >= MIN_DEPTH) & (true <= MAX_DEPTH) & np.isfinite(sight.depth) & (sight.depth > 0)
    return float(np.mean(np.abs(sight.depth[known] - true[known]) / true[known])) if known.any() else None


def _mean(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _obstacles(env: MarsNavEnv) -> list[list[float]]:
    assert env.course is not None
    rocks, half = env.course.scene.rocks, env.course.scene.half
    block = (rocks.height >= env.rover_spec.obstacle_height) & (np.abs(rocks.centre[:, :2]).max(axis=1) < half)
    return [[round(float(v), 2) for v in (*rocks.centre[i, :2], rocks.diameter[i])] for i in np.flatnonzero(block)]
