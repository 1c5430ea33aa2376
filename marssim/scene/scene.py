"""A Mars scene as pure data from a seed: ground, rocks, and how sun, air and dust look."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from marssim.scene.rocks import RockConfig, Rocks, build_rocks
from marssim.scene.terrain import ReliefConfig, Terrain, build_terrain

Range = tuple[float, float]


@dataclass(frozen=True)
class LookConfig:
    """Ranges from which each scene draws its light and surface; (low, high), equal for a fixed value."""

    sun_elevation_deg: Range = (15.0, 70.0)
    sun_azimuth_deg: Range = (0.0, 360.0)
    optical_depth: Range = (0.3, 1.0)  # of the dust in the air
    albedo_contrast: Range = (0.3, 1.3)  # of the ground's brightness pattern
    texture_strength: Range = (0.35, 1.2)  # of relief too fine for the grid

    def __post_init__(self) -> None:
        for name, (low, high) in vars(self).items():
            if not low <= high:
                raise ValueError(f"{name} must be a range low, high, got {low}, {high}")
        if not 0 < self.sun_elevation_deg[0] <= self.sun_elevation_deg[1] <= 90:
            raise ValueError(f"sun_elevation_deg must lie in (0, 90], got {self.sun_elevation_deg}")


@dataclass(frozen=True)
class SceneConfig:
    """Everything that, with a seed, makes a Scene."""

    preset: str = "utopia"  # where the defaults come from; a name only
    relief: ReliefConfig = field(default_factory=ReliefConfig)
    rocks: RockConfig = field(default_factory=RockConfig)
    look: LookConfig = field(default_factory=LookConfig)
    size: float = 32.0  # [m] side of the finely gridded square around the origin
    cell: float = 0.08  # [m] grid of that square
    horizon: float = 96.0  # [m] half the side of everything


@dataclass(frozen=True)
class Look:
    """The light and surface that a scene drew. sun: (3,) unit vector towards the sun, world frame."""

    sun: np.ndarray
    optical_depth: float
    albedo_contrast: float
    texture_strength: float
    texture_seed: int

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


_PRESETS: dict[str, tuple[RockConfig, ReliefConfig]] = {
    "utopia": (RockConfig(k=0.033), ReliefConfig(rms_slope_deg=3.5, ripple_cover=0.45)),
    "gusev": (RockConfig(k=0.05), ReliefConfig(rms_slope_deg=4.5, ripple_cover=0.3)),
    "gale": (RockConfig(k=0.07), ReliefConfig(rms_slope_deg=5.0, ripple_cover=0.35, ripple_amplitude=0.02)),
    "jezero": (RockConfig(k=0.15), ReliefConfig(rms_slope_deg=5.5, ripple_cover=0.2)),
    "hard": (
        RockConfig(k=0.20, cluster=0.5),
        ReliefConfig(rms_slope_deg=7.0, hurst=0.6, crater_density=0.008, ripple_cover=0.2),
    ),
}
PRESETS = tuple(_PRESETS)


def preset(name: str, **changes: object) -> SceneConfig:
    """The SceneConfig of a named place; keyword arguments replace fields. Raises ValueError for an unknown name."""
    if name not in _PRESETS:
        raise ValueError(f"scene preset {name!r} is unknown; choose from {', '.join(PRESETS)}")
    rocks, relief = _PRESETS[name]
    return replace(SceneConfig(preset=name, rocks=rocks, relief=relief), **changes)  # type: ignore[arg-type]


def build_scene(
    config: SceneConfig, rng: np.random.Generator, clear: tuple[tuple[float, float, float], ...] = ()
) -> Scene:
    """Draw a Scene. The same rng state gives the same Scene.

    clear: discs (x, y, radius) [m] that stay free of rocks of 0.1 m and more; pebbles lie there too.
    """
    terrain_rng, rock_rng, look_rng = rng.spawn(3)
    terrain = build_terrain(config.relief, config.size, config.cell, config.horizon, terrain_rng)
    half = terrain.fine.bounds[2]
    rocks = build_rocks(config.rocks, half, config.horizon, terrain.height_at, rock_rng, clear)
    return Scene(config, terrain, rocks, draw_look(config.look, look_rng))


def draw_look(config: LookConfig, rng: np.random.Generator) -> Look:
    """Draw sun, air and surface from their ranges."""
    elevation = np.deg2rad(rng.uniform(*config.sun_elevation_deg))
    azimuth = np.deg2rad(rng.uniform(*config.sun_azimuth_deg))
    sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    return Look(
        sun=sun,
        optical_depth=float(rng.uniform(*config.optical_depth)),
        albedo_contrast=float(rng.uniform(*config.albedo_contrast)),
        texture_strength=float(rng.uniform(*config.texture_strength)),
        texture_seed=int(rng.integers(2**31)),
    )
