"""The materials of a scene's ground and rocks, as the kernels of albedo.py and shading.py take them.

All is drawn from the scene's texture seed. A few tiles are made once and shared; the seed decides how they lie.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from marssim.render.surfaces.grain import Octaves, coded_tile, placing
from marssim.render.surfaces.pavement import SIDE, plates
from marssim.render.surfaces.pavement import VARIANTS as PLATE_VARIANTS
from marssim.render.surfaces.pyramid import CHANNELS, CODES, PlacedTile
from marssim.render.surfaces.regolith import TONES, VARIANTS, grit, ripple_tile
from marssim.render.surfaces.surroundings import surroundings
from marssim.scene.rocks.mesh import Rocks, ground_plane
from marssim.scene.scene import Scene

RELIEF_WAVELENGTHS = 0.035 * 2.0 ** np.arange(4)  # [m] octaves between the tile of pebbles and the ground's grid
RELIEF_SLOPE = 0.085  # RMS slope of an octave of 5 cm at a texture strength of 1; longer octaves have less
STAIN_WAVELENGTHS = np.array([0.4, 1.7, 7.0])  # [m] sizes of bright and dark patches
STAIN = np.array([0.07, 0.07, 0.08])  # amplitude of each, as logarithm of brightness, at an albedo contrast of 1
RIPPLE_WAVELENGTHS = (0.06, 0.15)  # [m] shortest and longest of the wind's small ripples
RIPPLE_SLOPE = 0.22  # RMS slope of ripples at a texture strength of 1
PEBBLE_OFFSET = 1000.0  # [texels] largest offset of the tile of pebbles, nearly its side
DARKER_PEBBLES = 0.9  # mean brightness of pebbles over that of the rocks
ROCK_WAVELENGTHS = np.array([0.009, 0.02, 0.05, 0.14])  # [m] octaves of a rock's surface
ROCK_STAIN = np.array([0.15, 0.12, 0.10, 0.12])  # amplitude of each, as logarithm of brightness
ROCK_SLOPE = 0.10  # RMS slope of an octave of 10 cm at a texture strength of 1
FAR_DENSE = 0.2  # rock abundance at which the painted stones are as dense as in their tile
FILLET = (0.03, 0.2)  # least and largest height of the sand against a rock, over the rock's height
HIGHEST_FILLET = 0.06  # [m] largest height of that sand
BED_RED = 0.45  # redness that gives a rock the hue of BED_COLOUR; its brightness is pavement.ALBEDO
BED_ABOVE = 0.02  # [m] how far that sand lies below the plane of the ground, for ripples have troughs
BED_STAINS = 0.35  # contrast of their stains over that of rocks
BED_FILLET = 0.3  # height of the sand against slabs and ledges over that against rocks
BED_SWEPT = 0.3  # by how much less of the tops of slabs and ledges is under dust
NO_PLATES = np.zeros((1, CHANNELS), dtype=np.int8)  # tile of a scene without bedrock


# A rock's surface. base, east, north: plane z = base + east x + north y of the ground under it [m]; fillet: height of
# the sand against it [m]; beds: how clearly its faces show beds, 0 to 1; albedo: over that of the ground; red: how much
# redder than the mean it is, -1 to 1; film: share of its sides that is under dust, below 0 where
# the wind sweeps its top as well; stains: contrast of its stains over that of most rocks.
ROCK_FIELDS = ("base", "east", "north", "fillet", "beds", "albedo", "red", "film", "stains")
ROCK = np.dtype([(name, np.float64) for name in ROCK_FIELDS])


class Mix(NamedTuple):
    """Numbers of the ground, float32 except for contrast.

    Attributes:
        contrast: Look.albedo_contrast.
        strength: Look.texture_strength.
        gravel: Look.pebbles.
        sand: Look.wind_ripples.
        swept: Look.bedrock.
        pebble_tone: Mean tone of the tile of pebbles.
        pebble_shade: Mean shade of that tile.
        far_stones: Strength, 0 to 1, of the painted stones that replace rocks which the mesh leaves out.
        half: Half the side of the square in which the mesh leaves no such rock out [m].
    """

    contrast: float
    strength: np.float32
    gravel: np.float32
    sand: np.float32
    swept: np.float32
    pebble_tone: np.float32
    pebble_shade: np.float32
    far_stones: np.float32
    half: np.float32


class Ground(NamedTuple):
    """The ground between the rocks.

    Attributes:
        mix: Its numbers.
        relief: Relief that is finer than the mesh and coarser than pebbles.
        stains: Bright and dark patches, without slopes.
        ripples: The wind's small ripples on sand, one octave.
        pebbles: Tile of `grit`.
        bedrock: Tile of `plates`.
        near: Maps of `surroundings`.
    """

    mix: Mix
    relief: Octaves
    stains: Octaves
    ripples: Octaves
    pebbles: PlacedTile
    bedrock: PlacedTile
    near: np.ndarray


class RockSurface(NamedTuple):
    """The surfaces of the rocks.

    Attributes:
        contrast: Look.albedo_contrast.
        noise: Relief and stains in one.
        of_surface: (N + 1,) of type ROCK, by surface id, of the scene's bodies; zeros for GROUND.
    """

    contrast: float
    noise: Octaves
    of_surface: np.ndarray


def materials(scene: Scene) -> tuple[Ground, RockSurface]:
    """Return the materials of a scene's ground and rocks."""
    rng = np.random.default_rng((scene.look.texture_seed, 3))
    return _ground(scene, rng), _rocks(scene, rng)


def _ground(scene: Scene, rng: np.random.Generator) -> Ground:
    look, seed = scene.look, scene.look.texture_seed
    turn, offset = rng.uniform(0, 2 * np.pi), rng.uniform(0, PEBBLE_OFFSET)
    wavelength = float(np.exp(rng.uniform(*np.log(RIPPLE_WAVELENGTHS))))
    codes = grit(seed, turn, look.sun, float(np.log(DARKER_PEBBLES * scene.config.rocks.albedo)))
    ripples = placing((wavelength,), seed + 3)
    _, cosine, sine = (float(value) for value in ripples[0, :3])
    relief = _single(RELIEF_SLOPE * look.texture_strength * (RELIEF_WAVELENGTHS / 0.05) ** -0.35)
    mix = Mix(
        contrast=look.albedo_contrast,
        strength=np.float32(look.texture_strength),
        gravel=np.float32(look.pebbles),
        sand=np.float32(look.wind_ripples),
        swept=np.float32(look.bedrock),
        pebble_tone=np.float32(codes[-1, 2] * TONES / CODES),
        pebble_shade=np.float32(codes[-1, 3] / CODES),
        far_stones=np.float32(min(scene.config.rocks.k / FAR_DENSE, 1.0) * min(look.albedo_contrast, 1.0)),
        half=np.float32(scene.half),
    )
    steep = np.full(1, np.float32(RIPPLE_SLOPE) * mix.strength)
    return Ground(
        mix=mix,
        relief=Octaves(_noise(seed, 0), placing(tuple(RELIEF_WAVELENGTHS), seed), relief, relief),
        stains=Octaves(
            _noise(seed, 1, slopes=False), placing(tuple(STAIN_WAVELENGTHS), seed + 1),
            _single(STAIN * look.albedo_contrast), _single(np.zeros_like(STAIN)),
        ),
        ripples=Octaves(ripple_tile(seed % VARIANTS), ripples, np.ones_like(steep), steep),
        pebbles=_placed(codes, turn, offset),
        bedrock=_bedrock(scene),
        # the wind blows across the crests of ripples
        near=surroundings(scene.rocks, scene.half, (cosine, -sine), scene.outcrop.bodies),
    )  # fmt: skip


def _bedrock(scene: Scene) -> PlacedTile:
    seed = scene.look.texture_seed
    rng = np.random.default_rng((seed, 4))
    turn, offset = rng.uniform(0, 2 * np.pi), rng.uniform(0, SIDE)
    return _placed(plates(seed % PLATE_VARIANTS) if scene.look.bedrock > 0 else NO_PLATES, turn, offset)


def _rocks(scene: Scene, rng: np.random.Generator) -> RockSurface:
    look, seed = scene.look, scene.look.texture_seed
    rocks = _surfaces(scene, scene.rocks, rng)
    outcrop = _surfaces(scene, scene.outcrop.bodies, rng.spawn(1)[0])
    bedrock = outcrop[: sum(scene.outcrop.count[:2])]
    bedrock["red"] = BED_RED + 0.3 * bedrock["red"]
    bedrock["film"] -= BED_SWEPT
    bedrock["fillet"] *= BED_FILLET
    bedrock["base"] -= BED_ABOVE
    bedrock["stains"] = BED_STAINS
    ground = np.zeros(1, dtype=ROCK)
    places = placing(tuple(ROCK_WAVELENGTHS), seed + 2)
    slope = _single(ROCK_SLOPE * look.texture_strength * (ROCK_WAVELENGTHS / 0.1) ** -0.25)
    noise = Octaves(_noise(seed, 2), places, _single(ROCK_STAIN), slope)
    return RockSurface(look.albedo_contrast, noise, np.concatenate([ground, rocks, outcrop]))


def _surfaces(scene: Scene, bodies: Rocks, rng: np.random.Generator) -> np.ndarray:
    """Return the surfaces (N,) of type ROCK of N bodies."""
    look, count = scene.look, len(bodies)
    x, y = bodies.centre[:, 0], bodies.centre[:, 1]
    z, slope = ground_plane(bodies.centre[:, :2], bodies.diameter, scene.terrain.height_at)
    b, c = slope.T
    out = np.zeros(count, dtype=ROCK)
    out["base"], out["east"], out["north"] = z - b * x - c * y, b, c
    out["fillet"] = np.minimum(bodies.height * rng.uniform(*FILLET, count), HIGHEST_FILLET)
    out["beds"] = look.bedding * rng.uniform(0.4, 1, count)
    out["albedo"], out["stains"] = bodies.albedo, 1.0
    out["red"] = np.clip(rng.normal(0, 0.6, count), -1, 1) * min(look.albedo_contrast, 1.0)
    out["film"] = look.rock_dust * rng.uniform(0, 1, count)
    return out


def _noise(seed: int, layer: int, slopes: bool = True) -> np.ndarray:
    """Return the tile of noise of a layer; a scene's seed chooses among VARIANTS of each layer."""
    return coded_tile(VARIANTS * layer + seed % VARIANTS, slopes)


def _placed(codes: np.ndarray, turn: float, offset: float) -> PlacedTile:
    return PlacedTile(codes, np.float32(np.cos(turn)), np.float32(np.sin(turn)), np.float32(offset))


def _single(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32)
