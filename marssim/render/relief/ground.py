"""The relief of a scene's ground, as the kernels of crossing.py take it. All of it follows from the scene."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from marssim.render.relief import plates as bedrock_plates
from marssim.render.relief.bspline import cubic_coefficients
from marssim.render.relief.height import Base, Cover, Relief
from marssim.render.relief.layers import (
    FRACTAL,
    FRACTAL_WAVES,
    GRAIN,
    GRAIN_WAVES,
    VARIANTS,
    fractal_levels,
    ripple_tile,
)  # fmt: skip
from marssim.render.relief.stones.bodies import (
    BARE,
    CELLS,
    EAST,
    GRAVEL,
    NORTH,
    SIDE,
    SIZES,
    Stones,
    draw_stones,
    placed_stones,
)  # fmt: skip
from marssim.render.relief.surroundings import CELL as NEAR_CELL
from marssim.render.relief.surroundings import CODE, surroundings
from marssim.render.relief.terrain_spline import FineSpline
from marssim.render.relief.tiles import Tile, tile_levels
from marssim.scene.ground.cover import CELL as COVER_CELL
from marssim.scene.ground.cover import ground_cover
from marssim.scene.ground.drifts import DRIFT_CELL, drifts_of
from marssim.scene.ground.noise import TEXELS, TILE
from marssim.scene.look import Look
from marssim.scene.scene import Scene

DRIFT_SLOPE = 0.15  # what drifts add to the slope that few places exceed
RIPPLE_WAVELENGTHS = (0.06, 0.15)  # [m] shortest and longest of the wind's small ripples
RIPPLE_SLOPE = (0.03, 0.11)  # RMS slope of ripples at a texture strength of 1: range over scenes
GRAIN_STRENGTH = 0.8  # of the grain, over that of the relief with longer waves
PLATE_LEVELS = 7  # levels of detail of the plates of bedrock
PEBBLES = (0.2, 0.14, 0.09, 0.035)  # shares of the close packing that pebbles have on ground without sand
FRAGMENTS = 0.5  # share of close packing at the feet of rocks


class Ground(NamedTuple):
    """The relief of a scene's ground.

    Attributes:
        data: float32, all that the height field is made of.
        relief: Its height field.
        stones: The stones on it.
        steepest: Slope of the fine relief that few places exceed.
        near: Maps of `surroundings`.
        drifts: (N, N) float32 heights of the sand against rocks and slabs [m], on the nodes of `relief.base.fine`
            without the margin; empty where there is none.
    """

    data: np.ndarray
    relief: Relief
    stones: Stones
    steepest: np.float32
    near: np.ndarray
    drifts: np.ndarray


_of_scene: WeakKeyDictionary[Scene, Ground] = WeakKeyDictionary()


def ground_relief(scene: Scene) -> Ground:
    """Return the relief of a scene's ground, made at the first call for this scene."""
    if scene not in _of_scene:
        _of_scene[scene] = _made(scene)
    return _of_scene[scene]


def _made(scene: Scene) -> Ground:
    look, seed = scene.look, scene.look.texture_seed
    rng = np.random.default_rng((seed, 5))
    wavelength = float(np.exp(rng.uniform(*np.log(RIPPLE_WAVELENGTHS))))
    data = _Data()
    ripples, steep = _ripples(data, seed, wavelength, rng)
    near = surroundings(scene.rocks, scene.half, scene.outcrop.bodies)
    fine, drifts = _with_drifts(scene)
    strength, bedrock = look.texture_strength, look.bedrock > 0
    grain = fractal_levels(seed % VARIANTS + VARIANTS, *GRAIN, GRAIN_WAVES)
    relief = Relief(
        base=_base(data, scene, fine), cover=_cover(data, scene, near),
        fractal=_placed(data, fractal_levels(seed % VARIANTS, *FRACTAL, FRACTAL_WAVES), FRACTAL, rng),
        grain=_placed(data, np.float32(GRAIN_STRENGTH) * grain, GRAIN, rng),
        ripples=ripples, plates=_plates(data, seed, bedrock, rng), strength=np.float32(strength),
        ripple_height=np.float32(rng.uniform(*RIPPLE_SLOPE) * min(strength, 1.3) / steep),
        ripple_length=np.float32(wavelength), bedrock=bedrock,
    )  # fmt: skip
    steepest = np.float32(0.1 + 0.2 * strength + (DRIFT_SLOPE if drifts.size else 0))
    return Ground(data.joined(), relief, _stones(look, rng), steepest, near, drifts)


def _stones(look: Look, rng: np.random.Generator) -> Stones:
    stones = draw_stones(look.texture_seed % VARIANTS)
    octave = stones.octave.copy()
    octave[:, [EAST, NORTH]] = rng.uniform(0, 1, (len(octave), 2)) * CELLS * octave[:, [SIDE]]
    middle = np.sqrt(np.array(SIZES[:-1]) * np.array(SIZES[1:]))
    spread = 2.0 - 1.5 * look.gravel_sorting  # octaves
    octave[:, BARE] = look.pebbles * np.array(PEBBLES)
    octave[:, GRAVEL] = np.exp(-0.5 * (np.log2(middle / look.gravel_size) / spread) ** 2)
    return placed_stones(stones, octave)


def _with_drifts(scene: Scene) -> tuple[FineSpline, np.ndarray]:
    """Return the surface of the fine square with its drifts, and Ground.drifts."""
    plain, drifts = FineSpline.from_terrain(scene.terrain), drifts_of(scene).heights
    if not drifts.any():
        return plain, np.zeros((0, 0), dtype=np.float32)
    return plain.refined(DRIFT_CELL).raised(drifts), drifts


class _Data:
    """Arrays that are joined to one, since kernels are slower with many."""

    def __init__(self) -> None:
        self._parts: list[np.ndarray] = []
        self._size = 0

    def add(self, part: np.ndarray) -> np.int32:
        """Add an array and return where it begins."""
        self._parts.append(part.ravel().astype(np.float32, copy=False))
        self._size += part.size
        return np.int32(self._size - part.size)

    def joined(self) -> np.ndarray:
        return np.concatenate(self._parts)


def _base(data: _Data, scene: Scene, fine: FineSpline) -> Base:
    coarse = scene.terrain.coarse
    return Base(
        data.add(fine.coefficients), np.int32(fine.nodes + 2), np.float32(fine.start), np.float32(1 / fine.cell),
        np.float32(scene.half), data.add(cubic_coefficients(coarse.heights)), np.int32(len(coarse.heights) + 2),
        np.float32(coarse.x0), np.float32(1 / coarse.cell),
    )  # fmt: skip


def _placed(data: _Data, levels: np.ndarray, form: tuple[int, float, int], rng: np.random.Generator) -> Tile:
    turn = rng.uniform(0, 2 * np.pi)
    return Tile(
        data.add(levels), np.int32(form[0]), np.int32(form[2]), np.float32(form[1]), np.float32(np.cos(turn)),
        np.float32(np.sin(turn)), np.float32(rng.uniform(0, form[0])),
    )  # fmt: skip


def _ripples(data: _Data, seed: int, wavelength: float, rng: np.random.Generator) -> tuple[Tile, float]:
    """Return the tile of ripples, and the RMS slope that ripples of unit height have in it."""
    field = ripple_tile(seed % VARIANTS)
    spacing = wavelength / TEXELS
    steep = np.sqrt(np.mean(np.square([np.gradient(field, spacing, axis=axis) for axis in (0, 1)])) * 2)
    return _placed(data, tile_levels(field, spacing, 1), (TILE, spacing, 1), rng), float(steep)


def _plates(data: _Data, seed: int, bedrock: bool, rng: np.random.Generator) -> Tile:
    form = (bedrock_plates.SIDE, bedrock_plates.TEXEL, PLATE_LEVELS)
    if not bedrock:
        return _placed(data, np.zeros(9, dtype=np.float32), form, rng)
    heights, _ = bedrock_plates.plates(seed % bedrock_plates.VARIANTS)
    return _placed(data, tile_levels(heights, bedrock_plates.TEXEL, PLATE_LEVELS), form, rng)


def _cover(data: _Data, scene: Scene, near: np.ndarray) -> Cover:
    """Return the cover of the ground, with the fragments at the feet of rocks as gravel."""
    cover = ground_cover(scene)
    inside = np.flatnonzero(np.abs(cover.axis) <= scene.half)
    pick = np.rint((cover.axis[inside] + scene.half) / NEAR_CELL).astype(int)
    rubble = np.zeros_like(cover.sand)
    rubble[np.ix_(inside, inside)] = scene.outcrop.traits.fragments * near[np.ix_(pick, pick)][..., 1] / CODE
    gravel = np.maximum(cover.gravel * (1 - 0.7 * cover.drift), FRAGMENTS * rubble * (1 - cover.drift))
    share = np.stack([cover.sand, gravel, cover.swept], axis=-1)
    return Cover(data.add(share), np.int32(len(share)), np.float32(cover.start), np.float32(1 / COVER_CELL))
