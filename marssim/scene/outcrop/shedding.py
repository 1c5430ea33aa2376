"""Pieces that broke off bodies of rock: how many there are, how large they are, and how far they lie from the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PARENT_SIZE = 0.5  # [m] diameter of the bodies that have the mean number of pieces; it is proportional to the diameter
FOOT = (0.9, 1.2)  # distance of a body's foot from its middle, over its radius


@dataclass(frozen=True)
class Shedding:
    """How bodies break into pieces.

    Attributes:
        sizes: Least and largest diameter of pieces [m].
        steepness: The number of pieces larger than D falls as D^-steepness.
        largest_share: Largest diameter of a piece over that of its body.
        most: Largest number of pieces of a body.
        reach: Mean distance of a piece from the body's foot, over the body's diameter.
    """

    sizes: tuple[float, float]
    steepness: float
    largest_share: float
    most: int
    reach: float


@dataclass(frozen=True)
class Pieces:
    """N pieces.

    Attributes:
        parent: (N,) int, the body that each of them broke off.
        diameter: (N,) diameters [m].
        xy: (N, 2) positions [m].
    """

    parent: np.ndarray
    diameter: np.ndarray
    xy: np.ndarray

    def __len__(self) -> int:
        return len(self.parent)


def shed(law: Shedding, density: np.ndarray, middle: np.ndarray, size: np.ndarray, rng: np.random.Generator) -> Pieces:
    """Draw the pieces of bodies, in the order of the bodies.

    Args:
        law: How bodies break.
        density: (B,) expected number of pieces of each body if it had a diameter of PARENT_SIZE.
        middle: (B, 2) middles of the bodies [m].
        size: (B,) diameters of the bodies [m].
        rng: Random generator.
    """
    number = np.minimum(rng.poisson(density * size / PARENT_SIZE), law.most)
    parent = np.repeat(np.arange(len(size)), number)
    count = len(parent)
    least, largest = law.sizes
    diameter = rng.uniform(largest**-law.steepness, least**-law.steepness, count) ** (-1 / law.steepness)
    angle = rng.uniform(0, 2 * np.pi, count)
    away = size[parent] * (0.5 * rng.uniform(*FOOT, count) + law.reach * rng.exponential(1, count))
    xy = middle[parent] + away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    kept = diameter < law.largest_share * size[parent]
    return Pieces(parent[kept], diameter[kept], xy[kept])
