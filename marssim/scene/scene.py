"""A Mars scene as pure data from a seed: ground, rocks, and how sun, air and dust look."""

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

# an optical depth of 10.8, in the storm of 2018, is the most that a rover reported; contrast and texture are made for 1
LOOK_LIMITS = {
    "sun_elevation_deg": (0.0, 90.0), "sun_azimuth_deg": (-360.0, 720.0), "optical_depth": (0.0, 12.0),
    "albedo_contrast": (0.0, 3.0), "texture_strength": (0.0, 3.0), "pebbles": (0.0, 1.0), "wind_ripples": (0.0, 1.0),
    "bedding": (0.0, 1.0), "bedrock": (0.0, 1.0), "rock_dust": (0.0, 1.0),
}  # fmt: skip
# at 500 m the farthest corner is less than 1000 m away, where the code of depth in datasets ends
SCENE_LIMITS = {"size": (1.0, 1000.0), "cell": (0.01, 1.0), "horizon": (1.0, 500.0)}  # [m]
MOST_CELLS = 5000  # along the side of the fine square: two triangles a cell, 50 million, fill several GB


@dataclass(frozen=True)
class LookConfig:
    """Ranges from which each scene draws its light and surface; (low, high), equal for a fixed value."""

    sun_elevation_deg: Range = (15.0, 70.0)
    """height of the sun above the horizon [deg]"""
    sun_azimuth_deg: Range = (0.0, 360.0)
    """direction of the sun [deg], counter-clockwise from east"""
    optical_depth: Range = (0.3, 1.0)
    """optical depth of the dust in the air: .3 is clear, 1 is hazy"""
    albedo_contrast: Range = (0.3, 1.3)
    """contrast of the ground's brightness pattern, 0 for none"""
    texture_strength: Range = (0.35, 1.2)
    """height of relief that is too fine for the grid, 0 for none"""
    pebbles: Range = (0.2, 1.0)
    """strength of pebbles and grain too small for the mesh, 0 for none to 1"""
    wind_ripples: Range = (0.2, 0.7)
    """share of the ground that is sand with hand-wide ripples, 0 to 1; pebbles lie on the rest, but for bedrock"""
    bedding: Range = (0.0, 0.4)
    """how much the faces of rocks show of level beds, 0 for none to 1"""
    bedrock: Range = (0.0, 0.2)
    """how much of the ground is swept bare of sand down to plates of bedrock, 0 to 1: a third to four fifths of that
    share of the ground shows some"""
    rock_dust: Range = (0.1, 0.6)
    """how much dust clings to the sides of the dustiest rocks, 0 to 1; it lies on the tops of all"""

    def __post_init__(self) -> None:
        check_ranges(self, LOOK_LIMITS)
        if not self.sun_elevation_deg[0] > 0:
            raise ValueError(f"sun_elevation_deg must be above 0, got {self.sun_elevation_deg[0]}")


@dataclass(frozen=True)
class SceneConfig:
    """Everything that, with a seed, makes a Scene."""

    preset: str = "utopia"
    """where the defaults come from; a name only"""
    relief: ReliefConfig = field(default_factory=ReliefConfig)
    rocks: RockConfig = field(default_factory=RockConfig)
    look: LookConfig = field(default_factory=LookConfig)
    size: float = 32.0
    """side of the finely gridded square around the middle, where cameras stand [m]; made an even number of metres, the
    next one up, so that it ends on lines of the coarse grid: 7 makes 8"""
    cell: float = 0.08
    """grid of that square [m]; fitted so that whole cells fill it: 0.3 in 8 m makes 0.296"""
    horizon: float = 96.0
    """half the side of all that is there [m]; made whole metres, the next one up"""

    def __post_init__(self) -> None:
        for name, (least, most) in SCENE_LIMITS.items():
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} must lie within {least:g} and {most:g} m, got {getattr(self, name)}")
        if not self.cell < self.size < 2 * self.horizon:
            raise ValueError(
                f"size must be more than `cell`, {self.cell:g} m, and less than twice `horizon`, {self.horizon:g} m; "
                f"got {self.size}"
            )
        if self.size > MOST_CELLS * self.cell:
            raise ValueError(f"size must be at most {MOST_CELLS} times `cell`, {self.cell:g} m, got {self.size}")


@dataclass(frozen=True)
class Look:
    """The light and surface that a scene drew. sun: (3,) unit vector towards the sun, world frame."""

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
        """[rad]"""
        return float(np.arcsin(self.sun[2]))


@dataclass(frozen=True)
class Scene:
    """A world to be rendered and driven on; nothing in it depends on a renderer."""

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
        """Share of the ground that rocks of `diameter` [m] and more cover: what was `asked`, what was `achieved`.

        Achieved is the sum of the outlines above ground over the finely gridded square, of rocks whose middle lies in
        it. A single scene scatters about the law; marssim.abundance measures it with rays over several.
        """
        inside = (np.abs(self.rocks.centre[:, :2]) <= self.half).all(axis=1)
        sizes = self.rocks.diameter[inside]
        covered = [float(np.sum(np.pi / 4 * sizes[sizes >= d] ** 2) / (2 * self.half) ** 2) for d in REPORTED]
        asked = covered_area(np.array(REPORTED), self.config.rocks.k).tolist()
        return {"diameter": list(REPORTED), "asked": asked, "achieved": covered}


# relief of gusev, gale and jezero: RMS slope over 1 m and Hurst exponent as at Pathfinder and Viking 1, which have 4.8
# to 5.4 deg over 1 m, 2.5 to 3.0 over 10 m and 1.2 to 1.7 over 100 m; utopia is smoother, with 98 % of its slopes under
# 8 deg; hard is rougher than any
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
    """The SceneConfig of a named place; keyword arguments replace fields. Raises ValueError for an unknown name."""
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
    """Draw sun, air and surface from their ranges."""
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
