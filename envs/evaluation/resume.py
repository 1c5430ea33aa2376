"""What drove the episodes in a folder (weights, code, runtime): noted there, and compared before more are added.

The versions of packages and the machines that drove them are noted too, and not compared.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from envs.evaluation.config import EvaluateConfig
from m3depth.class_files import class_files, joint_digest
from m3depth.estimator import EstimatorName
from m3depth.runtimes.choice import is_other_network, joined_runtimes, recorded_runtime, same_runtime
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import joined_versions, versions

Provenance = Mapping[str, Any]  # what results.json says of what drove the episodes
WEIGHTS = "weights"  # key in the settings file: SHA-256 by the name of a perception or driver
RUNTIME = "runtime"  # key in the settings file: what ran M3Depth, as recorded_runtime returns it
OTHERS_RUNTIME = "others_runtime"  # key in the settings file: what ran other networks
VERSIONS = "versions"  # key in the settings file: versions and machines, as joined_versions returns them
NOTES = (WEIGHTS, RUNTIME, OTHERS_RUNTIME, VERSIONS)
NETWORKS = {RUNTIME: "m3depth", OTHERS_RUNTIME: "other networks"}  # what a message calls them


def note_provenance(folder: ResultFolder, config: EvaluateConfig, driving: bool) -> dict[str, Any]:
    """Note what drives the episodes of a claimed folder, and return it with what drove before, as results.json has it.

    Args:
        folder: The evaluation's folder, claimed.
        config: The settings.
        driving: Whether there are episodes left to drive.

    Raises:
        DatasetError: See noted_digests, noted_runtime and noted_versions.
    """
    return {
        "driven_with": folder.settings,
        WEIGHTS: noted_digests(folder, (*config.perception, *config.driver)),
        RUNTIME: noted_runtime(folder, config.perception, config.runtime),
        VERSIONS: noted_versions(folder, driving),
    }


def note_drives_left_out(config: EvaluateConfig) -> None:
    """Print a note if the folder holds finished drives of other drivers, perceptions or courses than those named.

    Args:
        config: The settings, with those of its suite.
    """
    named, folder = {task.file for task in config.tasks}, config.out / "episodes"
    if others := sum(file.name not in named for file in folder.glob("*.json")):
        print(
            f"note: {folder} also holds {counted(others, 'drive')} of drivers, perceptions or courses that the flags "
            "leave out, and so do the results",
            file=sys.stderr,
        )


def noted_digests(folder: ResultFolder, names: Sequence[str]) -> dict[str, str]:
    """Check that the episodes of a claimed folder were driven by the same weights and code, and note those of today.

    Args:
        folder: The evaluation's folder, claimed.
        names: Perceptions and drivers, as envs.evaluate takes them.

    Returns:
        SHA-256 of what each name is read from: weights, a policy, or the module of a class of the user's and the files
        that the class names, but not what it imports. Names that come with the package are left out, but for m3depth.

    Raises:
        DatasetError: Weights or code differ from those that drove; the message names them. Or the folder's file of
            settings holds no digests.
    """
    digests = {name: digest for name in names if (digest := _digest(name))}
    previous = read_json(folder.mark_path).get(WEIGHTS, {})
    if not isinstance(previous, dict):
        raise DatasetError(f"{folder.mark_path}: {WEIGHTS} must hold digests by name, got {previous!r:.60}")
    for name in sorted(digests.keys() & previous.keys()):
        if digests[name] != previous[name]:
            file = _read_from(name)
            what = "code or files" if file is not None and file.suffix == ".py" else "weights"
            raise DatasetError(
                f"{folder.mark_path}: {name} has other {what} than when it drove these episodes; choose another --out"
            )
    folder.note(**{WEIGHTS: {**previous, **digests}})
    return digests


def noted_runtime(folder: ResultFolder, names: Sequence[str], wanted: str) -> str | None:
    """Check that networks ran in the same runtime in the episodes of a claimed folder, and note that of today.

    M3Depth is compared with M3Depth, and other networks with each other, as OpenVINO may run M3Depth alone. A folder of
    an earlier release has program and version of M3Depth alone. It keeps that record, as nobody knows on which device
    and in which precision its first episodes were driven. It has no record of other networks, and takes that of today.

    Args:
        folder: The evaluation's folder, claimed.
        names: Perceptions, as envs.evaluate takes them.
        wanted: The runtime that the user asks for, as chosen_runtime takes it.

    Returns:
        The record of the folder, as joined_runtimes returns it; None where no network drove the episodes.

    Raises:
        DatasetError: Such a network drove episodes in another program, version or precision, or on another kind of
            device; the message names both. Or the folder's file of settings holds no such record.
    """
    mark = read_json(folder.mark_path)
    others = [name for name in names if is_other_network(name)]
    records: dict[str, str | None] = {}
    for key, of_key in ((RUNTIME, [name for name in names if name not in others]), (OTHERS_RUNTIME, others)):
        previous = mark.get(key)
        if not (previous is None or isinstance(previous, str)):
            raise DatasetError(f"{folder.mark_path}: {key} must be text, got {previous!r:.60}")
        runtime = recorded_runtime(of_key, wanted) if of_key else None
        if previous is not None and runtime is not None and not same_runtime(previous, runtime):
            flags = "--out or --runtime" if key == RUNTIME else "--out"
            raise DatasetError(
                f"{folder.mark_path}: {NETWORKS[key]} drove these episodes in {previous}, not in {runtime}; choose "
                f"another {flags}"
            )
        records[key] = runtime if previous is None else previous
    folder.note(**{key: record for key, record in records.items() if record is not None})
    return joined_runtimes(records.values())


def noted_versions(folder: ResultFolder, driving: bool) -> dict[str, Any]:
    """Note the versions of this process beside those of earlier ones if it is to drive, and return all of them.

    A folder of an earlier release has none, and takes those of today.

    Args:
        folder: The evaluation's folder, claimed.
        driving: Whether there are episodes left to drive.

    Raises:
        DatasetError: The folder's file of settings holds no such record.
    """
    earlier = read_json(folder.mark_path).get(VERSIONS)
    if not (earlier is None or isinstance(earlier, dict)):
        raise DatasetError(f"{folder.mark_path}: {VERSIONS} must hold versions by name, got {earlier!r:.60}")
    parts = [] if earlier is None else [earlier]
    if driving or not parts:
        parts.append(versions())
    folder.note(**{VERSIONS: (noted := joined_versions(parts))})
    return noted


@contextmanager
def unchanged(config: EvaluateConfig, names: Sequence[str], provenance: Provenance) -> Iterator[None]:
    """Call check_unchanged before and after the block, which drives."""
    check_unchanged(config, names, provenance)
    yield
    check_unchanged(config, names, provenance)


def check_unchanged(config: EvaluateConfig, names: Sequence[str], provenance: Provenance) -> None:
    """Raise DatasetError if files that a drive is made from are not those that the evaluation noted.

    Args:
        config: The settings, of which a place or a suite may be a file.
        names: The drivers and perceptions of the drive, as envs.evaluate takes them.
        provenance: "driven_with", the settings as they were noted; "weights", SHA-256 of the files of drivers and
            perceptions, as noted_digests returned them.
    """
    changed = [str(_read_from(name) or name) for name in names if _digest(name) != provenance["weights"].get(name)]
    if config.content() != provenance["driven_with"]:
        changed.append(str(config.suite or config.scene))
    if changed:
        raise DatasetError(
            f"{changed[0]}: on {platform.node()}, this is not the file that the drives began with; put that one back, "
            "or choose another --out"
        )


def check_worker(perception: str, wanted: str, expected: str | None) -> None:
    """Raise DatasetError if a worker would run a network in another runtime than the evaluation records.

    Args:
        perception: The perception, as envs.evaluate takes it.
        wanted: The runtime that the user asks for, as chosen_runtime takes it.
        expected: recorded_runtime of both where the evaluation was started.
    """
    if (runtime := recorded_runtime([perception], wanted)) != expected:
        raise DatasetError(
            f"the worker on {platform.node()} would run {perception} in {runtime}, and this evaluation runs it in "
            f"{expected}; make the workers alike, or choose a --runtime that all of them have"
        )


def check_paths(config: EvaluateConfig, names: Sequence[str], folder: Path) -> None:
    """Raise DatasetError if a worker runs in another folder than the command, and a file has a relative path.

    Args:
        config: The settings, of which a place or a suite may be a file.
        names: The driver and the perception of a drive, as envs.evaluate takes them.
        folder: The folder in which the command was started.
    """
    current, files = Path.cwd(), [file for name in names if (file := _read_from(name)) is not None]
    files += [file for name in names if ":" in name for file in class_files(name)]
    files += [Path(name) for name in (config.scene, config.suite) if name is not None and name.endswith(".json")]
    relative = [file for file in files if not file.is_absolute()]
    if relative and current != folder:
        raise DatasetError(
            f"{relative[0]}: the worker on {platform.node()} runs in {current}, and would not read the file of "
            f"{folder}; give an absolute path, or start the workers in that folder"
        )


def _digest(name: str) -> str | None:
    """Return the SHA-256 of what a driver or a perception is read from; None for names without a file."""
    return joint_digest([Path(name)]) if name.endswith(".zip") else EstimatorName(name).digest()


def _read_from(name: str) -> Path | None:
    """Return the file of weights, of a policy, or of a class by its path; None for names without one."""
    return Path(name) if name.endswith(".zip") else EstimatorName(name).file
