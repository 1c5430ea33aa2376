"""What the episodes in an evaluation's folder were driven with: noted there, and compared before more are added."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from m3depth.estimator import EstimatorName
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.results.lock import LOCK
from marssim.base.results.out_folder import check_out


def check_folder(out: Path, settings: str) -> None:
    """Raise DatasetError unless a folder is new, empty or an evaluation's: one in which a file `settings` stands."""
    check_out(out)
    if not out.is_dir() or (out / settings).is_file():
        return
    if any(file.name != LOCK and not file.name.startswith(f".{settings}.") for file in out.iterdir()):
        raise DatasetError(f"--out {out}: the folder is not empty and holds no evaluation of drives; choose another")


def noted_settings(file: Path, settings: dict[str, Any], names: Sequence[str]) -> dict[str, str]:
    """Check that a folder's episodes were driven under these settings, and by the same weights and code; note them.

    file: where they are noted. settings: by flag, without its dashes. names: perceptions and drivers, as envs.evaluate
    takes them. Returns the SHA-256 of what each of them is read from: weights, a policy, or the file of a class of
    one's own, but not what that imports; names that come with the package are left out, but for m3depth.
    Raises DatasetError that says what differs.
    """
    digests = {name: digest for name in names if (digest := _digest(name))}
    known: dict[str, str] = {}
    if file.is_file():
        before = read_json(file)
        known = before.pop("weights", {})
        if changed := _changed(before, settings):
            raise DatasetError(f"{file}: the folder's episodes were driven with {changed}; choose another --out")
        for name in sorted(digests.keys() & known.keys()):
            if digests[name] != known[name]:
                file_read = _read_from(name)
                what = "code" if file_read is not None and file_read.suffix == ".py" else "weights"
                raise DatasetError(f"{file}: {name} drove with other {what} then; choose another --out")
    write_json(file, {**settings, "weights": {**known, **digests}})
    return digests


def _changed(before: dict[str, Any], now: dict[str, Any]) -> str:
    """The flags that differ, with what they were."""
    other = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    flags = {name: f"--{name.replace('_', '-')}" for name in other}
    return ", ".join(f"{flags[name]} {before[name]}" if name in before else f"no {flags[name]}" for name in other)


def _digest(name: str) -> str | None:
    file = _read_from(name)
    return hashlib.sha256(file.read_bytes()).hexdigest() if file is not None else None


def _read_from(name: str) -> Path | None:
    """The file of weights, of a policy, or of a class by its path; None for names without one."""
    return Path(name) if name.endswith(".zip") else EstimatorName(name).file
