"""The weights and the code that drove the episodes in a folder: noted there, and compared before more are added."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from m3depth.estimator import EstimatorName
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.results.claim import ResultFolder

WEIGHTS = "weights"  # key in the settings file: SHA-256 by the name of a perception or driver


def noted_digests(folder: ResultFolder, names: Sequence[str]) -> dict[str, str]:
    """Check that the episodes of a claimed folder were driven by the same weights and code, and note those of today.

    Args:
        folder: The evaluation's folder, claimed.
        names: Perceptions and drivers, as envs.evaluate takes them.

    Returns:
        SHA-256 of what each name is read from: weights, a policy, or the file of a class of the user's, but not what
        that imports. Names that come with the package are left out, but for m3depth.

    Raises:
        DatasetError: Weights or code differ from those that drove; the message names them.
    """
    digests = {name: digest for name in names if (digest := _digest(name))}
    previous: dict[str, str] = read_json(folder.mark_path).get(WEIGHTS, {})
    for name in sorted(digests.keys() & previous.keys()):
        if digests[name] != previous[name]:
            file = _read_from(name)
            what = "code" if file is not None and file.suffix == ".py" else "weights"
            raise DatasetError(
                f"{folder.mark_path}: {name} has other {what} than when it drove these episodes; choose another --out"
            )
    folder.note(**{WEIGHTS: {**previous, **digests}})
    return digests


def _digest(name: str) -> str | None:
    file = _read_from(name)
    return hashlib.sha256(file.read_bytes()).hexdigest() if file is not None else None


def _read_from(name: str) -> Path | None:
    """Return the file of weights, of a policy, or of a class by its path; None for names without one."""
    return Path(name) if name.endswith(".zip") else EstimatorName(name).file
