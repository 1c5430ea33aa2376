"""The look of a scene: its sun, the dust in its air, and the surface of ground and rocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.scene.ranges import Range, check_ranges

# [rad] half the angle under which the sun is seen: its radius of 695,700 km (IAU 2015, resolution B3) at Mars's mean
# distance of 1.5237 au. Over a Martian year it is 2.8 to 3.4 mrad.
SUN_RADIUS = 3.052e-3
# Rovers reported an optical depth of at most 10.8, in the storm of 2018. Contrast and texture are modelled for 1.
LOOK_LIMITS = {
    "sun_elevation_deg": (0.0, 90.0), "sun_azimuth_deg": (-360.0, 720.0), "optical_depth": (0.0, 12.0),
    "albedo_contrast": (0.0, 3.0), "texture_strength": (0.0, 3.0), "pebbles": (0.0, 1.0), "wind_ripples": (0.0, 1.0),
    "bedding": (0.0, 1.0), "bedrock": (0.0, 1.0), "rock_dust": (0.0, 1.0), "gravel": (0.0, 1.0),
    "gravel_size": (0.005, 0.08), "gravel_sorting": (0.0, 1.0), "drifts": (0.0, 1.0), "soil_albedo": (0.3, 1.3),
}  # fmt: skip


@dataclass(frozen=True)
class LookConfig:
    """Ranges from which each scene draws its light and surface, LOW HIGH; give a value twice to fix it."""

    sun_elevation_deg: Range = (15.0, 70.0)
    """Height of the sun above the horizon [deg], LOW HIGH, above 0 and up to 90."""
    sun_azimuth_deg: Range = (0.0, 360.0)
    """Direction of the sun [deg], LOW HIGH, -360 to 720, counter-clockwise from east: 90 is north."""
    optical_depth: Range = (0.3, 1.0)
    """Optical depth of the dust in the air, LOW HIGH, 0 to 12: 0.3 is a clear sky, 1 a hazy one, and 3 or more a dust
    storm."""
    albedo_contrast: Range = (0.3, 1.3)
    """Contrast of the ground's pattern of bright and dark patches, LOW HIGH: 0 has none, 1 is typical, 3 the most."""
    texture_strength: Range = (0.35, 1.2)
    """Height of the relief that is finer than the mesh (texture, which stereo matches), LOW HIGH: 0 has none, 1 is
    typical, 3 the most. Sand ripples grow with it up to 1.3. Stones, plates of bedrock and drifts do not follow it."""
    pebbles: Range = (0.2, 1.0)
    """Number of the single pebbles of 0.5 to 8 cm on ground without sand, LOW HIGH: 0 has none, 1 the most."""
    wind_ripples: Range = (0.2, 0.7)
    """Share of the ground without gravel that is sand with hand-wide ripples, LOW HIGH, 0 to 1. Pebbles lie on the
    rest, except on bedrock."""
    bedding: Range = (0.0, 0.4)
    """How clearly the faces of rocks show level beds, LOW HIGH: 0 shows none, 1 the most."""
    bedrock: Range = (0.0, 0.2)
    """How far the wind has swept the ground, LOW HIGH, 0 to 1: 0 shows no bedrock, 0.01 plates of it on some 6 % of the
    ground, 0.2 on 15 %, 0.5 on 40 %, 1 on 80 %."""
    rock_dust: Range = (0.1, 0.6)
    """How much dust clings to the sides of the dustiest rocks, LOW HIGH: 0 has none, 1 the most. Dust lies on the tops
    of all rocks."""
    gravel: Range = (0.0, 0.15)
    """Share of the ground where stones of 0.5 to 8 cm lie close together, LOW HIGH, 0 to 1: patches of it, or all of
    it."""
    gravel_size: Range = (0.012, 0.04)
    """Diameter of the stones that cover most of the gravel [m], to a factor of two, LOW HIGH, 0.005 to 0.08. Smaller
    ones are more numerous."""
    gravel_sorting: Range = (0.0, 0.7)
    """How alike the stones of gravel are, LOW HIGH: 0 mixes all sizes, 1 has hardly any but those of
    gravel_size."""
    drifts: Range = (0.3, 0.9)
    """How much sand lies against rocks and slabs, LOW HIGH: 0 has none, 1 the most. Mounds at their feet are up to 10
    cm high, and tails in the lee of rocks up to 14. Images and depth have it; the ground that a rover drives on does
    not, except that the wheels' grip depends on it in drives with --slip scene."""
    soil_albedo: Range = (0.7, 1.0)
    """Brightness of sand and soil, LOW HIGH, 0.3 to 1.3: 1 is bright dust, 0.5 the dark basaltic sand between pale
    slabs. The brightness of rocks does not follow it."""

    def __post_init__(self) -> None:
        check_ranges(self, LOOK_LIMITS)
        if not self.sun_elevation_deg[0] > 0:
            raise ValueError(f"sun_elevation_deg must be above 0, got {self.sun_elevation_deg[0]}")


@dataclass(frozen=True)
class Look:
    """The light and surface that a scene drew from its LookConfig, which explains the values.

    Attributes:
        sun: (3,) unit vector towards the sun, world frame.
        optical_depth: Optical depth of the dust in the air.
        albedo_contrast: Contrast of the ground's pattern of bright and dark patches.
        texture_strength: Height of the relief that is finer than the mesh.
        texture_seed: Seed of the surface's patterns.
        pebbles: Number of the single pebbles of 0.5 to 8 cm on ground without sand, 0 to 1.
        wind_ripples: Share of the ground that is rippled sand, 0 to 1.
        bedding: How clearly rocks show level beds, 0 to 1.
        bedrock: How much of the ground is swept bare down to bedrock, 0 to 1.
        rock_dust: How much dust clings to the dustiest rocks, 0 to 1.
        gravel: Share of the ground that is gravel, 0 to 1.
        gravel_size: Diameter of the stones that cover most of the gravel [m].
        gravel_sorting: How alike the stones of gravel are, 0 to 1.
        drifts: How much sand lies against rocks and slabs, 0 to 1.
        soil_albedo: Brightness of sand and soil over that of bright dust.
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
    gravel: float = 0.0
    gravel_size: float = 0.02
    gravel_sorting: float = 0.5
    drifts: float = 0.0
    soil_albedo: float = 1.0

    @property
    def sun_elevation(self) -> float:
        """Height of the sun above the horizon [rad]."""
        return float(np.arcsin(self.sun[2]))


def draw_look(config: LookConfig, rng: np.random.Generator) -> Look:
    """Draw a scene's sun, air and surface, each uniformly from its range; the size of gravel in its logarithm.

    Args:
        config: The ranges.
        rng: Random generator.
    """
    elevation = np.deg2rad(rng.uniform(*config.sun_elevation_deg))
    azimuth = np.deg2rad(rng.uniform(*config.sun_azimuth_deg))
    return Look(
        sun=sun_direction(elevation, azimuth),
        optical_depth=float(rng.uniform(*config.optical_depth)),
        albedo_contrast=float(rng.uniform(*config.albedo_contrast)),
        texture_strength=float(rng.uniform(*config.texture_strength)),
        texture_seed=int(rng.integers(2**31)),
        pebbles=float(rng.uniform(*config.pebbles)),
        wind_ripples=float(rng.uniform(*config.wind_ripples)),
        bedding=float(rng.uniform(*config.bedding)),
        bedrock=float(rng.uniform(*config.bedrock)),
        rock_dust=float(rng.uniform(*config.rock_dust)),
        gravel=float(rng.uniform(*config.gravel)),
        gravel_size=float(np.exp(rng.uniform(*np.log(config.gravel_size)))),
        gravel_sorting=float(rng.uniform(*config.gravel_sorting)),
        drifts=float(rng.uniform(*config.drifts)),
        soil_albedo=float(rng.uniform(*config.soil_albedo)),
    )


def sun_direction(elevation: float, azimuth: float) -> np.ndarray:
    """Return the direction of the sun.

    Args:
        elevation: Height of the sun above the horizon [rad].
        azimuth: Direction of the sun [rad], counter-clockwise from east.

    Returns:
        (3,) unit vector towards the sun, world frame.
    """
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
