"""A Mars scene as pure data, drawn from a seed: ground, rocks, and the look of sun, air and dust."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from marssim.scene.look import Look, LookConfig, draw_look, sun_direction
from marssim.scene.outcrop.beds import upper_beds
from marssim.scene.outcrop.chips import draw_chips
from marssim.scene.outcrop.config import OutcropConfig, Traits, draw_traits
from marssim.scene.outcrop.fragments import draw_fragments
from marssim.scene.outcrop.ledges import draw_ledges
from marssim.scene.outcrop.outcrop import Outcrop, build_outcrop
from marssim.scene.outcrop.pavement import draw_slabs
from marssim.scene.outcrop.plates import Plates, nearest, outside
from marssim.scene.outcrop.resting import Ground
from marssim.scene.outcrop.tops import Tops, beside
from marssim.scene.rocks.golombek import REPORTED, covered_area
from marssim.scene.rocks.mesh import Rocks, build_rocks, joined_bodies
from marssim.scene.rocks.population import MAX_BODIES, MAX_ROCKS, RockConfig
from marssim.scene.terrain import ReliefConfig, Terrain, build_terrain

LARGEST = 400.0  # [m] side of the fine square: maps of its sand and steep ground, with cells of 5 cm, fill some 5 GB
# [m] At a horizon of 500 m the farthest corner is less than 1000 m away, the largest depth that a dataset can store.
SCENE_LIMITS = {"size": (1.0, LARGEST), "cell": (0.01, 1.0), "horizon": (1.0, 500.0)}
MAX_BEDROCK = 12_000  # most slabs, beds and blocks of ledges in a scene
MAX_PLATES = MAX_BODIES - MAX_ROCKS  # most of these and chips; chips have what bedrock leaves, and fragments the rest
MOST_CELLS = 5000  # along the side of the fine square: its 50 million triangles fill several GB


@dataclass(frozen=True)
class SceneConfig:
    """A place. With a seed it determines a Scene; see `preset` for the named places."""

    preset: str = "utopia"
    """Name of the place that the defaults come from. It only labels the scene."""
    relief: ReliefConfig = field(default_factory=ReliefConfig)
    """The shape of the ground."""
    rocks: RockConfig = field(default_factory=RockConfig)
    """The rocks on the ground."""
    outcrop: OutcropConfig = field(default_factory=OutcropConfig)
    """The slabs and ledges of bedrock, the chips around them, and the fragments around rocks."""
    look: LookConfig = field(default_factory=LookConfig)
    """The light and the surface."""
    size: float = 32.0
    """Side of the square in the middle of the scene that has the fine grid [m], 1 to 400, less than twice --horizon
    and at most 5000 times --cell. The cameras stand in it. It is rounded up to an even number of metres: 7 becomes
    8."""
    cell: float = 0.08
    """Grid spacing of that square [m], 0.01 to 1. It is adjusted so that whole cells fill the square: 0.3 in 8 m
    becomes 0.296."""
    horizon: float = 96.0
    """Half the width of the scene [m], 1 to 500. Beyond it there is only sky. It is rounded up to whole metres."""

    def __post_init__(self) -> None:
        for name, (least, most) in SCENE_LIMITS.items():
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} must lie in [{least:g}, {most:g}] m, got {getattr(self, name)}")
        if not self.cell < self.size < 2 * self.horizon:
            raise ValueError(
                f"size must be more than `cell`, {self.cell:g} m, and less than twice `horizon`, {self.horizon:g} m; "
                f"got {self.size}"
            )
        if self.size > MOST_CELLS * self.cell:
            raise ValueError(f"size must be at most {MOST_CELLS} times `cell`, {self.cell:g} m, got {self.size}")


@dataclass(frozen=True, eq=False)
class Scene:
    """A place to render and to drive on. It is plain data that depends on no renderer. Each Scene equals only itself.

    World frame: x east, y north, z up, in metres, with the origin on the ground in the middle of the scene.

    Attributes:
        config: The place that the scene was drawn from.
        terrain: The ground.
        rocks: The rocks.
        look: The light and the surface.
        outcrop: What stands out of the ground besides the rocks.
    """

    config: SceneConfig
    terrain: Terrain
    rocks: Rocks
    look: Look
    outcrop: Outcrop = field(default_factory=Outcrop)

    @cached_property
    def bodies(self) -> Rocks:
        """All that stands out of the ground: the rocks and then the outcrop. Body n has the surface id n + 1."""
        return joined_bodies([self.rocks, self.outcrop.bodies]) if len(self.outcrop) else self.rocks

    @property
    def half(self) -> float:
        """Half the side of the finely gridded square [m]."""
        return self.terrain.fine.bounds[2]

    def with_sun(self, elevation_deg: float, azimuth_deg: float, optical_depth: float | None = None) -> Scene:
        """Return the same place under another sun; ground, rocks and surface stay.

        Args:
            elevation_deg: Height of the sun above the horizon [deg], above 0 and up to 90.
            azimuth_deg: Direction of the sun [deg], counter-clockwise from east.
            optical_depth: Optical depth of the dust in the air, 0 to 12; None keeps it.

        Raises:
            ValueError: A value is out of its range.
        """
        depth = self.look.optical_depth if optical_depth is None else optical_depth
        LookConfig((elevation_deg,) * 2, (azimuth_deg,) * 2, (depth,) * 2)  # checks the ranges
        sun = sun_direction(np.deg2rad(elevation_deg), np.deg2rad(azimuth_deg))
        return replace(self, look=replace(self.look, sun=sun, optical_depth=float(depth)))

    def abundance(self) -> dict[str, list[float]]:
        """Return the share of the ground that rocks of a diameter and more cover, asked for and achieved.

        The achieved share is the area of all outlines above ground, of rocks whose centre lies in the finely gridded
        square, over the area of that square. A single scene scatters about the law. `marssim.abundance` measures it
        with rays over several scenes.

        Returns:
            Lists of equal length: "diameter" [m], "asked" and "achieved" (shares, 0 to 1).
        """
        inside = (np.abs(self.rocks.centre[:, :2]) <= self.half).all(axis=1)
        sizes = self.rocks.diameter[inside]
        covered = [float(np.sum(np.pi / 4 * sizes[sizes >= d] ** 2) / (2 * self.half) ** 2) for d in REPORTED]
        asked = covered_area(np.array(REPORTED), self.config.rocks.k).tolist()
        return {"diameter": list(REPORTED), "asked": asked, "achieved": covered}


def build_scene(
    config: SceneConfig,
    rng: np.random.Generator | int,
    clear: tuple[tuple[float, float, float], ...] = (),
    ditch_across: tuple[float, float, float, float] | None = None,
) -> Scene:
    """Draw a Scene.

    Args:
        config: The place, as `preset("gale")`.
        rng: The seed of the scene, or a random generator. Of a generator, its seed and how often it was spawned decide,
            not the numbers that it has drawn: a scene is made again by a new generator of the same seed.
        clear: Discs (x, y, radius) [m] that stay free of rocks with a diameter of 0.1 m and more, of bedrock, of
            ditches and of fresh craters. A rock or plate counts as the disc of its diameter, so a corner of it may
            reach into a clear disc. Smaller rocks and fragments lie there too.
        ditch_across: x, y of the start and x, y of the end of a way [m] that one ditch more cuts, whatever
            config.relief.ditch_density is; None for no such ditch. All else is drawn as without it.

    Raises:
        ValueError: The heightmap cannot be read or is too small, or the scene would have too many rocks.
    """
    terrain_rng, rock_rng, look_rng = np.random.default_rng(rng).spawn(3)
    terrain = build_terrain(config.relief, config.size, config.cell, config.horizon, terrain_rng, clear, ditch_across)
    half = terrain.fine.bounds[2]
    outcrop_rng = rock_rng.spawn(1)[0]
    traits = draw_traits(config.outcrop, outcrop_rng)
    place = half, config.horizon, terrain.height_at
    slabs, ledges = _plates(config.outcrop, traits, *place, clear, outcrop_rng)
    lift = Tops.from_plates([*ledges, *slabs], half).lift if ledges or slabs else None
    rocks = build_rocks(config.rocks, *place, rock_rng, clear, lift)
    most = MAX_BODIES - len(rocks) - _number([*ledges, *slabs])
    fragments = draw_fragments(rocks, [*ledges, *slabs], traits, half, terrain.height_at, lift, most, outcrop_rng)
    outcrop = build_outcrop(slabs, ledges, fragments, traits, outcrop_rng)
    return Scene(config, terrain, rocks, draw_look(config.look, look_rng), outcrop)


def _plates(
    config: OutcropConfig, traits: Traits, half: float, horizon: float, height_at: Ground,
    clear: tuple[tuple[float, float, float], ...], rng: np.random.Generator,
) -> tuple[list[Plates], list[Plates]]:  # fmt: skip
    """Return the slabs with their beds and chips, and the blocks of ledges, all of them outside of clear discs."""
    ledges = nearest(outside(draw_ledges(config, traits, half, horizon, height_at, rng), clear), MAX_BEDROCK)
    slabs = beside(outside(draw_slabs(traits, half, horizon, height_at, rng), clear), ledges, half, height_at)
    slabs = nearest(slabs, MAX_BEDROCK - _number(ledges))
    slabs += upper_beds(slabs, height_at, clear, MAX_BEDROCK - _number([*ledges, *slabs]), rng)
    most = MAX_PLATES - _number([*ledges, *slabs])
    chips = draw_chips([*slabs, *ledges], traits, half, height_at, most, rng)
    return [*slabs, *beside(outside(chips, clear), ledges, half, height_at)], ledges


def _number(parts: list[Plates]) -> int:
    """Return the number of plates of all parts."""
    return sum(map(len, parts))
