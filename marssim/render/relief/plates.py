"""Bare bedrock: level plates, cracked and worn, with sand in the joints between them.

The plates are a periodic tile that lies on the ground by world position, as pebbles do. They are Voronoi cells of
scattered points, with smaller cells inside. They stand out of the sand by up to 4 cm where the wind has swept it away.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np
import scipy.fft
from scipy import ndimage

from marssim.base.compute.compiled import compiled, inlined
from marssim.base.compute.kept_arrays import kept_arrays
from marssim.render.relief.height import SWEPT_DEPTH
from marssim.render.relief.pyramid import CHANNELS, CODES, pyramid, pyramid_at

SIDE = 1024  # texels along a side of the tile
TEXEL = 0.006  # [m] size of a texel
SMOOTHING = 0.7  # [texels] standard deviation of the blur of borders
PLATES = (9, 27)  # numbers of plates and of pieces along the side
BEND = 0.03  # [m] how far borders deviate from straight lines
SHORTEST_BEND = 1.4  # [1/m] standard deviation of the wave numbers of that deviation
ROUGH = (0.03, 0.09)  # [m] wavelengths of the roughness of plates; its standard deviations follow
ROUGH_HEIGHT, ROUGH_JOINT, ROUGH_TONE = 0.0008, 0.003, 0.05  # height [m], border [m] and logarithm of brightness
ROUNDING = 0.012  # [m] width of the worn border of a plate
STANDING = 0.012  # [m] height of a plate above the sand in its joints
TILT = 0.02  # standard deviation of a plate's slope
PIECE_TILT = 0.4  # additional slope of a piece, over that of a plate
PIECE_BEND = 0.4  # deviation of the borders of pieces over that of plates: they meet these at any angle
BROKEN = 0.7  # share of the plates that are broken into pieces
JOINT = (0.005, 0.03)  # [m] half the width of a joint: the least, and the largest addition to it
JOINT_CRACK = 0.005  # [m] width of the dark line along a plate's border
JOINT_SIDE = 0.006  # [m] how far outside the border that line begins
SPLIT = (0.002, 0.004)  # [m] width of a crack between pieces: the least, and the largest addition to it
SPLIT_DARK, SPLIT_DEEP = 0.6, 0.35  # its darkness over that of a joint, and its depth over the plate's height
TONE, PLATE_TONE, PIECE_TONE = -0.10, 0.07, 0.04  # logarithm of brightness: mean, and standard deviations
DARK = 0.9  # share of the light that a crack takes
PLATE_COVER, PIECE_COVER = 0.9, 0.15  # ranges of the sand cover of plates and of their pieces
TONES = 1.0  # logarithm of brightness of the largest code
DRAWN = np.dtype([(name, np.float64) for name in ("east", "north", "tone", "chance")])  # slopes, N(0, 1), U(0, 1)
VARIANTS = 2  # number of tiles that scenes choose from; each scene turns and shifts its tile


@lru_cache(maxsize=VARIANTS)
def plates(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a tile of plates, drawn or from a file.

    Returns:
        Heights (SIDE, SIDE) [m] over the sand around them where the ground is not swept at all, so mostly below 0; and
        their look at all resolutions, (M, 2) int8 of `pyramid`: tone (logarithm of brightness) in TONES / CODES, and
        crack (share of the light that cracks take) in 1 / CODES.
    """
    kept = kept_arrays(_drawn_tile, f"plates{seed}", partial(_drawn_tile, seed))
    return kept["height"], kept["look"]


def _drawn_tile(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng((seed, 9))
    k = np.hypot(scipy.fft.fftfreq(SIDE, TEXEL)[:, None], scipy.fft.rfftfreq(SIDE, TEXEL)[None, :])
    band = np.exp(-0.5 * (k / SHORTEST_BEND) ** 2) * (k > 0)
    bend = [_field(rng, band) * BEND / TEXEL for _ in range(2)]
    rough = _field(rng, sum(np.exp(-((k * wavelength - 1) ** 2)) for wavelength in ROUGH))
    margin = 3 + math.ceil(np.abs(bend).max() * max(PLATES) / SIDE)  # of cells, as borders bend
    levels = [_around(_jittered(n, rng), margin) for n in PLATES]
    draws = [_drawn(n * n, rng) for n in PLATES]
    finest = np.empty((SIDE, SIDE, CHANNELS), dtype=np.float32)
    height = np.empty((SIDE, SIDE), dtype=np.float32)
    _plates(levels[0], levels[1], margin, draws[0], draws[1], bend[0], bend[1], rough, height, finest)
    height, finest = (_smooth(field) for field in (height, finest))
    return {"height": height, "look": pyramid(finest)}


def _smooth(field: np.ndarray) -> np.ndarray:
    """Return a periodic field (SIDE, SIDE, ...) without the steps that its texels make of slanting borders."""
    return np.asarray(ndimage.gaussian_filter(field, (SMOOTHING, SMOOTHING, 0)[: field.ndim], mode="wrap"))


def _drawn(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the properties of plates or pieces, (count,) of DRAWN."""
    out = np.empty(count, dtype=DRAWN)
    out["east"], out["north"] = rng.normal(0, TILT, (2, count))
    out["tone"], out["chance"] = rng.standard_normal(count), rng.random(count)
    return out


def _field(rng: np.random.Generator, band: np.ndarray) -> np.ndarray:
    """Draw (SIDE, SIDE) float32 periodic noise of unit variance with the given spectrum."""
    white = scipy.fft.rfft2(rng.standard_normal((SIDE, SIDE)))
    out = scipy.fft.irfft2(white * band, s=(SIDE, SIDE))
    return (out / out.std()).astype(np.float32)


def _jittered(n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw (n, n, 2) points x, y [texels], one in each cell of a grid over the tile."""
    j, i = np.indices((n, n))
    return (np.stack([i, j], -1) + rng.uniform(0.08, 0.92, (n, n, 2))) * (SIDE / n)


def _around(points: np.ndarray, margin: int) -> np.ndarray:
    """Return points of _jittered with those of the next `margin` cells of the tiles around, (n + 2 margin, ..., 2)."""
    cells = np.arange(-margin, len(points) + margin)
    tile = SIDE * (cells // len(points))
    around = points[np.ix_(cells % len(points), cells % len(points))]
    return around + np.stack(np.meshgrid(tile, tile), axis=-1)


@compiled
def _nearest(points, margin, x, y):
    """Return the point nearest to x, y [texels], the vector from it, and the distance to its Voronoi cell's border.

    points: of _around, with a margin of at least two cells around x, y.
    """
    n = len(points) - 2 * margin
    cell = SIDE / n
    ci, cj = math.floor(x / cell) + margin, math.floor(y / cell) + margin
    best, nearest_i, nearest_j, bx, by = 1e18, 0, 0, 0.0, 0.0
    for j in range(cj - 2, cj + 3):
        for i in range(ci - 2, ci + 3):
            dx, dy = x - points[j, i, 0], y - points[j, i, 1]
            if dx * dx + dy * dy < best:
                best, nearest_i, nearest_j, bx, by = dx * dx + dy * dy, i, j, dx, dy
    border, farthest = 1e18, 1e18
    for j in range(cj - 2, cj + 3):
        for i in range(ci - 2, ci + 3):
            dx, dy = x - points[j, i, 0], y - points[j, i, 1]
            square = dx * dx + dy * dy
            if square > farthest:
                continue
            apart = math.hypot(dx - bx, dy - by)
            if apart > 1e-6:
                border = min(border, (square - best) / (2 * apart))
                reach = math.sqrt(best) + 2 * border  # of points whose border is nearer, by the triangle inequality
                farthest = (1 + 1e-9) * reach * reach
    return ((nearest_j - margin) % n) * n + (nearest_i - margin) % n, bx, by, border


@compiled
def _plates(large, small, margin, plate_drawn, piece_drawn, bend_x, bend_y, rough, height, out):
    """Fill in the heights of plates [m], and their look, out (SIDE, SIDE, CHANNELS), in codes; see plates.

    large, small: points of plates and of pieces, of _around; plate_drawn, piece_drawn: of DRAWN.
    """
    for j in range(SIDE):
        for i in range(SIDE):
            n, px, py, border = _nearest(large, margin, i + bend_x[j, i], j + bend_y[j, i])
            m, qx, qy, split = _nearest(small, margin, i + PIECE_BEND * bend_y[j, i], j + PIECE_BEND * bend_x[j, i])
            border, split = border * TEXEL, split * TEXEL
            plate, piece = plate_drawn[n], piece_drawn[m]
            broken = plate.chance < BROKEN  # into pieces
            edge = border - (JOINT[0] + JOINT[1] * piece.chance + ROUGH_JOINT * rough[j, i])
            inside = 1 - math.exp(-max(edge, 0.0) / ROUNDING)
            crack = math.exp(-max(edge, 0.0) / JOINT_CRACK) if edge > -JOINT_SIDE else 0.0
            lean = plate.east * px + plate.north * py
            tone = TONE + PLATE_TONE * plate.tone + ROUGH_TONE * rough[j, i]
            cover = PLATE_COVER * plate.chance
            if broken:
                gap = math.exp(-split / (SPLIT[0] + SPLIT[1] * piece.chance))
                crack = max(crack, SPLIT_DARK * gap)
                inside *= 1 - SPLIT_DEEP * gap
                lean += PIECE_TILT * (piece.east * qx + piece.north * qy)
                tone += PIECE_TONE * piece.tone
                cover += PIECE_COVER * piece.chance
            top = lean * TEXEL + ROUGH_HEIGHT * rough[j, i]
            height[j, i] = inside * (STANDING + top) - STANDING - SWEPT_DEPTH * cover
            out[j, i, 0] = min(max(tone / TONES, -1.0), 1.0) * CODES
            out[j, i, 1] = DARK * crack * CODES


@inlined
def plate_look_at(codes, placed, x, y, footprint):
    """Return tone and crack of the bedrock at world x, y [m].

    codes: of `plates`; placed: Tile of its heights; footprint: width of a pixel on the ground [m].
    """
    tone, crack = pyramid_at(codes, placed, x, y, footprint)
    return tone * np.float32(TONES / CODES), crack * np.float32(1 / CODES)
