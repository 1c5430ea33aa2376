"""Digests by which a command that continues recognises its inputs, in JSON's types."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from m3depth.datasets.open import PairList
from m3depth.datasets.pair_files import PairFiles
from m3depth.stereo.pairs import StereoPairs


def state_of_pairs(dataset: StereoPairs) -> Any:
    """Return what identifies the content of a split.

    Returns:
        The digest of its content where the dataset has one, state_of_files for other layouts, and the length of any
        other sequence.
    """
    if (digest := getattr(dataset, "digest", None)) is not None:
        return digest
    if isinstance(dataset, PairList):
        files = (path for pair in dataset.pairs for path in _files_of(pair))
        return state_of_files(path for path in files if path is not None)
    return len(dataset)


def _files_of(pair: PairFiles) -> Iterable[Path | None]:
    """Return the files that a pair is read from, its mask and calibration file among them; None where it has none."""
    calibration = getattr(pair.calibration, "file", None)
    return pair.left, pair.right, pair.truth, pair.normal, pair.visible, calibration


def state_of_files(files: Iterable[Path]) -> str:
    """Return the SHA-256 of the files' paths, sizes and times of change.

    Their content is not read: reading gigabytes would take longer than scoring them.
    """
    digest = hashlib.sha256()
    for path in files:
        status = path.stat() if path.exists() else None
        digest.update(f"{path.resolve()}\0{status and (status.st_size, status.st_mtime_ns)}\n".encode())
    return digest.hexdigest()
