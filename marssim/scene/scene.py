"""A Mars scene as pure data, drawn from a seed: ground, rocks, and the look of sun, air and dust."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from marssim.scene.golombek import REPORTED, covered_area
from marssim.scene.ranges import Range, check_ranges
from marssim.scene.rocks import RockConfig, Rocks, build_rocks
from marssim.scene.terrain import ReliefConfig, Terrain, build_terrain

Place = Literal["utopia", "gusev", "gale", "jezero", "hard"]
PRESETS: tuple[Place, ...] = get_args(Place)

# Rovers reported an optical depth of at most 10.8, in the storm of 2018. Contrast and texture are modelled for 1.
LOOK_LIMITS = {
    "sun_elevation_deg": (0.0, 90.0), "sun_azimuth_deg": (-360.0, 720.0), "optical_depth": (0.0, 12.0),
    "albedo_contrast": (0.0, 3.0), "texture_strength": (0.0, 3.0), "pebbles": (0.0, 1.0), "wind_ripples": (0.0, 1.0),
    "bedding": (0.0, 1.0), "bedrock": (0.0, 1.0), "rock_dust": (0.0, 1.0),
}  # fmt: skip
# [m] At a horizon of 500 m the farthest corner is less than 1000 m away, the largest depth that a dataset can store.
SCENE_LIMITS = {"size": (1.0, 1000.0), "cell": (0.01, 1.0), "horizon": (1.0, 500.0)}
MOST_CELLS = 5000  # along the side of the fine square: its 50 million triangles fill several GB


@dataclass(frozen=True)
class LookConfig:
    """Ranges from which each scene draws its light and surface, LOW HIGH; give a value twice to fix it."""

    sun_elevation_deg: Range = (15.0, 70.0)
    """Height of the sun above the horizon [deg], LOW HIGH, above 0 and up to 90."""
    sun_azimuth_deg: Range = (0.0, 360.0)
    """Direction of the sun [deg], LOW HIGH, counter-clockwise from east: 90 is north."""
    optical_depth: Range = (0.3, 1.0)
    """Optical depth of the dust in the air, LOW HIGH: 0.3 is a clear sky, 1 a hazy one, and 10 a dust storm."""
    albedo_contrast: Range = (0.3, 1.3)
    """Contrast of the ground's pattern of bright and dark patches, LOW HIGH: 0 has none, 1 is typical, 3 the most."""
    texture_strength: Range = (0.35, 1.2)
    """Height of the relief that is finer than the grid, LOW HIGH: 0 has none, 1 is typical, 3 the most."""
    pebbles: Range = (0.2, 1.0)
    """Strength of the pebbles and grains that are too small for the mesh, LOW HIGH: 0 has none, 1 the most."""
    wind_ripples: Range = (0.2, 0.7)
    """Share of the ground that is sand with hand-wide ripples, LOW HIGH, 0 to 1. Pebbles lie on the rest, except on
    bedrock."""
    bedding: Range = (0.0, 0.4)
    """How clearly the faces of rocks show level beds, LOW HIGH: 0 shows none, 1 the most."""
    bedrock: Range = (0.0, 0.2)
    """How much of the ground the wind has swept bare down to plates of bedrock, LOW HIGH, 0 to 1. Bedrock shows on a
    third to four fifths of that share of the ground."""
    rock_dust: Range = (0.1, 0.6)
    """How much dust clings to the sides of the dustiest rocks, LOW HIGH: 0 has none, 1 the most. Dust lies on the tops
    of all rocks."""

    def __post_init__(self) -> None:
        check_ranges(self, LOOK_LIMITS)
        if not self.sun_elevation_deg[0] > 0:
            raise ValueError(f"sun_elevation_deg must be above 0, got {self.sun_elevation_deg[0]}")


@dataclass(frozen=True)
class SceneConfig:
    """A place. With a seed it determines a Scene; see `preset` for the named places."""

    preset: str = "utopia"
    """Name of the place that the defaults come from. It only labels the scene."""
    relief: ReliefConfig = field(default_factory=ReliefConfig)
    """The shape of the ground."""
    rocks: RockConfig = field(default_factory=RockConfig)
    """The rocks on the ground."""
    look: LookConfig = field(default_factory=LookConfig)
    """The light and the surface."""
    size: float = 32.0
    """Side of the finely gridded square in the middle of the scene, where the cameras stand [m]. It is rounded up to an
    even number of metres, so that it ends on lines of the coarse grid: 7 becomes 8."""
    cell: float = 0.08
    """Grid spacing of that square [m]. It is adjusted so that whole cells fill the square: 0.3 in 8 m becomes 0.296."""
    horizon: float = 96.0
    """Half the side of the whole scene [m]; beyond it there is only sky. It is rounded up to whole metres."""

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


@dataclass(frozen=True)
class Look:
    """The light and surface that a scene drew from its LookConfig, which explains the values.

    Attributes:
        sun: (3,) unit vector towards the sun, world frame.
        optical_depth: Optical depth of the dust in the air.
        albedo_contrast: Contrast of the ground's pattern of bright and dark patches.
        texture_strength: Height of the relief that is finer than the grid.
        texture_seed: Seed of the surface's patterns.
        pebbles: Strength of pebbles and grains, 0 to 1.
        wind_ripples: Share of the ground that is rippled sand, 0 to 1.
        bedding: How clearly rocks show level beds, 0 to 1.
        bedrock: How much of the ground is swept bare down to bedrock, 0 to 1.
        rock_dust: How much dust clings to the dustiest rocks, 0 to 1.
    """

    sun: np.ndarray
    optical_depth: float
    albedo_contrast: float
    texture_strength: float
    texture_seed: int
    pebbles: float
    wind_ripples: float
    bedding: float
    bedrock: float
    rock_dust: float

    @property
    def sun_elevation(self) -> float:
        """Height of the sun above the horizon [rad]."""
        return float(np.arcsin(self.sun[2]))


@dataclass(frozen=True)
class Scene:
    """A place to render and to drive on. It is plain data that depends on no renderer.

    World frame: x east, y north, z up, in metres, with the origin on the ground in the middle of the scene.

    Attributes:
        config: The place that the scene was drawn from.
        terrain: The ground.
        rocks: The rocks.
        look: The light and the surface.
    """

    config: SceneConfig
    terrain: Terrain
    rocks: Rocks
    look: Look

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
        sun = _sun_direction(np.deg2rad(elevation_deg), np.deg2rad(azimuth_deg))
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


# The relief of gusev, gale and jezero has the RMS slope over 1 m and the Hurst exponent of Pathfinder and Viking 1,
# which have slopes of 4.8 to 5.4 deg over 1 m, 2.5 to 3.0 over 10 m and 1.2 to 1.7 over 100 m. Utopia is smoother: 98 %
# of its slopes are under 8 deg. Hard is rougher than any of them.
_PRESETS: dict[Place, tuple[RockConfig, ReliefConfig, LookConfig]] = {
    # a dusty plain: few rocks, worn and half buried, broad ripples, old craters
    "utopia": (
        RockConfig(k=0.033, families=(0.3, 0.2, 0.5), buried=(0.2, 0.5)),
        ReliefConfig(
            hurst=0.72, rms_slope_deg=2.8, crater_density=0.005, crater_depth=(0.03, 0.12), ripple_amplitude=0.02,
            ripple_wavelength=1.1, ripple_cover=0.45,
        ),
        LookConfig(
            pebbles=(0.2, 0.9), wind_ripples=(0.2, 0.7), bedding=(0.0, 0.2), bedrock=(0.0, 0.0), rock_dust=(0.2, 0.8),
        ),
    ),
    # a lava plain: dark angular blocks around small craters
    "gusev": (
        RockConfig(k=0.05, families=(0.75, 0.1, 0.15), albedo=0.6, cluster=0.4),
        ReliefConfig(
            hurst=0.74, rms_slope_deg=4.8, crater_density=0.01, ripple_amplitude=0.006, ripple_wavelength=0.5,
            ripple_cover=0.3,
        ),
        LookConfig(
            pebbles=(0.4, 1.0), wind_ripples=(0.1, 0.5), bedding=(0.0, 0.2), bedrock=(0.0, 0.15), rock_dust=(0.1, 0.6),
        ),
    ),
    # a lake bed: pale slabs between sharp ripples
    "gale": (
        RockConfig(k=0.07, families=(0.25, 0.65, 0.1), height_ratio=0.44, albedo=1.25),
        ReliefConfig(
            hurst=0.73, rms_slope_deg=5.1, crater_density=0.002, ripple_amplitude=0.025, ripple_wavelength=0.8,
            ripple_cover=0.55,
        ),
        LookConfig(
            pebbles=(0.2, 0.9), wind_ripples=(0.2, 0.7), bedding=(0.6, 1.0), bedrock=(0.15, 0.6), rock_dust=(0.0, 0.5),
        ),
    ),
    # a delta's foot: cobbles and boulders of every kind, sand in between
    "jezero": (
        RockConfig(k=0.15, families=(0.35, 0.2, 0.45), albedo=0.75),
        ReliefConfig(hurst=0.73, rms_slope_deg=5.2, ripple_amplitude=0.03, ripple_wavelength=1.4, ripple_cover=0.2),
        LookConfig(
            pebbles=(0.5, 1.0), wind_ripples=(0.1, 0.6), bedding=(0.1, 0.8), bedrock=(0.0, 0.4), rock_dust=(0.1, 0.6),
        ),
    ),
    "hard": (
        RockConfig(k=0.20, cluster=0.5, families=(0.6, 0.2, 0.2), albedo=0.65),
        ReliefConfig(
            hurst=0.6, rms_slope_deg=7.0, crater_density=0.008, ripple_amplitude=0.02, ripple_wavelength=0.7,
            ripple_cover=0.15,
        ),
        LookConfig(
            pebbles=(0.3, 1.0), wind_ripples=(0.0, 0.6), bedding=(0.0, 0.6), bedrock=(0.0, 0.3), rock_dust=(0.0, 0.6),
        ),
    ),
}  # fmt: skip


def preset(name: str, **changes: object) -> SceneConfig:
    """Return the SceneConfig of a named place.

    Args:
        name: One of PRESETS.
        **changes: Fields of SceneConfig to replace.

    Raises:
        ValueError: There is no place of that name, or a changed field is out of range.
    """
    if name not in _PRESETS:
        raise ValueError(f"scene preset {name!r} is unknown; choose from {', '.join(PRESETS)}")
    rocks, relief, look = _PRESETS[name]
    return replace(SceneConfig(preset=name, rocks=rocks, relief=relief, look=look), **changes)  # type: ignore[arg-type]


def build_scene(
    config: SceneConfig, rng: np.random.Generator | int, clear: tuple[tuple[float, float, float], ...] = ()
) -> Scene:
    """Draw a Scene.

    Args:
        config: The place, as `preset("gale")`.
        rng: A random generator, or the seed of one. The same seed or state gives the same scene.
        clear: Discs (x, y, radius) [m] that stay free of rocks with a diameter of 0.1 m and more. A rock counts as the
            disc of its diameter, so a corner of it may reach into a clear disc. Smaller rocks lie there too.

    Raises:
        ValueError: The heightmap cannot be read or is too small, or the scene would have too many rocks.
    """
    terrain_rng, rock_rng, look_rng = np.random.default_rng(rng).spawn(3)
    terrain = build_terrain(config.relief, config.size, config.cell, config.horizon, terrain_rng)
    half = terrain.fine.bounds[2]
    rocks = build_rocks(config.rocks, half, config.horizon, terrain.height_at, rock_rng, clear)
    return Scene(config, terrain, rocks, draw_look(config.look, look_rng))


def draw_look(config: LookConfig, rng: np.random.Generator) -> Look:
    """Draw a scene's sun, air and surface from their ranges, uniformly."""
    elevation = np.deg2rad(rng.uniform(*config.sun_elevation_deg))
    azimuth = np.deg2rad(rng.uniform(*config.sun_azimuth_deg))
    return Look(
        sun=_sun_direction(elevation, azimuth),
        optical_depth=float(rng.uniform(*config.optical_depth)),
        albedo_contrast=float(rng.uniform(*config.albedo_contrast)),
        texture_strength=float(rng.uniform(*config.texture_strength)),
        texture_seed=int(rng.integers(2**31)),
        pebbles=float(rng.uniform(*config.pebbles)),
        wind_ripples=float(rng.uniform(*config.wind_ripples)),
        bedding=float(rng.uniform(*config.bedding)),
        bedrock=float(rng.uniform(*config.bedrock)),
        rock_dust=float(rng.uniform(*config.rock_dust)),
    )


def _sun_direction(elevation: float, azimuth: float) -> np.ndarray:
    """Return the (3,) unit vector towards a sun at these angles [rad], world frame."""
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
