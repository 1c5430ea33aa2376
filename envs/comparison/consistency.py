"""What a file of results says beside its episodes: it must agree with them, and with what the suite fixes."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from envs.drives.episodes import Cell, EpisodeRecord, is_near_miss
from envs.drives.metrics import paired_difference, summarise
from envs.evaluation.suite_drives import fixed_settings
from envs.suites.suite import Suite
from m3depth.estimator import M3DEPTH
from marssim.base.files.json_file import as_json

CLOSE = 1e-6  # by which figures may differ from those of the episodes, relative to themselves
# figures of a row that its episodes do not hold
BEYOND_EPISODES = ("max_tilt_deg", "redraws", "unreachable_share")
# figures that need a value which an episode may lack
NEEDED = {
    "min_clearance": ("min_clearance", "near_miss_rate"), "step_seconds": ("step_seconds",),
    "perception_seconds": ("perception_seconds",),
}  # fmt: skip
OF_DIFFERENCE = ("episodes", "courses", "difference", "spl_difference")  # its intervals depend on the release

Episode = Mapping[str, Any]  # as results.schema.json describes it
Method = tuple[str, str]  # driver and perception


def fault_beside_episodes(
    content: Mapping[str, Any], suite: Suite, driven: Mapping[Method, Sequence[Episode]]
) -> str | None:
    """Return in what a file contradicts its episodes or the suite beside them; None if in nothing.

    Args:
        content: The file, which keeps to the schema.
        suite: The suite that it is of.
        driven: The episodes of each method, complete, in the order of the file.
    """
    return (
        _fault_of_settings(content, suite, driven)
        or _fault_of_provenance(content, driven)
        or _fault_of_rows(content, driven)
        or _fault_of_differences(content, driven)
    )


def _fault_of_settings(content: Mapping[str, Any], suite: Suite, driven: Iterable[Method]) -> str | None:
    """Return which setting is not the one that the suite fixes, or that the rest of the file names."""
    head = content["suite"]
    fixed = as_json(fixed_settings(suite, head["split"]))
    named = {
        "split": head["split"], "condition": head["conditions"], "episodes": head["courses"],
        "shard": head.get("shard"), "driver": [driver for driver, _ in driven],
        "perception": [perception for _, perception in driven],
    }  # fmt: skip
    named |= {name: list(dict.fromkeys(named[name])) for name in ("driver", "perception")}
    noted = {"suite": suite.name, "suite_sha256": suite.sha256, "split": head["split"]}
    for key, others in (("config", named), ("driven_with", noted)):
        settings = content.get(key, {})
        eyes = settings.get("eyes")
        places = [(f"{key}.{name}", name, value) for name, value in settings.items()]
        if isinstance(eyes, dict):
            places += [(f"{key}.eyes.{name}", name, value) for name, value in eyes.items()]
        for place, name, value in places:
            if name in fixed and value != fixed[name]:
                return f"{place} must be {_text(fixed[name])}, as {suite.name} fixes it, got {_text(value)}"
            if name in others and not _names_the_same(value, others[name]):
                wanted = f"{_text(others[name])}, as the suite and the episodes in the file say"
                return f"{place} must be {wanted}, got {_text(value)}"
    return None


def _names_the_same(value: Any, expected: Any) -> bool:
    """Return whether a setting is the expected one; the order of names in a list does not count."""
    if isinstance(value, list) and isinstance(expected, list):
        return sorted(map(str, value)) == sorted(map(str, expected))
    return bool(value == expected)


def _fault_of_provenance(content: Mapping[str, Any], driven: Mapping[Method, Sequence[Episode]]) -> str | None:
    """Return in what the states of the code or the digests of weights do not go with the episodes."""
    states = Counter(episode.get("code", "") for episodes in driven.values() for episode in episodes)
    if content["code"] != states:
        return f"code must be {_text(states)}, the numbers of episodes by their state, got {_text(content['code'])}"
    for method in driven:
        for name in method:
            if has_digest(name) and name not in content.get("weights", {}):
                return f"weights has no SHA-256 of {name}, which drove"
    return None


def has_digest(name: str) -> bool:
    """Return whether a driver or a perception of this name has a digest in `weights`: a network, a policy or a class of
    the user's."""
    return name == M3DEPTH or ":" in name or name.endswith(".zip")


def _fault_of_rows(content: Mapping[str, Any], driven: Mapping[Method, Sequence[Episode]]) -> str | None:
    """Return which row of `results` does not have the figures of its episodes."""
    if "results" not in content:
        return None
    missing = {
        (*method, condition): [episode for episode in episodes if episode["condition"] == condition]
        for method, episodes in driven.items()
        for condition in dict.fromkeys(episode["condition"] for episode in episodes)
    }
    for n, row in enumerate(content["results"]):
        key = row["driver"], row["perception"], row["cell"]["condition"]
        if key not in missing:
            before = any((r["driver"], r["perception"], r["cell"]["condition"]) == key for r in content["results"][:n])
            why = "as an earlier row is" if before else "as no episode is"
            return f"results[{n}] must not be of {', '.join(key)}, {why}"
        episodes = missing.pop(key)
        figures = as_json(summarise([_record(episode) for episode in episodes]))
        for name in (*BEYOND_EPISODES, *_unrecorded(episodes)):
            figures.pop(name, None)
        figures["cell"] = Cell(condition=key[2]).content()
        if fault := _differing(row, figures):
            return f"results[{n}].{fault}"
    if missing:
        return f"results has no row of {', '.join(next(iter(missing)))}"
    return None


def _fault_of_differences(content: Mapping[str, Any], driven: Mapping[Method, Sequence[Episode]]) -> str | None:
    """Return which entry of `differences` does not have the figures of its episodes."""
    if "differences" not in content:
        return None
    records = {method: [_record(episode) for episode in episodes] for method, episodes in driven.items()}
    first, *others = records
    if len(content["differences"]) != len(others):
        number = len(content["differences"])
        return f"differences must have an entry for each method after the first, {len(others)} in all, got {number}"
    for n, (row, method) in enumerate(zip(content["differences"], others, strict=True)):
        figures = paired_difference(records[method], records[first])
        expected = {name: figures[name] for name in OF_DIFFERENCE}
        expected |= {"driver": method[0], "perception": method[1], "less": list(first)}
        if fault := _differing(row, expected):
            return f"differences[{n}].{fault}"
    return None


def _record(episode: Episode) -> EpisodeRecord:
    """Return the record of an episode, with 0 for what a file of results does not hold."""
    clearance = episode.get("min_clearance", 0.0)
    return EpisodeRecord(
        driver=episode["driver"], perception=episode["perception"], cell=episode["condition"],
        episode=episode["course"], outcome=episode["outcome"], steps=episode["steps"], distance=episode["distance"],
        start_distance=episode["start_distance"], shortest=episode["shortest"], path_length=episode["path_length"],
        min_clearance=clearance, max_tilt_deg=0.0, reward=0.0, step_seconds=episode.get("step_seconds", 0.0),
        perception_seconds=episode.get("perception_seconds", 0.0), redraws=0, goal=[],
        abs_rel=episode.get("abs_rel"), slip=episode.get("slip"), energy=episode.get("energy"),
        near_miss=is_near_miss(episode["outcome"], clearance),
    )  # fmt: skip


def _unrecorded(episodes: Sequence[Episode]) -> list[str]:
    """Return the figures that cannot be computed, as an episode lacks what they need."""
    lacking = [name for name in NEEDED if any(name not in episode for episode in episodes)]
    return [figure for name in lacking for figure in NEEDED[name]]


def _differing(row: Mapping[str, Any], expected: Mapping[str, Any]) -> str | None:
    """Return which entry of a row differs from the one that is expected; None if none does, or the row lacks it."""
    for name, value in expected.items():
        if name in row and not _is_close(row[name], value):
            return f"{name} must be {_text(value)} by the episodes, got {_text(row[name])}"
    return None


def _is_close(value: Any, expected: Any) -> bool:
    """Return whether two values of JSON are equal but for rounding."""
    if isinstance(expected, dict):
        return (
            isinstance(value, dict)
            and value.keys() == expected.keys()
            and all(_is_close(value[key], item) for key, item in expected.items())
        )
    if isinstance(expected, list):
        return isinstance(value, list) and len(value) == len(expected) and all(map(_is_close, value, expected))
    if isinstance(expected, int | float) and isinstance(value, int | float):
        return math.isclose(value, expected, rel_tol=CLOSE, abs_tol=CLOSE)
    return bool(value == expected)


def _text(value: Any) -> str:
    """Return a value as the file would have it, shortened."""
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
