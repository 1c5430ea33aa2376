"""The methods of several files of results: parts of one evaluation are one method, others stay apart."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from envs.comparison.suite_results import RESULTS, Episodes, Key, Method, SuiteResults
from envs.world.perception import GROUND_TRUTH
from m3depth.estimator import M3DEPTH
from m3depth.runtimes.choice import AND, same_runtime
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError

FIXED_DRIVER = "navigator"  # the driver of the track "eyes"


@dataclass(frozen=True)
class DrivenMethod:
    """A driver with a perception, and its episodes."""

    driver: str
    """Name of the driver."""
    perception: str
    """Name of the perception."""
    episodes: Episodes
    """Its episodes."""
    weights: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the weights or the code of its driver and its perception by their names, where they have a file."""
    runtime: str | None = None
    """What ran its network, as recorded_runtime returns it for that network; None for a method without one."""


def in_track(track: str, method: Method) -> bool:
    """Return whether a method competes on a track.

    Args:
        track: "eyes", where the navigator drives and only the perception counts; "drivers", where all see true depth;
            or "both", which is open to all.
        method: Driver and perception.
    """
    driver, perception = method
    return {"eyes": driver == FIXED_DRIVER, "drivers": perception == GROUND_TRUTH, "both": True}[track]


def methods_of(files: Iterable[SuiteResults], track: str = "both") -> dict[str, DrivenMethod]:
    """Return every method on a track, by a label that is its own, in the order of the files.

    A method in parts of one evaluation is one method: parts of the same suite, conditions, number of courses and
    number of parts, driven with the same weights and in the same program, none of which has an episode of another.
    Where they have, parts that the same code drove belong together. What belongs together does not depend on the order
    of the files. A method that remains in several files is labelled with the folder of each results.json, with the name
    of a file that is called otherwise, and with the number of parts that are one.

    Raises:
        DatasetError: Parts of several evaluations are there, and nothing tells which belong together.
    """
    holders: dict[Method, list[SuiteResults]] = {}
    place: dict[tuple[Method, Hashable], tuple[int, int]] = {}
    for n, file in enumerate(files):
        for k, method in enumerate(file.episodes):
            if in_track(track, method):
                holders.setdefault(method, []).append(file)
                place[method, id(file)] = (n, k)
    entries = [(method, parts) for method, holding in holders.items() for parts in _evaluations(method, holding)]
    entries.sort(key=lambda entry: place[entry[0], id(entry[1][0])])
    number = Counter(method for method, _ in entries)
    out: dict[str, DrivenMethod] = {}
    for method, parts in entries:
        others = [each for name, each in entries if name == method and each is not parts]
        label = ", ".join(method) + (f" ({_source(parts, others)})" if number[method] > 1 else "")
        episodes = {key: episode for part in parts for key, episode in part.episodes[method].items()}
        out[label] = DrivenMethod(*method, episodes, _digests(method, parts[0]), _runtime(method, parts))
    return out


def _source(parts: Sequence[SuiteResults], others: Sequence[Sequence[SuiteResults]]) -> str:
    """Return what tells the parts of an evaluation from those of others: the shortest words that are theirs alone."""
    for in_words in (_in_number, _in_short):
        if (words := in_words(parts)) not in map(in_words, others):
            return words
    return _in_full(parts)


def _in_number(parts: Sequence[SuiteResults]) -> str:
    """Return the number of parts; of a single file, the name of its folder or its own."""
    return counted(len(parts), "part") if len(parts) > 1 else _in_short(parts)


def _in_short(parts: Sequence[SuiteResults]) -> str:
    """Return the name of a file or of its folder, and how many other parts it has."""
    path = parts[0].path
    name = path.parent.name if path.name == RESULTS else path.stem
    return _with_number(name or str(path), parts)


def _in_full(parts: Sequence[SuiteResults]) -> str:
    """Return the path of a file, and how many other parts it has."""
    return _with_number(str(parts[0].path), parts)


def _with_number(name: str, parts: Sequence[SuiteResults]) -> str:
    return name if len(parts) == 1 else f"{len(parts)} parts, with {name}"


def with_first(methods: Mapping[str, DrivenMethod], label: str | None) -> dict[str, DrivenMethod]:
    """Return the methods with one of them first; None leaves their order.

    Args:
        methods: By label.
        label: Label of the first one, with or without a space after its comma.

    Raises:
        ValueError: There is no such method; the message lists them.
    """
    if label is None:
        return dict(methods)
    wanted = ", ".join(part.strip() for part in label.split(","))
    if wanted not in methods:
        raise ValueError(f"`reference` {label}: is no method of these files; choose from {'; '.join(methods)}")
    return {wanted: methods[wanted], **methods}


def under_conditions(methods: Mapping[str, DrivenMethod], conditions: Sequence[str]) -> dict[str, DrivenMethod]:
    """Return the methods with their episodes under some conditions; without any, with all episodes.

    Args:
        methods: By label.
        conditions: Names of conditions.

    Raises:
        ValueError: No method drove under one of them; the message lists those under which one did.
    """
    driven = list(dict.fromkeys(condition for method in methods.values() for condition, _ in method.episodes))
    for condition in conditions:
        if condition not in driven:
            raise ValueError(f"`condition` {condition}: no method drove it; they drove {', '.join(driven)}")
    kept = set(conditions or driven)
    return {
        label: replace(method, episodes={key: each for key, each in method.episodes.items() if key[0] in kept})
        for label, method in methods.items()
    }


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


def fullest_runtime(runtimes: Iterable[str | None]) -> str | None:
    """Return the record of a program that all records are of; None if no record names one.

    A record may leave out its last words: those of earlier versions lack device and precision.

    Args:
        runtimes: Such as "openvino 2026.4.1" and "openvino 2026.4.1 cpu bf16", or None where no network ran.

    Raises:
        ValueError: They are of two programs; the message names both.
    """
    fullest = ""
    for runtime in runtimes:
        record = runtime or ""
        if not same_runtime(record, fullest):
            raise ValueError(f"{record} is not {fullest}")
        fullest = max(fullest, record, key=len)
    return fullest or None


def _evaluations(method: Method, files: Sequence[SuiteResults]) -> list[list[SuiteResults]]:
    """Return the files that hold a method, those of one evaluation together."""
    groups = [[file] for file in files if file.part is None]
    for parts in _by(
        lambda file: json.dumps([file.part, _digests(method, file)], sort_keys=True),
        [file for file in files if file.part is not None],
    ):
        for alike in [parts] if _is_one_program(method, parts) else _by(lambda file: _runtime(method, [file]), parts):
            if _overlapping(method, alike) is None:
                groups.append(alike)
            else:
                for same in _by(lambda file: _codes(method, file), alike):
                    groups += _unambiguous(method, same)
    return groups


def _unambiguous(method: Method, parts: list[SuiteResults]) -> list[list[SuiteResults]]:
    """Return parts that nothing but their episodes tells apart, those of one evaluation together."""
    pair = _overlapping(method, parts)
    if pair is None:
        return [parts]
    if len({frozenset(part.episodes[method]) for part in parts}) == 1:  # one part, driven several times
        return [[part] for part in parts]
    one, other = pair
    raise DatasetError(
        f"{other.path}: holds episodes of {', '.join(method)} that {one.path} holds too, and nothing tells which parts "
        "belong together; join those of each evaluation first (python -m envs.join)"
    )


def _by(key: Callable[[SuiteResults], Hashable], files: Iterable[SuiteResults]) -> list[list[SuiteResults]]:
    """Return files with the same key together."""
    groups: dict[Hashable, list[SuiteResults]] = {}
    for file in files:
        groups.setdefault(key(file), []).append(file)
    return list(groups.values())


def _overlapping(method: Method, files: Sequence[SuiteResults]) -> tuple[SuiteResults, SuiteResults] | None:
    """Return two files that hold the same episode of a method; None if there are none."""
    holder: dict[Key, SuiteResults] = {}
    for file in files:
        for key in file.episodes[method]:
            if key in holder:
                return holder[key], file
            holder[key] = file
    return None


def _is_one_program(method: Method, files: Iterable[SuiteResults]) -> bool:
    try:
        _runtime(method, files)
    except ValueError:
        return False
    return True


def _runtime(method: Method, files: Iterable[SuiteResults]) -> str | None:
    """Return what ran the network of a method in its files; None if it has none, or no file says it.

    A file has one record for M3Depth and, where PyTorch ran other networks beside it in OpenVINO, a second one for
    these. A name with weights may be of either: then what all files have counts.

    Raises:
        ValueError: It is not one program; the message names two.
    """
    perception = method[1]
    if perception.partition(":")[0] != M3DEPTH:
        return None
    records = [file.runtime.split(AND) for file in files if file.runtime is not None]
    if ":" not in perception:
        records = [each[:1] for each in records]
    for candidate in [record for each in records for record in each]:
        fitting = [[record for record in each if same_runtime(record, candidate)] for each in records]
        if all(fitting):
            return fullest_runtime(each[0] for each in fitting)
    return fullest_runtime(AND.join(each) for each in records)


def _digests(method: Method, file: SuiteResults) -> dict[str, str]:
    """Return the digests of a method's driver and perception, where they have one."""
    return {name: file.weights[name] for name in method if name in file.weights}


def _codes(method: Method, file: SuiteResults) -> frozenset[str]:
    """Return the states of the sources that drove a method's episodes."""
    return frozenset(episode.get("code", "") for episode in file.episodes[method].values())
