"""How high plates of bedrock stand above the ground, so that rocks lie on them and not in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from marssim.scene.outcrop.plates import Plates
from marssim.scene.outcrop.resting import Ground

CELL = 0.05  # [m] grid spacing
SHIFT = 4  # binary digits of sub-pixel positions in OpenCV's drawing


@dataclass(frozen=True)
class Tops:
    """The plates of a scene's fine square, seen from above.

    Attributes:
        number: (n, n) int32 number of the plate over each node of a grid of spacing CELL, 0 for none; rows northward.
        plane: (N + 1, 3) tops of the plates, z0 + east x + north y [m]; -inf for number 0.
        half: Half the side of the square [m].
    """

    number: np.ndarray
    plane: np.ndarray
    half: float

    @classmethod
    def from_plates(cls, plates: Sequence[Plates], half: float) -> Tops:
        """Return the tops of plates; where two overlap, the one that stands higher above the ground counts."""
        number = np.zeros((int(np.ceil(2 * half / CELL)) + 1,) * 2, dtype=np.int32)
        planes = [np.array([[-np.inf, 0, 0]]), *(part.plane for part in plates)]
        height = np.concatenate([np.zeros(0), *(part.exposed for part in plates)])
        outlines = [points for part in plates for points in part.outline]
        for n in np.argsort(height, kind="stable"):
            if np.abs(outlines[n]).max(axis=0).min() < half + 1:
                at = np.rint((outlines[n] + half) / CELL * (1 << SHIFT)).astype(np.int32)
                cv2.fillPoly(number, [at], int(n) + 1, cv2.LINE_8, SHIFT)
        return cls(number, np.concatenate(planes), half)

    def lift(self, x: np.ndarray, y: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return how far plates stand above the ground [m], 0 where there is none.

        Args:
            x: (...) east coordinates [m].
            y: (...) north coordinates [m].
            ground: (...) heights of the ground there [m].
        """
        side = len(self.number) - 1
        i, j = (np.rint((np.asarray(v) + self.half) / CELL).astype(int) for v in (x, y))
        inside = (i >= 0) & (j >= 0) & (i <= side) & (j <= side)
        plane = self.plane[np.where(inside, self.number[np.clip(j, 0, side), np.clip(i, 0, side)], 0)]
        return np.asarray(np.maximum(plane[..., 0] + plane[..., 1] * x + plane[..., 2] * y - ground, 0.0))


def beside(slabs: Sequence[Plates], ledges: Sequence[Plates], half: float, height_at: Ground) -> list[Plates]:
    """Return the slabs that do not lie under a ledge.

    Args:
        slabs: The slabs.
        ledges: The blocks of ledges.
        half: Half the side of the finely gridded square [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
    """
    if not ledges:
        return list(slabs)
    tops, out = Tops.from_plates(ledges, half), []
    for part in slabs:
        x, y = (np.column_stack([part.outline[..., i], part.middle[:, i]]) for i in (0, 1))
        out.append(part.chosen((tops.lift(x, y, height_at(x, y)) == 0).all(axis=1)))
    return out
