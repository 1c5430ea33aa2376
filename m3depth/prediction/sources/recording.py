"""What a video and a bag have in common: pairs that are read by their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np


class Recording(Protocol):
    """Pairs in one file or a few files.

    Attributes:
        paths: The files.
        rate: Pairs a second; 0 if unknown.
    """

    paths: tuple[Path, ...]
    rate: float

    def read(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return both images of a pair, uint8, grey or RGB; the numbers of the calls rise."""

    def valid(self, number: int) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return where the images of a pair show the scene, (H, W) bool each; None: everywhere."""

    def record(self, number: int) -> dict[str, Any]:
        """Return what prediction.json says of a pair."""
