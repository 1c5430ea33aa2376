"""The results of a suite, read from anyone's file: a file that cannot be true is refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

from envs.comparison.consistency import fault_beside_episodes
from envs.comparison.schema import results_schema
from envs.courses.course import CourseConfig
from envs.drivers.by_name import DRIVERS
from envs.drives.episodes import causes_of
from envs.drives.metrics import spl
from envs.evaluation.config import shard_of
from envs.evaluation.resume import RUNTIME, WEIGHTS
from envs.mars_nav import STEP_SECONDS
from envs.suites.suite import SAME_WAY, Suite, load_suite, packaged_suites
from envs.world.eyes import EyesConfig
from envs.world.perception import GROUND_TRUTH
from envs.world.referee import GOAL_RADIUS, STEPS_PER_METRE, STUCK_STEPS
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.files.json_schema import first_fault
from marssim.base.rover_spec import ZHURONG

RESULTS = "results.json"  # in the folder of an evaluation
SAME_SPL = 1e-6  # by which SPL may differ from that of the ways
AIR = 0.05  # [m] by which a way may be shorter than its straight line
STEP_WAY = ZHURONG.max_speed * STEP_SECONDS  # [m] that the rover drives in a step at most
SLIDING = 2.0  # factor on that way for a rover that can slide downhill: with rigid bodies, or wheels that slip
ANYWHERE = ("goal", "collision", "tilt")  # outcomes that a drive may have within GOAL_RADIUS of the goal
BY_MOTION = ("collision", "tilt", "out_of_bounds")  # outcomes that a rover that has not moved cannot have
# null for drives with true depth
NOT_OF_TRUTH = ("abs_rel", "rocks", "rocks_missed", "false_obstacles", "near_ground", "near_ground_as_sky")

# numbers unless the depth is true
REQUIRED_OF_ESTIMATES = ("abs_rel", "rocks", "rocks_missed", "false_obstacles", "looks", "blind")

Method = tuple[str, str]  # driver and perception
Key = tuple[str, int]  # condition and number of the course
Episode = Mapping[str, Any]  # as results.schema.json describes it
Episodes = dict[Key, Episode]


@dataclass(frozen=True)
class SuiteResults:
    """The results of one file."""

    path: Path
    """The file."""
    suite: str
    """Name of the suite."""
    split: str
    """Split that was driven."""
    episodes: Mapping[Method, Episodes]
    """The episodes of each method, in the order of the file."""
    of_split: int
    """Episodes of the whole split."""
    part: Mapping[str, Any] | None = None
    """What the parts of one evaluation have in common, where the file is one of them."""
    weights: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the weights or the code of drivers and perceptions by name."""
    runtime: str | None = None
    """What ran the networks, as recorded_runtime returns it; None where no network ran."""


def results_file(path: Path) -> Path:
    """Return the file of results that a path names: itself, or the results.json in a folder."""
    return path / RESULTS if path.is_dir() else path


def read_results(path: Path, suite: str | None = None) -> SuiteResults:
    """Read a results.json and check it.

    Args:
        path: The file, or the folder that holds it.
        suite: Name or file of the suite that it must be of; None takes that of the same name in the package.

    Raises:
        DatasetError: The file breaks the schema, is of another suite, lacks episodes, or contradicts itself or the
            suite. One line that names the file and the value.
    """
    path = results_file(path)
    content = read_json(path)
    if fault := first_fault(content, results_schema()):
        if "suite" not in content:
            fault = "the file has no suite; to compare drives without --suite, name all methods in one envs.evaluate"
        elif fault in ("the file has no code", "the file has no versions"):
            fault += ", which envs.evaluate writes"
        raise DatasetError(f"{path}: {fault}")
    head = content["suite"]
    if suite is None and head["name"] not in packaged_suites():
        raise DatasetError(
            f"{path}: is of the suite {head['name']!r:.60}, which is not in the package; give --suite FILE"
        )
    listed = load_suite(suite or head["name"])
    if (listed.name, listed.sha256) != (head["name"], head["sha256"]):
        raise DatasetError(
            f"{path}: is of another version of {head['name']}: its suite has the SHA-256 {head['sha256']:.12}, and "
            f"{listed.name} here {listed.sha256:.12}"
        )
    if head["split"] not in listed.splits:
        raise DatasetError(f"{path}: suite.split {head['split']!r} is none of {', '.join(listed.splits)}")
    if head["courses"] > (most := listed.splits[head["split"]]["courses"]):
        raise DatasetError(f"{path}: suite.courses must be at most {most}, got {head['courses']}")
    driven: dict[Method, Episodes] = {}
    try:
        asked = _asked(head)
    except ValueError as error:
        raise DatasetError(f"{path}: suite.{error}") from None
    for n, episode in enumerate(content["episodes"]):
        at = episode["condition"], episode["course"]
        where = f"{path}: episodes[{n}], {at[0]}, course {at[1]}"
        if fault := _fault(episode, listed, head["split"]):
            raise DatasetError(f"{where}: {fault}")
        if at not in asked:
            raise DatasetError(f"{where}: is none of the episodes that the file says were driven")
        of_method = driven.setdefault((episode["driver"], episode["perception"]), {})
        if at in of_method:
            raise DatasetError(f"{where}: appears twice")
        of_method[at] = episode
    if not driven:
        raise DatasetError(f"{path}: holds no episode")
    for method, of_method in driven.items():
        if missing := sorted(asked - of_method.keys()):
            (condition, course), number = missing[0], counted(len(missing), "episode")
            are = "is" if len(missing) == 1 else "are"
            raise DatasetError(
                f"{path}: {', '.join(method)}: {number} {are} missing, such as {condition}, course {course}"
            )
    in_order = {method: list(of_method.values()) for method, of_method in driven.items()}
    if fault := fault_beside_episodes(content, listed, in_order):
        raise DatasetError(f"{path}: {fault}")
    of_split = sum(split == head["split"] for split, _, _ in listed.episodes)
    weights, runtime = content.get(WEIGHTS, {}), content.get(RUNTIME)
    return SuiteResults(path, listed.name, head["split"], driven, of_split, _part(head), weights, runtime)


def _part(head: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what the parts of one evaluation have in common; None for a file that holds the whole."""
    if not head.get("shard"):
        return None
    return {"conditions": head["conditions"], "courses": head["courses"], "parts": shard_of(head["shard"])[1]}


def _asked(head: Mapping[str, Any]) -> set[Key]:
    """Return the episodes that each method of a file must have.

    Args:
        head: The suite in the file, with conditions, courses and shard.

    Raises:
        ValueError: The shard is not I/N, or a condition is listed twice.
    """
    if len(set(head["conditions"])) < len(head["conditions"]):
        raise ValueError(f"conditions must differ, got {', '.join(head['conditions'])}")
    part, parts = shard_of(head.get("shard"))
    episodes = product(range(head["courses"]), head["conditions"])  # in the order of EvaluateConfig.tasks
    return {(condition, course) for course, condition in islice(episodes, part, None, parts)}


def _fault(episode: Mapping[str, Any], suite: Suite, split: str) -> str | None:
    """Return in what an episode contradicts itself or the suite; None if in nothing."""
    listed = suite.episodes.get((split, episode["condition"], episode["course"]))
    if listed is None:
        return f"{suite.name} has no such episode in {split}"
    apart = float(np.hypot(*np.subtract(listed["goal"], listed["start"][:2])))
    if abs(episode["start_distance"] - apart) > AIR:
        return f"start_distance must be {apart:.2f} m, got {episode['start_distance']:g}"
    if abs(episode["shortest"] - listed["shortest"]) > SAME_WAY:
        return f"shortest must be {listed['shortest']:g} m, got {episode['shortest']:g}"
    if episode["success"] != (episode["outcome"] == "goal"):
        return f"success must not be {episode['success']} with the outcome {episode['outcome']}"
    if fault := _fault_of_cause(episode):
        return fault
    expected = spl(episode["success"], episode["shortest"], episode["path_length"])
    if abs(expected - episode["spl"]) > SAME_SPL:
        return f"spl must be {expected:.6f} by its ways, got {episode['spl']}"
    if episode["success"] and episode["distance"] > GOAL_RADIUS + AIR:
        return f"distance must be at most {GOAL_RADIUS:g} m for an arrival, got {episode['distance']:g}"
    if episode["success"] and episode["distance"] < (least := GOAL_RADIUS - _most_way(suite, 1)):
        return f"distance must be at least {least:.2f} m after the step that arrives, got {episode['distance']:g}"
    if episode["outcome"] not in ANYWHERE and episode["distance"] < GOAL_RADIUS - AIR:
        return f"distance must be at least {GOAL_RADIUS:g} m for {episode['outcome']}, got {episode['distance']:g}"
    if (off := abs(apart - episode["distance"])) > episode["path_length"] + AIR:
        return f"path_length must be at least {off:.2f} m, by the distances of the goal, got {episode['path_length']:g}"
    least = apart - GOAL_RADIUS - AIR  # not by the shortest path: a rover may get through steep ground or a ditch
    if episode["success"] and episode["path_length"] < least:
        return f"path_length must be at least {least:.2f} m for an arrival, got {episode['path_length']:g}"
    if episode["outcome"] == "collision" and episode.get("min_clearance") is None:
        return "min_clearance must be a number for a collision, got None"
    side = suite.conditions[episode["condition"]].get("image_pixels", EyesConfig.image_pixels)
    return _fault_of_steps(episode, suite) or _fault_of_looks(episode, suite) or _fault_of_depth(episode, side**2)


def _fault_of_cause(episode: Mapping[str, Any]) -> str | None:
    """Return why an episode cannot have its cause of failure; None if it can, or has none."""
    cause, outcome = episode.get("cause"), episode["outcome"]
    if cause is None:
        return None
    if episode["success"]:
        return f"cause must be null for a drive that reached the goal, got {cause}"
    if episode["driver"] in DRIVERS and episode["driver"] != "navigator":
        return f"cause must be null for the driver {episode['driver']}, got {cause}"
    if cause not in causes_of(outcome):
        return f"cause must not be {cause} for {outcome}"
    return None


def _most_way(suite: Suite, steps: int) -> float:
    """Return the way that a rover makes in a number of steps at most [m]."""
    rigid = suite.drive["dynamics"] == "kinematic" and suite.drive["slip"] is None
    return (1.0 if rigid else SLIDING) * STEP_WAY * steps + AIR


def _fault_of_steps(episode: Mapping[str, Any], suite: Suite) -> str | None:
    """Return in what steps and way contradict each other, the outcome or the suite; None if in nothing."""
    steps, condition = episode["steps"], suite.conditions[episode["condition"]]
    most_steps = round(STEPS_PER_METRE * condition.get("goal_distance", CourseConfig.goal_distance))
    if steps > most_steps:
        return f"steps must be at most {most_steps}, got {steps}"
    least = {"time": most_steps, "stuck": STUCK_STEPS, **dict.fromkeys(BY_MOTION, 1)}.get(episode["outcome"], 0)
    if steps < least:
        return f"steps must be at least {least} for {episode['outcome']}, got {steps}"
    if episode["path_length"] > (most_way := _most_way(suite, steps)):
        return f"path_length must be at most {most_way:.2f} m in {steps} steps, got {episode['path_length']:g}"
    if suite.drive["slip"] is None:
        for name in ("slip", "energy"):
            if episode.get(name) is not None:
                return f"{name} must be null, as the wheels do not slip in {suite.name}, got {episode[name]!r}"
    return None


def _fault_of_looks(episode: Mapping[str, Any], suite: Suite) -> str | None:
    """Return in what the looks contradict the steps and the way; None if in nothing."""
    steps, way, looks = episode["steps"], episode["path_length"], episode.get("looks")
    every = suite.conditions[episode["condition"]].get("look_every", 0)
    if looks is not None and not every and looks != steps + 1:
        return f"looks must be {steps + 1}, one before the first step and one after each, got {looks}"
    if looks is not None and every:  # the rover looks at the start, after each so many metres, and where it stands
        per_step = _most_way(suite, 1) - AIR
        least = math.ceil((way - AIR) / (every + per_step))
        most = 1 + steps - math.ceil((way - AIR) / per_step) + math.floor((way + AIR) / every)
        if not least <= looks <= most:
            wanted = f"lie within {least} and {most}"
            return f"looks must {wanted} for {steps} steps, {way:g} m and a look every {every:g} m, got {looks}"
    blind = episode.get("blind")
    if blind is not None and blind > (most_blind := steps + 1 if looks is None else looks):
        return f"blind must be at most {most_blind}, the number of looks, got {blind}"
    if blind and blind == looks and episode.get("abs_rel") == 0:
        return "abs_rel must be above 0 where all looks are blind, got 0"
    return None


def _fault_of_depth(episode: Mapping[str, Any], pixels: int) -> str | None:
    """Return in what the errors of the depth contradict each other or the perception; None if in nothing.

    Args:
        episode: The episode.
        pixels: Number of pixels of an image.
    """
    if episode["perception"] == GROUND_TRUTH:
        for name in NOT_OF_TRUTH:
            if episode.get(name) is not None:
                return f"{name} must be null for true depth, got {episode[name]!r}"
    else:
        for name in REQUIRED_OF_ESTIMATES:
            if episode.get(name) is None:
                return f"{name} must be a number for {episode['perception']}; only drives with true depth have null"
    rocks, missed = (episode.get(name) or 0 for name in ("rocks", "rocks_missed"))
    if missed > rocks:
        return f"rocks_missed must be at most {rocks}, the number of rocks, got {missed}"
    ground, as_sky = (episode.get(name) or 0 for name in ("near_ground", "near_ground_as_sky"))
    if ground > (most := (episode.get("looks") or 0) * pixels):
        return f"near_ground must be at most {most}, the pixels of all looks, got {ground}"
    if as_sky > ground:
        return f"near_ground_as_sky must be at most {ground}, the pixels of near ground, got {as_sky}"
    return None
