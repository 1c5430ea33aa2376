"""The bodies of a scene that are no rocks of Golombek's law: slabs, beds and chips, blocks of ledges, and fragments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.plates import Plates, plate_bodies
from marssim.scene.rocks.mesh import Rocks, joined_bodies, no_bodies

KINDS = ("slabs", "ledges", "fragments")  # in the order of their bodies; beds and chips count as slabs


@dataclass(frozen=True)
class Outcrop:
    """Slabs with their beds and chips, blocks of ledges, and fragments, which do not count as rocks in the size law.

    Attributes:
        bodies: All of them, ordered by KINDS.
        count: Number of bodies of each of KINDS.
        traits: What the scene drew.
    """

    bodies: Rocks = field(default_factory=no_bodies)
    count: tuple[int, int, int] = (0, 0, 0)
    traits: Traits = field(default_factory=Traits)

    def __len__(self) -> int:
        return len(self.bodies)

    def surface_ids(self, rocks: int) -> dict[str, list[int]]:
        """Return the surface ids of each kind, after those of a number of rocks: [first, last], or [] for none."""
        ends = np.cumsum([rocks, *self.count]).tolist()
        spans = dict(zip(("rocks", *KINDS), zip([0, *ends], ends)))
        return {kind: [start + 1, end] if end > start else [] for kind, (start, end) in spans.items()}


def build_outcrop(
    slabs: list[Plates], ledges: list[Plates], fragments: Rocks, traits: Traits, rng: np.random.Generator
) -> Outcrop:
    """Return the outcrop of a scene.

    Args:
        slabs: The slabs, the beds on them, and the chips.
        ledges: The blocks of ledges.
        fragments: The fragments.
        traits: What the scene drew.
        rng: Random generator.
    """
    parts = [[plate_bodies(plates, rng) for plates in kind if len(plates)] for kind in (slabs, ledges)]
    count = tuple(sum(len(bodies) for bodies in part) for part in parts)
    bodies = joined_bodies([*parts[0], *parts[1], fragments])
    return Outcrop(bodies, (count[0], count[1], len(fragments)), traits)
