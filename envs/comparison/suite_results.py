"""The results of a suite, read from anyone's file: a file that cannot be true is refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

from envs.comparison.schema import results_schema
from envs.drives.config import shard_of
from envs.drives.metrics import spl
from envs.drives.resume import WEIGHTS
from envs.suites.suite import SAME_WAY, Suite, load_suite, packaged_suites
from envs.world.perception import GROUND_TRUTH
from envs.world.referee import GOAL_RADIUS
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.files.json_schema import first_fault

FIXED_DRIVER = "navigator"  # the driver of the track "eyes"
SAME_SPL = 1e-6  # by which SPL may differ from that of the ways
AIR = 0.05  # [m] by which the way of an arrival may be shorter than its straight line

Method = tuple[str, str]  # driver and perception
Key = tuple[str, int]  # condition and number of the course
Episode = Mapping[str, Any]  # as results.schema.json describes it
Episodes = dict[Key, Episode]


@dataclass(frozen=True)
class DrivenMethod:
    """A driver with a perception, and its episodes."""

    driver: str
    """Name of the driver."""
    perception: str
    """Name of the perception."""
    episodes: Episodes
    """Its episodes."""


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
    part: Mapping[str, Any] | None = None
    """What the shards of one evaluation have in common, where the file is one of them."""


def in_track(track: str, method: Method) -> bool:
    """Return whether a method competes on a track.

    Args:
        track: "eyes", where the navigator drives and only the perception counts; "drivers", where all see true depth;
            or "both", which is open to all.
        method: Driver and perception.
    """
    driver, perception = method
    return {"eyes": driver == FIXED_DRIVER, "drivers": perception == GROUND_TRUTH, "both": True}[track]


def read_results(path: Path, suite: str | None = None) -> SuiteResults:
    """Read a results.json and check it.

    Args:
        path: The file, or the folder that holds it.
        suite: Name or file of the suite that it must be of; None takes that of the same name in the package.

    Raises:
        DatasetError: The file breaks the schema, is of another suite, lacks episodes, or contradicts itself or the
            suite. One line that names the file and the value.
    """
    path = path / "results.json" if path.is_dir() else path
    content = read_json(path)
    if fault := first_fault(content, results_schema()):
        raise DatasetError(f"{path}: {fault}")
    head = content["suite"]
    if suite is None and head["name"] not in packaged_suites():
        raise DatasetError(
            f"{path}: is of the suite {head['name']!r:.60}, which is not in the package; give --suite FILE"
        )
    known = load_suite(suite or head["name"])
    if (known.name, known.sha256) != (head["name"], head["sha256"]):
        raise DatasetError(f"{path}: is of {head['name']} with another content than {known.name} here")
    if head["split"] not in known.splits:
        raise DatasetError(f"{path}: suite.split {head['split']!r} is none of {', '.join(known.splits)}")
    if head["courses"] > (most := known.splits[head["split"]]["courses"]):
        raise DatasetError(f"{path}: suite.courses must be at most {most}, got {head['courses']}")
    driven: dict[Method, Episodes] = {}
    try:
        asked = _asked(head)
    except ValueError as error:
        raise DatasetError(f"{path}: suite.{error}") from None
    for n, episode in enumerate(content["episodes"]):
        at = episode["condition"], episode["course"]
        where = f"{path}: episodes[{n}], {at[0]}, course {at[1]}"
        if fault := _fault(episode, known, head["split"]):
            raise DatasetError(f"{where}: {fault}")
        if at not in asked:
            raise DatasetError(f"{where}: is none of the episodes that the file says were driven")
        of_method = driven.setdefault((episode["driver"], episode["perception"]), {})
        if at in of_method:
            raise DatasetError(f"{where}: is there twice")
        of_method[at] = episode
    if not driven:
        raise DatasetError(f"{path}: holds no episode")
    for method, of_method in driven.items():
        if missing := sorted(asked - of_method.keys()):
            (condition, course), number = missing[0], counted(len(missing), "episode")
            are = "is" if len(missing) == 1 else "are"
            raise DatasetError(f"{path}: {', '.join(method)}: {number} {are} missing, as {condition}, course {course}")
    return SuiteResults(path, known.name, head["split"], driven, _part(content))


def methods_of(files: Iterable[SuiteResults], track: str = "both") -> dict[str, DrivenMethod]:
    """Return every method on a track, by a label that is its own.

    A method in shards of one evaluation is one method. Else a method that several files hold is labelled with the
    folder of each.
    """
    entries = list[tuple[SuiteResults, Method, Episodes]]()
    for file in files:
        for method, driven in file.episodes.items():
            if not in_track(track, method):
                continue
            for other, of_other, before in entries:
                if of_other == method and _are_shards(file, other) and not before.keys() & driven.keys():
                    before.update(driven)
                    break
            else:
                entries.append((file, method, dict(driven)))
    number = Counter(method for _, method, _ in entries)
    out: dict[str, DrivenMethod] = {}
    for file, method, driven in entries:
        label = ", ".join(method) + (f" ({file.path.parent.name or file.path})" if number[method] > 1 else "")
        if label in out:
            label = f"{', '.join(method)} ({file.path})"
        out[label] = DrivenMethod(*method, driven)
    return out


def shared_episodes(methods: Mapping[str, DrivenMethod]) -> list[Key]:
    """Return the episodes that all methods have driven, in the order of the first one.

    Raises:
        ValueError: There is none.
    """
    first, *others = (method.episodes for method in methods.values())
    shared = [key for key in first if all(key in other for other in others)]
    if not shared:
        raise ValueError("the methods have no episode in common, so nothing can be compared")
    return shared


def _part(content: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what the shards of one evaluation have in common; None for a file that is no shard."""
    head, digests = dict(content["suite"]), content.get(WEIGHTS, {})
    return {**head, "shard": head["shard"].partition("/")[2], WEIGHTS: digests} if head.get("shard") else None


def _are_shards(file: SuiteResults, other: SuiteResults) -> bool:
    """Return whether two files are shards of one evaluation, in which no method has two weights."""
    if file.part is None or other.part is None:
        return False
    digests, others = file.part[WEIGHTS], other.part[WEIGHTS]
    same = all(digests[name] == others[name] for name in digests.keys() & others.keys())
    return same and {**file.part, WEIGHTS: 0} == {**other.part, WEIGHTS: 0}


def _asked(head: Mapping[str, Any]) -> set[Key]:
    """Return the episodes that each method of a file must have.

    Args:
        head: The suite in the file, with conditions, courses and shard.

    Raises:
        ValueError: The shard is not I/N.
    """
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
    expected = spl(episode["success"], episode["shortest"], episode["path_length"])
    if abs(expected - episode["spl"]) > SAME_SPL:
        return f"spl must be {expected:.6f} by its ways, got {episode['spl']}"
    if episode["success"] and episode["distance"] > GOAL_RADIUS + AIR:
        return f"distance must be at most {GOAL_RADIUS:g} m for an arrival, got {episode['distance']:g}"
    least = apart - GOAL_RADIUS - AIR
    if episode["success"] and episode["path_length"] < least:
        return f"path_length must be at least {least:.2f} m for an arrival, got {episode['path_length']:g}"
    return None
