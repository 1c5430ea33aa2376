"""What covers the ground of a scene: rippled sand, gravel, and ground that the wind has swept bare.

It follows from the scene alone. The renderer draws it, and the wheels of the rover feel it.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from marssim.base.compute.compiled import compiled
from marssim.scene.ground.drifts import Drifts, drifts_of
from marssim.scene.ground.noise import coded_tile, octave_value, placing
from marssim.scene.scene import Scene

CELL = 0.1  # [m] grid of the cover
MARGIN = 8.0  # [m] how far it reaches beyond the fine square
BURIED_AT = 0.015  # [m] height of a drift that buries pebbles and fine relief
PATCH_WAVELENGTHS = (1.7, 7.0)  # [m] sizes of patches of sand and bedrock
GRAVEL_WAVELENGTHS = (2.3, 9.0)  # [m] sizes of patches of gravel
VARIANTS = 4  # tiles of noise that scenes share


@dataclass(frozen=True, eq=False)
class GroundCover:
    """The cover on a grid around the middle of the scene; row j lies at y = start + j CELL, column i at x likewise.

    Attributes:
        sand: (N, N) share of rippled sand, drifts against rocks included, 0 to 1.
        gravel: (N, N) share of stones that lie close together, 0 to 1.
        drift: (N, N) share of the sand that lies against rocks and slabs, 0 to 1.
        swept: (N, N) how bare the wind has swept the ground, to about 1.5; plates of bedrock stand out from 0 on.
        start: x and y of the first node [m].
    """

    sand: np.ndarray
    gravel: np.ndarray
    drift: np.ndarray
    swept: np.ndarray
    start: float

    @property
    def axis(self) -> np.ndarray:
        """(N,) x of the columns and y of the rows [m]."""
        return self.start + np.arange(len(self.sand)) * CELL


_of_scene: WeakKeyDictionary[Scene, GroundCover] = WeakKeyDictionary()


def ground_cover(scene: Scene) -> GroundCover:
    """Return what covers a scene's ground, made at the first call for this scene."""
    if scene not in _of_scene:
        _of_scene[scene] = _made(scene)
    return _of_scene[scene]


def smooth_step(value: np.ndarray) -> np.ndarray:
    """Return a share, 0 to 1, that rises smoothly where a value rises from -0.5 to 0.5."""
    share = np.clip(value + 0.5, 0, 1)
    return share * share * (3 - 2 * share)


def _made(scene: Scene) -> GroundCover:
    look, seed = scene.look, scene.look.texture_seed
    reach = scene.half + MARGIN
    nodes = int(np.ceil(2 * reach / CELL)) + 1
    axis = -reach + np.arange(nodes) * CELL
    patch = _noise(axis, coded_tile(VARIANTS + seed % VARIANTS, False), placing(PATCH_WAVELENGTHS, seed + 1))
    other = _noise(axis, coded_tile(2 * VARIANTS + seed % VARIANTS, False), placing(GRAVEL_WAVELENGTHS, seed + 7))
    drift = _drift_share(axis, scene.half, drifts_of(scene))
    gravel = _patches(0.7 * other, look.gravel)
    sand = np.maximum(_patches(0.55 * patch, look.wind_ripples) * (1 - gravel), drift)
    swept = (-0.45 * patch + 1.8 * look.bedrock - 0.45) * (1 - gravel) * (1 - drift)
    return GroundCover(sand, gravel, drift, swept, -reach)


def _drift_share(axis: np.ndarray, half: float, drifts: Drifts) -> np.ndarray:
    out = np.zeros((len(axis), len(axis)))
    if drifts.heights.any():
        inside = np.flatnonzero(np.abs(axis) <= half)
        pick = np.rint((axis[inside] - drifts.start) / drifts.cell).astype(int)
        out[np.ix_(inside, inside)] = smooth_step(drifts.heights[np.ix_(pick, pick)] / BURIED_AT - 0.5)
    return out


def _patches(noise: np.ndarray, share: float) -> np.ndarray:
    """Return patches, 0 to 1, that cover a share of the ground and lie where the noise (N, N) is high."""
    if share in (0, 1):
        return np.full_like(noise, share)
    some = np.sort(noise.ravel()[:: noise.size // 4096 + 1])
    low, high = -1 - some[-1], 1 - some[0]
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if smooth_step(some + middle).mean() < share else (low, middle)
    return smooth_step(noise + low)


@compiled
def _noise(axis, tile, places):
    """Return the sum of noise octaves (N, N) at the nodes of a square grid."""
    n = len(axis)
    out = np.zeros((n, n))
    for j in range(n):
        for i in range(n):
            for octave in range(len(places)):
                out[j, i] += octave_value(tile, places, octave, np.float32(axis[i]), np.float32(axis[j]))
    return out
