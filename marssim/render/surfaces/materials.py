"""The materials of a scene's ground and rocks, as the kernels of albedo.py and shading.py take them.

All is drawn from the scene's texture seed. A few tiles are made once and shared; the seed decides how they lie.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from marssim.render.relief.ground import Ground
from marssim.render.relief.layers import VARIANTS
from marssim.render.relief.plates import VARIANTS as PLATE_VARIANTS
from marssim.render.relief.plates import plates
from marssim.render.relief.pyramid import CHANNELS
from marssim.render.relief.stones.bodies import BARE, GRAVEL, PACKED, TONE
from marssim.scene.ground.noise import Octaves, coded_tile, placing
from marssim.scene.rocks.mesh import Rocks
from marssim.scene.scene import Scene

STAIN_WAVELENGTHS = np.array([0.0045, 0.009, 0.018, 0.038, 1.7, 7.0])  # [m] sizes of grains, spots and patches
STAIN = np.array(
    [0.10, 0.06, 0.035, 0.03, 0.04, 0.06]
)  # amplitude of each, logarithm of brightness, at a contrast of 1
PEBBLE_SOIL = 0.85  # share of the soil in the mean brightness of pebbles, which is else that of the rocks
BED_RED = 0.45  # redness that gives a rock the hue of BED_COLOUR; its brightness is Traits.brightness
BED_STAINS = 0.7  # contrast of their stains over that of rocks
BED_SWEPT = 0.3  # by how much less of the tops of slabs and ledges is under dust
DUST_TONE = 0.25  # logarithm of brightness of the dust on the crests of sand where all ground is rippled
NO_PLATES = np.zeros((1, CHANNELS), dtype=np.int8)  # the look of a scene without bedrock


# A rock's surface. albedo: over that of the ground; red: how much redder than the mean it is, -1 to 1; film: share of
# its sides that is under dust, below 0 where the wind sweeps its top as well; stains: contrast of its stains over that
# of most rocks.
ROCK_FIELDS = ("albedo", "red", "film", "stains")
ROCK = np.dtype([(name, np.float64) for name in ROCK_FIELDS])


class Mix(NamedTuple):
    """Numbers of the ground, float32.

    Attributes:
        contrast: Look.albedo_contrast.
        soil: Look.soil_albedo.
        soil_tone: Tone of the ground between the stones, as logarithm of brightness.
        pebble_tone: Mean tone of the stones, as logarithm of brightness.
        hidden_bare: Share of bare ground that stones cover.
        hidden_gravel: The same of gravel.
        dust_tone: Tone of the dust on the crests of sand, as logarithm of brightness.
    """

    contrast: np.float32
    soil: np.float32
    soil_tone: np.float32
    pebble_tone: np.float32
    hidden_bare: np.float32
    hidden_gravel: np.float32
    dust_tone: np.float32


class Soil(NamedTuple):
    """The surface of the ground between the rocks.

    Attributes:
        mix: Its numbers.
        stains: Bright and dark patches, without slopes.
        tones: (N,) float32 tones of the stones, of unit variance.
        plates: Look of the plates, of `plates`.
        near: Maps of `surroundings`.
        half: Half the side of the square that these cover [m].
    """

    mix: Mix
    stains: Octaves
    tones: np.ndarray
    plates: np.ndarray
    near: np.ndarray
    half: np.float32


class RockSurface(NamedTuple):
    """The surfaces of the rocks.

    Attributes:
        contrast: Look.albedo_contrast.
        of_surface: (N + 1,) of type ROCK, by surface id, of the scene's bodies; zeros for GROUND.
    """

    contrast: float
    of_surface: np.ndarray


def materials(scene: Scene, ground: Ground) -> tuple[Soil, RockSurface]:
    """Return the materials of a scene's ground and rocks. ground: its relief."""
    rng = np.random.default_rng((scene.look.texture_seed, 3))
    return _soil(scene, ground), _rocks(scene, rng)


def _soil(scene: Scene, ground: Ground) -> Soil:
    look, seed = scene.look, scene.look.texture_seed
    lying = 1 - np.prod(1 - PACKED * ground.stones.octave[:, [BARE, GRAVEL]], axis=0)
    mix = Mix(
        contrast=np.float32(look.albedo_contrast),
        soil=np.float32(look.soil_albedo),
        soil_tone=np.float32(np.log(look.soil_albedo)),
        pebble_tone=np.float32(np.log(PEBBLE_SOIL * look.soil_albedo + (1 - PEBBLE_SOIL) * scene.config.rocks.albedo)),
        hidden_bare=np.float32(lying[0]),
        hidden_gravel=np.float32(lying[1]),
        dust_tone=np.float32(DUST_TONE * look.wind_ripples),
    )
    return Soil(
        mix=mix,
        stains=Octaves(
            _noise(seed, 1, slopes=False), placing(tuple(STAIN_WAVELENGTHS), seed + 1),
            _single(STAIN * look.albedo_contrast), _single(np.zeros_like(STAIN)),
        ),
        tones=np.ascontiguousarray(ground.stones.stone[:, TONE]),
        plates=plates(seed % PLATE_VARIANTS)[1] if look.bedrock > 0 else NO_PLATES,
        near=ground.near,
        half=np.float32(scene.half),
    )  # fmt: skip


def _rocks(scene: Scene, rng: np.random.Generator) -> RockSurface:
    rocks = _surfaces(scene, scene.rocks, rng)
    outcrop = _surfaces(scene, scene.outcrop.bodies, rng.spawn(1)[0])
    bedrock = outcrop[: sum(scene.outcrop.count[:2])]
    bedrock["red"] = BED_RED + 0.3 * bedrock["red"]
    bedrock["film"] -= BED_SWEPT
    bedrock["stains"] = BED_STAINS
    ground = np.zeros(1, dtype=ROCK)
    return RockSurface(scene.look.albedo_contrast, np.concatenate([ground, rocks, outcrop]))


def _surfaces(scene: Scene, bodies: Rocks, rng: np.random.Generator) -> np.ndarray:
    """Return the surfaces (N,) of type ROCK of N bodies."""
    look, count = scene.look, len(bodies)
    out = np.zeros(count, dtype=ROCK)
    out["albedo"], out["stains"] = bodies.albedo, 1.0
    out["red"] = np.clip(rng.normal(0, 0.6, count), -1, 1) * min(look.albedo_contrast, 1.0)
    out["film"] = look.rock_dust * rng.uniform(0, 1, count)
    return out


def _noise(seed: int, layer: int, slopes: bool = True) -> np.ndarray:
    """Return the tile of noise of a layer; a scene's seed chooses among VARIANTS of each layer."""
    return coded_tile(VARIANTS * layer + seed % VARIANTS, slopes)


def _single(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32)
