"""Join the results of the shards of an evaluation, which envs.evaluate --shard wrote.

    python -m envs.evaluate --suite marsnav-v1 --shard 1/2 --out out/first
    python -m envs.evaluate --suite marsnav-v1 --shard 2/2 --out out/second
    python -m envs.join out/first out/second --out out/all

The results are those of one evaluation without --shard. Nothing is driven and no network is loaded. Every shard must be
finished. Run the command of a stopped shard again to finish it.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import tyro

from envs.comparison.methods import fullest_runtime
from envs.comparison.suite_results import RESULTS
from envs.drives.records import TIMES, read_record
from envs.evaluation.config import SETTINGS, EvaluateConfig, shard_of
from envs.evaluation.results import write_results
from envs.evaluation.resume import NETWORKS, NOTES, OTHERS_RUNTIME, RUNTIME, VERSIONS, WEIGHTS
from envs.recording.drive_page import DRIVES
from envs.world.eyes import AS_IMAGES, FAST_PIXELS, EyesConfig
from envs.world.perception import GROUND_TRUTH
from m3depth.runtimes.choice import joined_runtimes
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json
from marssim.base.results.claim import PARTIAL, ResultFolder, differences
from marssim.base.results.code_state import joined_versions

EPISODES = "episodes"  # folder of the records in it
NAMED = 5  # shards that a message names
TEST_ERRORS = "test_set_abs_rel"  # entry of results.json
CAUSE = "cause"  # entry of a record
NO_SETTINGS = "config does not hold the settings of an evaluation"
METHODS = ("driver", "perception")  # settings that may differ from shard to shard
PATHS = ("suite", "scene")  # may be files, of which other machines have copies elsewhere; SETTINGS has their digests
OF_SHARD = (
    "out", "shard", "workers", "scheduler", "runtime", "scores", "videos", "film_courses", "bag_courses", "record",
)  # fmt: skip


@dataclass(frozen=True)
class JoinConfig:
    """Join the results of shards in one folder."""

    shards: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of the shards."""
    out: Path
    """Folder for the joined results."""
    suite: str | None = None
    """File of the suite, where it is not at the path that the first shard names."""
    scene: Path | None = None
    """File of the place, where it is not at the path that the first shard names."""

    def __post_init__(self) -> None:
        if not self.shards:
            raise ValueError("name the folders of one shard or more")
        for n, folder in enumerate(self.shards):
            if folder.resolve() in (other.resolve() for other in self.shards[:n]):
                raise ValueError(f"the folder {folder} is given twice")


def join(config: JoinConfig) -> dict[str, Any]:
    """Copy the shards' records into one folder, write its report, and return the content of its results.json.

    All is checked before anything is written.

    Raises:
        DatasetError: A folder is no evaluation or not finished, its true depth has fewer pixels than the images of
            another perception, the settings, weights, runtimes or errors on a test set
            of two differ, one episode has two different records, episodes are missing, or --out is a shard or holds
            other records. One line that names them.
        FolderInUse: Another command writes to --out.
    """
    if config.out.resolve() in (folder.resolve() for folder in config.shards):
        raise DatasetError(f"--out {config.out}: is one of the shards; choose another")
    for folder in config.shards:
        if folder.is_file():
            raise DatasetError(f"{folder}: is a file; give the folder that envs.evaluate --shard wrote")
    marks = [read_json(folder / SETTINGS) for folder in config.shards]
    contents = [_results(folder / RESULTS) for folder in config.shards]
    first = config.shards[0]
    for folder, mark, content in zip(config.shards[1:], marks[1:], contents[1:], strict=True):
        for one, other, apart in ((marks[0], mark, ()), (contents[0]["config"], content["config"], PATHS)):
            if other_settings := differences(_shared(one, apart), _shared(other, apart)):
                raise DatasetError(f"{folder}: has other settings than {first} ({other_settings[0]})")
    weights = _merged([mark.get(WEIGHTS, {}) for mark in marks], config.shards)
    test_errors = _test_errors(contents, config.shards)
    versions = joined_versions([_versions(content, folder) for content, folder in zip(contents, config.shards)])
    runtimes = {key: _runtime(key, marks, config.shards) for key in (RUNTIME, OTHERS_RUNTIME)}
    try:
        joined = _evaluation(contents, config.out, config.scene)
        joined = joined if config.suite is None else replace(joined, suite=config.suite)
    except (TypeError, AttributeError, ValueError) as error:  # values of other types, or out of range
        is_place = config.scene is None and str(error).startswith("`scene`") and "no such file" in str(error)
        elsewhere = "; give its place with --scene" if is_place else ""
        raise DatasetError(f"{first / RESULTS}: {NO_SETTINGS} ({error}{elsewhere})") from None
    if joined.with_true_pixels() != joined:
        true = next(
            f for f, c in zip(config.shards, contents, strict=True) if GROUND_TRUTH in c["config"]["perception"]
        )
        raise DatasetError(
            f"{true}: its evaluation has the true depth with {FAST_PIXELS} x {FAST_PIXELS} px, which is not compared "
            f"with other perceptions; drive all of its shards with --ground-truth-pixels {AS_IMAGES}, for those of the "
            "images"
        )
    results = ResultFolder(
        config.out, "evaluation", SETTINGS, joined.content(), notes=NOTES, partial=(f"**/{PARTIAL}",)
    )
    if unlike := differences(_shared(marks[0]), as_json(joined.content())):
        raise DatasetError(f"{first / SETTINGS}: does not belong to its results.json ({unlike[0]})")
    records = _records(joined, config.shards, [content["config"] for content in contents])
    with results.claim():
        _check_earlier(config.out / EPISODES, records)
        (config.out / EPISODES).mkdir(exist_ok=True)
        for name, file in records.items():
            write_atomically(config.out / EPISODES / name, file.read_bytes())
        for folder in config.shards:
            for drive in sorted((folder / DRIVES).glob("*.zip")):
                if f"{drive.stem}.json" in records:
                    write_atomically(config.out / DRIVES / drive.name, drive.read_bytes())
        results.note(**{WEIGHTS: weights, **runtimes, VERSIONS: versions})
        provenance = {
            "driven_with": joined.content(), WEIGHTS: weights, RUNTIME: joined_runtimes(runtimes.values()),
            VERSIONS: versions,
        }  # fmt: skip
        return write_results(joined, provenance, test_errors)[0]


def _absent(configs: Sequence[Mapping[str, Any]]) -> str:
    """Return words on the shards I/N of each method that are not among those of some settings; "" if there are none."""
    given: dict[tuple[str, str], set[tuple[int, int]]] = {}
    for config in configs:
        try:
            shard = shard_of(config.get("shard"))
        except (ValueError, TypeError, AttributeError):  # a damaged file
            return ""
        for method in product(config["driver"], config["perception"]):
            given.setdefault(method, set()).add(shard)
    lacking: dict[str, list[tuple[str, str]]] = {}
    for method, shards in given.items():
        for total in {parts for _, parts in shards}:
            absent = [f"{part + 1}/{total}" for part in range(total) if (part, total) not in shards]
            more = f" and {len(absent) - NAMED} more" if len(absent) > NAMED else ""
            if absent:
                lacking.setdefault(f"shard {', '.join(absent[:NAMED])}{more}", []).append(method)
    words = [
        absent if len(methods) == len(given) else f"{absent} of {' and '.join(map(', '.join, methods))}"
        for absent, methods in lacking.items()
    ]
    return f"; not given: {'; '.join(words)}" if words else ""


def _records(joined: EvaluateConfig, shards: Sequence[Path], configs: Sequence[Mapping[str, Any]]) -> dict[str, Path]:
    """Return the record of every episode of the joined evaluation, by the name of its file; configs: of the shards.

    Raises:
        DatasetError: A record is damaged or of another episode, two shards have records of an episode that differ in
            more than times, or none has one.
    """
    records: dict[str, Path] = {}
    for task in joined.tasks:
        for file in (folder / EPISODES / task.file for folder in shards):
            if not file.is_file():
                continue
            if not task.is_of(read_record(file)):
                raise DatasetError(f"{file}: is the record of another episode than its name says")
            if unlike := _unlike(first := records.setdefault(task.file, file), file):
                raise DatasetError(f"{file}: is another record of the episode than {first} ({unlike})")
            if read_record(first).cause is None and read_record(file).cause is not None:
                records[task.file] = file
    if missing := [task.file for task in joined.tasks if task.file not in records]:
        number = counted(len(missing), "episode")
        raise DatasetError(
            f"{number} of {len(joined.tasks)} are in none of the shards, such as {missing[0]}{_absent(configs)}"
        )
    return records


def _check_earlier(folder: Path, records: Mapping[str, Path]) -> None:
    """Raise DatasetError if the joined episodes' folder holds records of others than the shards."""
    for file in sorted(folder.glob("*.json")):
        if file.name not in records:
            raise DatasetError(f"{file}: is a record that none of the shards holds; choose another --out")
        if unlike := _unlike(records[file.name], file):
            raise DatasetError(
                f"{file}: is another record of the episode than {records[file.name]} ({unlike}); choose another --out"
            )


def _unlike(one: Path, other: Path) -> str:
    """Return the first difference between two records, but for times; "" if there is none.

    A cause that only one of them knows is none: that drive was recorded, and the other not.
    """
    first, second = ({k: v for k, v in read_json(file).items() if k not in TIMES} for file in (one, other))
    if first.get(CAUSE) is None or second.get(CAUSE) is None:
        first.pop(CAUSE, None)
        second.pop(CAUSE, None)
    return next(iter(differences(first, second)), "")


def _runtime(key: str, marks: Sequence[Mapping[str, Any]], folders: Sequence[Path]) -> str | None:
    """Return the program that ran M3Depth in all shards, or other networks.

    Args:
        key: RUNTIME for that of M3Depth, OTHERS_RUNTIME for that of other networks.
        marks: Content of the settings file of each shard.
        folders: The shards, for messages.

    Raises:
        DatasetError: Two shards ran such networks in different programs, or one holds no such record.
    """
    runtimes = [mark.get(key) for mark in marks]
    for n, folder in enumerate(folders):
        if not isinstance(runtimes[n], str | None):
            raise DatasetError(f"{folder / SETTINGS}: {key} must be a name or null, got {runtimes[n]!r:.60}")
        try:
            fullest_runtime(runtimes[: n + 1])
        except ValueError as error:
            raise DatasetError(
                f"{folder}: {NETWORKS[key]} ran in another program than in another shard ({error})"
            ) from None
    return fullest_runtime(runtimes)


def _results(file: Path) -> dict[str, Any]:
    """Read the results.json of a shard. Raises DatasetError if it has no settings of an evaluation."""
    if (file.parent / SETTINGS).is_file() and not file.is_file():
        raise DatasetError(f"{file}: no such file: the shard is not finished. Run the command that drove it again")
    content = read_json(file)
    settings = content.get("config")
    if not isinstance(settings, dict) or not isinstance(settings.get("eyes"), dict):
        raise DatasetError(f"{file}: {NO_SETTINGS}")
    if not all(_is_list_of_texts(settings.get(name)) for name in METHODS):
        raise DatasetError(f"{file}: {NO_SETTINGS}")
    return content


def _is_list_of_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(text, str) for text in value)


def _shared(settings: Mapping[str, Any], apart: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the settings that all shards of an evaluation have in common, but those of some names."""
    return {key: value for key, value in settings.items() if key not in (*NOTES, *METHODS, *OF_SHARD, *apart)}


def _merged(parts: Sequence[Mapping[str, str]], folders: Sequence[Path]) -> dict[str, str]:
    """Return the digests of all shards. Raises DatasetError where a name has two."""
    out: dict[str, str] = {}
    for part, folder in zip(parts, folders, strict=True):
        if not isinstance(part, Mapping):
            raise DatasetError(f"{folder / SETTINGS}: {WEIGHTS} must hold digests by name, got {part!r:.60}")
        for name, digest in part.items():
            if out.setdefault(name, digest) != digest:
                raise DatasetError(f"{folder}: {name} has other weights or code than in another shard")
    return out


def _test_errors(contents: Sequence[Mapping[str, Any]], folders: Sequence[Path]) -> dict[str, float]:
    """Return the Abs Rel of perceptions on their test set, from --scores. Raises DatasetError where one has two."""
    errors: dict[str, float] = {}
    for content, folder in zip(contents, folders, strict=True):
        of_shard = content.get(TEST_ERRORS, {})
        if not isinstance(of_shard, dict) or not all(isinstance(x, int | float) for x in of_shard.values()):
            raise DatasetError(f"{folder / RESULTS}: {TEST_ERRORS} must hold numbers by name, got {of_shard!r:.60}")
        for name, error in of_shard.items():
            if errors.setdefault(name, error) != error:
                raise DatasetError(f"{folder}: {name} has another {TEST_ERRORS} than in another shard")
    return errors


def _versions(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the versions and the machines that drove a shard. Raises DatasetError if they are none."""
    versions = content.get(VERSIONS, {})
    if not isinstance(versions, dict):
        raise DatasetError(f"{folder / RESULTS}: {VERSIONS} must hold versions by name, got {versions!r:.60}")
    return versions


def _evaluation(contents: Sequence[Mapping[str, Any]], out: Path, scene: Path | None) -> EvaluateConfig:
    """Return the settings of the whole evaluation, from the results.json of its shards; scene: where its place is."""
    settings = dict(contents[0]["config"])
    if scene is not None:
        settings["scene"] = str(scene)
    for name in METHODS:  # in the order of their first shard
        settings[name] = list(dict.fromkeys(value for content in contents for value in content["config"][name]))
    plain = EvaluateConfig(out, videos=False)
    names = {field.name for field in fields(EvaluateConfig)} - {*OF_SHARD, "eyes"}
    values: dict[str, Any] = {key: value for key, value in settings.items() if key in names}
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    return replace(plain, eyes=EyesConfig(**settings["eyes"]), **values)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, JoinConfig, "python -m envs.join", __doc__, args, STARTS_OVER)


def _work(config: JoinConfig) -> None:
    content = join(config)
    drives = counted(sum(row["episodes"] for row in content["results"]), "drive")
    print(f"{drives} of {counted(len(config.shards), 'shard')} in {config.out / 'results.json'}")


if __name__ == "__main__":
    sys.exit(main())
