"""The results of a suite, read from anyone's file: a file that cannot be true is refused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from envs.comparison.schema import results_schema
from envs.drives.metrics import spl
from envs.suites.suite import SAME_WAY, Suite, load_suite
from envs.world.perception import GROUND_TRUTH
from envs.world.referee import GOAL_RADIUS
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.files.json_schema import first_fault

TRACKS = ("eyes", "drivers", "both")
FIXED_DRIVER = "navigator"  # the driver of the track "eyes"
SAME_SPL = 1e-6  # by which SPL may differ from that of the ways
AIR = 0.05  # [m] by which the way of an arrival may be shorter than its straight line

Method = tuple[str, str]  # driver and perception
Scores = dict[tuple[str, int], tuple[float, float]]  # success and SPL by condition and course


@dataclass(frozen=True)
class SuiteResults:
    """The results of one file."""

    path: Path
    """The file."""
    suite: str
    """Name of the suite."""
    split: str
    """Split that was driven."""
    scores: Mapping[Method, Scores]
    """Success and SPL of each method, in the order of the file."""
    episodes: tuple[Mapping[str, Any], ...]
    """All episodes, as results.schema.json describes them."""


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
    head, episodes = content["suite"], content["episodes"]
    known = load_suite(suite or head["name"])
    if (known.name, known.sha256) != (head["name"], head["sha256"]):
        raise DatasetError(f"{path}: is of {head['name']} with another content than {known.name} here")
    if head["split"] not in known.splits:
        raise DatasetError(f"{path}: suite.split {head['split']!r} is none of {', '.join(known.splits)}")
    scores: dict[Method, Scores] = {}
    for n, episode in enumerate(episodes):
        if fault := _fault(episode, known, head["split"]):
            raise DatasetError(f"{path}: episodes[{n}], {episode['condition']}, course {episode['course']}: {fault}")
        driven = scores.setdefault((episode["driver"], episode["perception"]), {})
        at = episode["condition"], episode["course"]
        if at in driven:
            raise DatasetError(f"{path}: episodes[{n}]: {at[0]}, course {at[1]}, is there twice")
        driven[at] = float(episode["success"]), float(episode["spl"])
    if not scores:
        raise DatasetError(f"{path}: holds no episode")
    asked = set(product(head["conditions"], range(head["courses"])))
    for method, driven in scores.items():
        if head.get("shard") is None and (missing := sorted(asked - driven.keys())):
            (condition, course), number = missing[0], counted(len(missing), "episode")
            are = "is" if len(missing) == 1 else "are"
            raise DatasetError(f"{path}: {', '.join(method)}: {number} {are} missing, as {condition}, course {course}")
    return SuiteResults(path, known.name, head["split"], scores, tuple(episodes))


def methods_of(files: Iterable[SuiteResults], track: str = "both") -> dict[str, Scores]:
    """Return the scores of every method on a track, by a label that is its own.

    A method that several files hold is labelled with the folder of each.
    """
    found = [(file, method, scores) for file in files for method, scores in file.scores.items()]
    found = [entry for entry in found if in_track(track, entry[1])]
    several = {method for _, method, _ in found if sum(method == other for _, other, _ in found) > 1}
    out: dict[str, Scores] = {}
    for file, method, scores in found:
        label = ", ".join(method) + (f" ({file.path.parent.name or file.path})" if method in several else "")
        if label in out:
            label = f"{', '.join(method)} ({file.path})"
        out[label] = scores
    return out


def _fault(episode: Mapping[str, Any], suite: Suite, split: str) -> str | None:
    """Return in what an episode contradicts itself or the suite; None if in nothing."""
    listed = suite.episodes.get((split, episode["condition"], episode["course"]))
    if listed is None:
        return f"{suite.name} has no such episode in {split}"
    if abs(episode["shortest"] - listed["shortest"]) > SAME_WAY:
        return f"shortest must be {listed['shortest']:g} m, got {episode['shortest']:g}"
    if episode["success"] != (episode["outcome"] == "goal"):
        return f"success must not be {episode['success']} with the outcome {episode['outcome']}"
    expected = spl(episode["success"], episode["shortest"], episode["path_length"])
    if abs(expected - episode["spl"]) > SAME_SPL:
        return f"spl must be {expected:.6f} by its ways, got {episode['spl']}"
    least = episode["start_distance"] - GOAL_RADIUS - AIR
    if episode["success"] and episode["path_length"] < least:
        return f"path_length must be at least {least:.2f} m for an arrival, got {episode['path_length']:g}"
    return None
