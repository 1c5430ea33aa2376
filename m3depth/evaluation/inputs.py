"""What tells whether the inputs of an evaluation are still the same, in JSON's types."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from m3depth.datasets.open import PairList
from m3depth.stereo.pairs import StereoPairs


def state_of_pairs(dataset: StereoPairs) -> Any:
    """Of a split of a dataset: the digest of its content, where it has one; state_of_files of other layouts; of any
    other sequence its length."""
    if (digest := getattr(dataset, "digest", None)) is not None:
        return digest
    if isinstance(dataset, PairList):
        return state_of_files(path for pair in dataset.pairs for path in (pair.left, pair.right, pair.truth))
    return len(dataset)


def state_of_files(files: Iterable[Path]) -> str:
    """SHA-256 of their paths, sizes and times of change: to read gigabytes would take longer than to score them."""
    digest = hashlib.sha256()
    for path in files:
        told = path.stat() if path.exists() else None
        digest.update(f"{path.resolve()}\0{told and (told.st_size, told.st_mtime_ns)}\n".encode())
    return digest.hexdigest()
