"""The settings of slabs, ledges, chips and fragments, and the values that a scene draws from them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from marssim.scene.ranges import Range, check_ranges

OUTCROP_LIMITS = {
    "slabs": (0.0, 0.7), "slab_size": (0.15, 2.0), "slab_tilt_deg": (0.0, 15.0), "slab_height": (0.02, 0.15),
    "ledges": (0.0, 20.0), "ledge_height": (0.05, 0.4), "ledge_length": (1.0, 20.0), "fragments": (0.0, 1.0),
    "brightness": (0.5, 2.5),
}  # fmt: skip


@dataclass(frozen=True)
class OutcropConfig:
    """Ranges from which each scene draws its bedrock and broken pieces, LOW HIGH; give a value twice to fix it."""

    slabs: Range = (0.0, 0.0)
    """Share of the ground in which plates of bedrock lie like broken pavement, LOW HIGH, 0 to 0.7. Sand lies between
    and over them, so they show on about half of it."""
    slab_size: Range = (0.35, 1.0)
    """Typical diameter of these plates [m], LOW HIGH, 0.15 to 2. The plates of a scene differ by a factor of three."""
    slab_tilt_deg: Range = (1.0, 5.0)
    """Typical tilt of the plates to the ground [deg], LOW HIGH, 0 to 15. None is tilted by more than 15."""
    slab_height: Range = (0.03, 0.08)
    """Typical height of a plate's highest edge above the sand [m], LOW HIGH, 0.02 to 0.15."""
    ledges: Range = (0.0, 0.0)
    """Number of ledges of layered bedrock on 1000 m2 of ground, LOW HIGH, 0 to 20."""
    ledge_height: Range = (0.1, 0.35)
    """Height of the ledges [m], LOW HIGH, 0.05 to 0.4. Each ledge draws its own."""
    ledge_length: Range = (3.0, 9.0)
    """Length of the ledges [m], LOW HIGH, 1 to 20. Each ledge draws its own."""
    fragments: Range = (0.1, 0.5)
    """How densely broken pieces lie around, LOW HIGH: fragments of 2 to 12 cm around large rocks and ledges, and thin
    chips of 3 to 25 cm around slabs and ledges. 0 has none, 1 the most."""
    brightness: Range = (1.4, 2.1)
    """Brightness of slabs and ledges on the scale of rocks.albedo, LOW HIGH, 0.5 to 2.5. The bedrock that
    look.bedrock shows has 1.1."""

    def __post_init__(self) -> None:
        check_ranges(self, OUTCROP_LIMITS)


@dataclass(frozen=True)
class Traits:
    """What a scene drew from its OutcropConfig, which explains the values. A ledge draws its own from its range.

    Attributes:
        slabs: Share of the ground with slabs, 0 to 1.
        slab_size: Typical diameter of slabs [m].
        slab_tilt_deg: Typical tilt of slabs [deg].
        slab_height: Typical height of a slab's highest edge [m].
        ledges: Ledges on 1000 m2.
        fragments: Density of fragments and chips, 0 to 1.
        brightness: Brightness of slabs and ledges on the scale of rocks.albedo.
    """

    slabs: float = 0.0
    slab_size: float = 0.5
    slab_tilt_deg: float = 0.0
    slab_height: float = 0.05
    ledges: float = 0.0
    fragments: float = 0.0
    brightness: float = 1.3


def draw_traits(config: OutcropConfig, rng: np.random.Generator) -> Traits:
    """Draw the traits of a scene, each uniformly from its range."""
    return Traits(**{field.name: float(rng.uniform(*getattr(config, field.name))) for field in fields(Traits)})
