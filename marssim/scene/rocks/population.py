"""The rocks of a scene before they are meshed: how many there are, how large, where, and of what shape."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import scipy

from marssim.scene.rocks.golombek import MAX_DIAMETER, draw_diameters, number_density
from marssim.scene.rocks.placement import place
from marssim.scene.rocks.shape_library import VARIANTS
from marssim.scene.rocks.shapes import FAMILIES, LEVELS

CAMERA_EXTENT = 0.4  # largest |x| and |y| of a camera, in half sides of the fine square
# most bodies that the 16 bits of a dataset's surface.png can number, besides the sky, the ground and the rover
MAX_BODIES = 65_533
MAX_ROCKS = 50_000  # most of these that are rocks; the others are bedrock and fragments
SAFETY_SPREADS = 6.0  # standard deviations by which the expected number of rocks stays below MAX_ROCKS
LEAST_DISTANCE = 1.6  # [m] distance at which a camera is assumed to see the rocks around it
# [rad] angular diameters at which a rock gets the next level of detail; the first two are 3 px and 7 px wide at 512 px
LEVEL_ANGLES = (0.005, 0.011, 0.026, 0.09, 0.22, 0.6)
COBBLE_ANGLE = 0.005  # [rad] angle under which a camera sees the smallest cobbles far away: 3 px at 512 px
LARGE = 0.15  # [m] diameter of the smallest rocks that these cobbles keep off
COBBLE_RINGS = (0.75, 1.0, 1.25, 1.5, 2.0, 2.5)  # [half sides of the fine square] edges of their rings
# least diameters by distance from the middle: (distance in half sides of the fine square, least diameter [m] up to it)
LEAST_DIAMETERS = ((0.75, 0.05), (1.0, 0.08), (2.5, 0.25), (np.inf, 0.6))
MIN_HEIGHT_RATIO, MAX_HEIGHT_RATIO = 0.15, 1.0  # height above ground over diameter
FLATNESS = np.array([1.2, 0.5, 1.1])  # relative height over diameter of each of FAMILIES: slabs are flat
BURIAL_SHAPE = (2.0, 1.4)  # of the beta distribution of burial: few rocks lie on the ground, most sit in it
CLEARED_DIAMETER = 0.1  # [m] diameter of the smallest rocks that clear discs keep out


@dataclass(frozen=True)
class RockConfig:
    """The rocks: how many lie on the ground, and what they look like."""

    k: float = 0.033
    """Share of the ground that rocks of any size cover, 0 to 0.4 (k of Golombek's law): Utopia has 0.033, Viking 2
    0.15."""
    min_diameter: float = 0.03
    """Diameter of the smallest rocks [m], at least 0.01 and below 2.5, near the middle where the cameras stand. Farther
    out, those that look smaller than 3 px of 512 are left out."""
    cluster: float = 0.3
    """Share of the rocks that lie beside a larger one, 0 to 1."""
    height_ratio: float = 0.5
    """Mean height of the rocks above ground over their diameter, 0.1 to 1. No rock is lower than 0.15 or higher than 1
    of its diameter, so 0.1 gives a mean of 0.16, and 1 one of 0.81."""
    buried: tuple[float, float] = (0.1, 0.7)
    """Share of a rock's height that is below ground, LOW HIGH, 0 to 0.75. Each rock draws its own, most of them from
    the middle of the range or a little above it. The more of a rock is buried, the lower is the rest."""
    families: tuple[float, float, float] = (0.45, 0.25, 0.3)
    """Relative numbers of angular, slabby and rounded rocks: three shares in any unit, 0 or more and not all 0."""
    albedo: float = 0.85
    """Mean brightness of the bare rocks over that of bright dust, 0.2 to 2.5. Single rocks lie within 0.45 and 1.8 of
    the mean. The dust on them draws what shows towards 0.85."""
    albedo_spread: float = 0.3
    """By how much the brightness of single rocks differs: standard deviation over the mean, 0 to 0.5."""

    def __post_init__(self) -> None:
        if not 0 <= self.k <= 0.4:
            raise ValueError(f"k must lie in [0, 0.4], got {self.k}")
        if not 0.01 <= self.min_diameter < MAX_DIAMETER:
            raise ValueError(f"min_diameter must lie in [0.01, {MAX_DIAMETER}), got {self.min_diameter}")
        if not 0 <= self.cluster <= 1:
            raise ValueError(f"cluster must lie in [0, 1], got {self.cluster}")
        if not 0.1 <= self.height_ratio <= 1:
            raise ValueError(f"height_ratio must lie in [0.1, 1], got {self.height_ratio}")
        if len(np.atleast_1d(self.buried)) != 2 or not 0 <= self.buried[0] <= self.buried[1] <= 0.75:
            raise ValueError(f"buried must be a range within [0, 0.75], got {self.buried}")
        shares = self.families
        if len(shares) != len(FAMILIES) or not min(shares) >= 0 or not 0 < sum(shares) < np.inf:
            raise ValueError(f"families needs {len(FAMILIES)} shares that are not all zero, got {self.families}")
        if not 0.2 <= self.albedo <= 2.5:
            raise ValueError(f"albedo must lie in [0.2, 2.5], got {self.albedo}")
        if not 0 <= self.albedo_spread <= 0.5:
            raise ValueError(f"albedo_spread must lie in [0, 0.5], got {self.albedo_spread}")


@dataclass(frozen=True)
class RockPopulation:
    """What N rocks are by themselves, whatever the ground under them.

    Attributes:
        xy: (N, 2) positions [m].
        diameter: (N,) diameters [m].
        height: (N,) heights above ground [m].
        buried: (N,) shares of the whole heights that lie below ground.
        level: (N,) levels of detail, descending.
        family: (N,) indices of FAMILIES.
        variant: (N,) shapes within the families.
        yaw: (N,) turns about the vertical [rad].
        stretch: (N,) square roots of the ratios of the short to the long axis.
        albedo: (N,) brightness relative to the ground.
    """

    xy: np.ndarray
    diameter: np.ndarray
    height: np.ndarray
    buried: np.ndarray
    level: np.ndarray
    family: np.ndarray
    variant: np.ndarray
    yaw: np.ndarray
    stretch: np.ndarray
    albedo: np.ndarray

    def chosen(self, which: np.ndarray) -> RockPopulation:
        """Return some of the rocks. which: their indices."""
        return RockPopulation(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


def draw_population(
    config: RockConfig, half: float, horizon: float, rng: np.random.Generator,
    clear: tuple[tuple[float, float, float], ...],
) -> RockPopulation:  # fmt: skip
    """Draw the rocks of a scene.

    Where cameras stand and a little around, the size law holds from min_diameter on. Farther out it holds from the size
    that a camera sees as a few pixels.

    Args:
        config: Number and shape of the rocks.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
        rng: Random generator.
        clear: Discs (x, y, radius) [m] that rocks of diameter CLEARED_DIAMETER and more stay out of. A rock counts as
            the disc of its diameter, so a corner of it may reach into a clear disc.

    Raises:
        ValueError: There are more rocks than a dataset can number.
    """
    cobble_rng = rng.spawn(1)[0]
    diameter, xy = _scatter(config, half, horizon, rng)
    parts = [_outside(diameter, xy, clear)]
    parts.append(_outside(*_cobbles(config, half, horizon, diameter, xy, cobble_rng), clear))
    drawn = [_shaped(config, *part, half, source) for part, source in zip(parts, (rng, cobble_rng))]
    both = {f.name: np.concatenate([getattr(part, f.name) for part in drawn]) for f in fields(RockPopulation)}
    # rocks of one level are built together, and face_rock must ascend
    return RockPopulation(**both).chosen(np.argsort(-both["level"], kind="stable"))


def _outside(
    diameter: np.ndarray, xy: np.ndarray, clear: tuple[tuple[float, float, float], ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the diameters and positions of the rocks that lie outside the clear discs, or may lie in them."""
    free = np.ones(len(diameter), dtype=bool)
    for x, y, radius in clear:
        free &= (np.hypot(xy[:, 0] - x, xy[:, 1] - y) > radius + diameter / 2) | (diameter < CLEARED_DIAMETER)
    return diameter[free], xy[free]


def _shaped(
    config: RockConfig, diameter: np.ndarray, xy: np.ndarray, half: float, rng: np.random.Generator
) -> RockPopulation:
    """Draw the shapes of rocks of given diameters (N,) and positions (N, 2) [m]."""
    away: np.ndarray = np.abs(xy).max(axis=1, initial=0) - CAMERA_EXTENT * half
    level = detail_level(diameter, away + LEAST_DISTANCE)
    order = np.argsort(-np.maximum(level, 0), kind="stable")  # it determines the scene of a seed
    diameter, xy, level = diameter[order], xy[order], level[order]
    n = len(diameter)

    shares = np.array(config.families) / sum(config.families)
    family = rng.choice(len(FAMILIES), n, p=shares)
    buried = draw_burial(config.buried, n, rng)
    # scaled so that the mean over families and burial is height_ratio
    ratio = config.height_ratio * FLATNESS[family] / (shares @ FLATNESS) * rng.lognormal(-0.03, 0.25, n)
    ratio *= (1 - buried) / (1 - mean_burial(config.buried))
    return RockPopulation(
        xy=xy,
        diameter=diameter,
        height=diameter * np.clip(ratio, MIN_HEIGHT_RATIO, MAX_HEIGHT_RATIO),
        level=level,
        family=family,
        buried=buried,
        variant=rng.integers(0, VARIANTS, n),
        yaw=rng.uniform(0, 2 * np.pi, n),
        stretch=np.sqrt(rng.uniform(0.45, 1.0, n)),
        albedo=config.albedo * np.clip(rng.normal(1, config.albedo_spread, n), 0.45, 1.8),
    )


def draw_burial(span: tuple[float, float], count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the shares (count,) of the heights of rocks that are below ground; span: least and largest."""
    return np.asarray(span[0] + (span[1] - span[0]) * rng.beta(*BURIAL_SHAPE, count))


def mean_burial(span: tuple[float, float]) -> float:
    """Return the mean of `draw_burial`."""
    return span[0] + (span[1] - span[0]) * BURIAL_SHAPE[0] / sum(BURIAL_SHAPE)


def detail_level(diameter: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return the icosphere level of each rock, from the largest angle D / distance under which a camera may see it.

    Args:
        diameter: (N,) diameters [m].
        distance: (N,) least distances to a camera [m].

    Returns:
        (N,) int levels.
    """
    return LEVELS[0] + np.digitize(np.asarray(diameter) / np.maximum(distance, LEAST_DISTANCE), LEVEL_ANGLES)


def most_rocks(config: RockConfig, half: float, horizon: float) -> float:
    """Return the number of rocks that hardly any scene exceeds; scenes whose number exceeds MAX_ROCKS are refused.

    Args:
        config: Number and shape of the rocks.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
    """
    expected = 0.0
    for inner, outer, least in _rings(config, half, horizon):
        expected += float(number_density(np.array(least), config.k)) * 4 * (outer**2 - inner**2)
    return expected + SAFETY_SPREADS * float(np.sqrt(expected))


def _rings(config: RockConfig, half: float, horizon: float) -> list[tuple[float, float, float]]:
    """Return square rings around the middle of the scene: from and to half a side [m], and least diameter [m]."""
    rings, inner = [], 0.0
    near = min(CAMERA_EXTENT * half + 4.0, half)  # pebbles farther from a camera are smaller than a few pixels
    for reach, smallest in ((near, 0.0), *((ring * half, least) for ring, least in LEAST_DIAMETERS)):
        outer = min(reach, horizon)
        if outer > inner:
            rings.append((inner, outer, max(smallest, config.min_diameter)))
            inner = outer
    return rings


def _scatter(
    config: RockConfig, half: float, horizon: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the diameters (N,) and positions (N, 2) of all rocks [m]."""
    rings, number = _rings(config, half, horizon), most_rocks(config, half, horizon)
    if number > MAX_ROCKS:  # the largest number that may be drawn, so that the first scene fails and not a later one
        raise ValueError(
            f"a scene can hold {MAX_ROCKS} rocks, but {number:.0f} may be drawn; choose a smaller `rocks.k` or `size`, "
            f"or a larger `rocks.min_diameter`"
        )
    diameters = [draw_diameters(config.k, least, 4 * (outer**2 - inner**2), rng) for inner, outer, least in rings]
    inners, outers = (np.repeat([ring[i] for ring in rings], [len(d) for d in diameters]) for i in (0, 1))
    diameter = np.concatenate(diameters)
    return diameter, place(diameter, inners, outers, config.cluster, rng)


def _cobbles(
    config: RockConfig, half: float, horizon: float, diameter: np.ndarray, xy: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the diameters (N,) and positions (N, 2) [m] of the cobbles that _scatter leaves out but a camera can see.

    A cobble lies where it lies whatever camera looks at it; only the distance from all of them decides whether it is
    drawn at all. If there would be more than MAX_ROCKS rocks, those that look smallest are left out.

    Args:
        config: Number of the rocks.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
        diameter: (M,) diameters of the other rocks [m].
        xy: (M, 2) their positions [m].
        rng: Random generator.
    """
    rings = _cobble_rings(config, half, horizon)
    diameters = []
    for inner, outer, least, present in rings:
        drawn = draw_diameters(config.k, least, 4 * (outer**2 - inner**2), rng)
        diameters.append(drawn[drawn < present])
    size = np.concatenate([np.zeros(0), *diameters])
    inners, outers = (np.repeat([0.0, *(ring[i] for ring in rings)], [0, *map(len, diameters)]) for i in (0, 1))
    at = place(size, inners, outers, config.cluster, rng)
    free = _beside_large(at, diameter, xy)
    size, at = size[free], at[free]
    angle = size / (np.abs(at).max(axis=1, initial=0) - CAMERA_EXTENT * half + LEAST_DISTANCE)
    most = np.sort(np.argsort(-angle, kind="stable")[: max(MAX_ROCKS - len(diameter), 0)])
    return size[most], at[most]


def _cobble_rings(config: RockConfig, half: float, horizon: float) -> list[tuple[float, float, float, float]]:
    """Return the square rings that cobbles are added to: inner and outer half side, and diameters from and to [m]."""
    inner, rings = min(CAMERA_EXTENT * half + 4.0, half), []
    for edge in COBBLE_RINGS:
        outer = min(edge * half, horizon)
        if outer > inner:
            least = max(COBBLE_ANGLE * (inner - CAMERA_EXTENT * half + LEAST_DISTANCE), config.min_diameter)
            present = next(smallest for reach, smallest in LEAST_DIAMETERS if outer <= reach * half)
            rings.append((inner, outer, least, present))
            inner = outer
    return rings


def _beside_large(at: np.ndarray, diameter: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return which cobbles at points (N, 2) lie under none of the large rocks; diameter: (M,), xy: (M, 2) of rocks."""
    free = np.ones(len(at), dtype=bool)
    large = np.flatnonzero(diameter > LARGE)
    if len(at) and len(large):
        covered = scipy.spatial.cKDTree(at).query_ball_point(xy[large], diameter[large] / 2)
        free[np.concatenate([np.zeros(0, int), *covered]).astype(int)] = False
    return free
