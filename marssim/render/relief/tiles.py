"""Periodic tiles of relief at all resolutions, laid on the ground by world position.

A level of a tile shows only waves that pixels as wide as its nodes' spacing resolve. So the relief fades with distance
before it shimmers, and both eyes, which share one footprint, see one surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.fft

from marssim.base.compute.compiled import inlined
from marssim.render.relief.bspline import quadratic_at, quadratic_coefficients

WHOLE, NONE = 5.5, 2.0  # pixels a wavelength from which on a wave shows fully, and below which it does not show
FINEST = 0.7  # [nodes] footprint up to which the finest level shows alone


class Tile(NamedTuple):
    """A tile of relief laid on the ground, as kernels take it.

    Attributes:
        start: Where the coefficients [m] of its levels begin in the relief's: finest level first, each row by row.
        side: Nodes along a side of the finest level, a power of two.
        levels: Number of levels; each has half the nodes of the one before.
        spacing: Spacing of the finest level's nodes [m].
        cosine: Cosine of the tile's turn.
        sine: Sine of the tile's turn.
        offset: Offset along both axes [nodes].
    """

    start: np.int32
    side: np.int32
    levels: np.int32
    spacing: np.float32
    cosine: np.float32
    sine: np.float32
    offset: np.float32


def shown(wavelength: np.ndarray, footprint: float) -> np.ndarray:
    """Return the share of a wave's height that pixels show, 0 to 1.

    Args:
        wavelength: (...) wavelengths [m].
        footprint: Width of a pixel on the ground [m].
    """
    ramp = np.clip((wavelength / footprint - NONE) / (WHOLE - NONE), 0, 1)
    return ramp * ramp * (3 - 2 * ramp)


def tile_levels(field: np.ndarray, spacing: float, levels: int) -> np.ndarray:
    """Return the coefficients of a periodic field at all levels, float32, flat.

    Args:
        field: (N, N) heights [m], N a power of two.
        spacing: Spacing of its nodes [m].
        levels: Number of levels.
    """
    side = len(field)
    spectrum = scipy.fft.rfft2(field)
    out = [quadratic_coefficients(spectrum, side)]
    for level in range(1, levels):
        half = side >> level
        down, across = scipy.fft.fftfreq(half, spacing * 2**level), scipy.fft.rfftfreq(half, spacing * 2**level)
        k = np.hypot(down[:, None], across[None, :])
        # the waves that the level holds; those of its own Nyquist frequency, which alias, are too short to show
        part = np.empty((half, half // 2 + 1), dtype=complex)
        middle = half // 2
        part[:middle], part[middle:] = spectrum[:middle, : middle + 1], spectrum[-middle:, : middle + 1]
        part *= shown(1 / np.maximum(k, 1e-12), spacing * 2**level) / 4**level
        out.append(quadratic_coefficients(part, half))
    return np.concatenate([each.ravel() for each in out]).astype(np.float32)


@inlined
def tile_at(coefficients, tile, x, y, footprint):
    """Return height [m] and slopes of a tile, float32, at world x, y [m]; footprint: width of a pixel there [m]."""
    start, side, levels, spacing, cosine, sine, offset = tile
    one, half, two = np.float32(1), np.float32(0.5), np.float32(2)
    scale = one / spacing
    u, v = (cosine * x - sine * y) * scale + offset, (sine * x + cosine * y) * scale + offset
    spread = footprint * scale
    size, left = side, levels
    low, high = np.float32(FINEST), two
    while spread > high and left > 0:
        start += size * size
        size >>= np.int32(1)
        u, v, scale = half * u, half * v, half * scale
        low, high = high, two * high
        left -= np.int32(1)
    height, along, across = np.float32(0), np.float32(0), np.float32(0)
    share = max((spread - low) / (high - low), np.float32(0))
    if left > 0:
        height, along, across = quadratic_at(coefficients, start, size, u, v)
        rest = one - share
        height, along, across = rest * height, rest * scale * along, rest * scale * across
    if share > 0 and left > 1:
        start += size * size
        value, du, dv = quadratic_at(coefficients, start, size >> np.int32(1), half * u, half * v)
        steep = half * scale * share
        height, along, across = height + share * value, along + steep * du, across + steep * dv
    return height, cosine * along + sine * across, cosine * across - sine * along


@inlined
def nearest_level(tile, x, y, footprint):
    """Return what `level_at` takes of the level that resembles `tile_at` most around x, y [m]; its scale is 0 for none.

    These are the level's start and nodes along a side; the position of x, y in it [nodes]; and its nodes per metre.
    """
    start, side, levels, spacing, cosine, sine, offset = tile
    scale = np.float32(1) / spacing
    u, v = (cosine * x - sine * y) * scale + offset, (sine * x + cosine * y) * scale + offset
    spread, size, left, half = footprint * scale, side, levels, np.float32(0.5)
    while spread > np.float32(1.5) and left > 0:
        start += size * size
        size >>= np.int32(1)
        u, v, scale, spread = half * u, half * v, half * scale, half * spread
        left -= np.int32(1)
    if left == 0:
        scale = np.float32(0)
    return start, size, u, v, scale


@inlined
def level_at(coefficients, level, cosine, sine, dx, dy):
    """Return height [m] and slopes of a `nearest_level` dx, dy [m] beside its position; cosine, sine: of its Tile."""
    start, size, u, v, scale = level
    value, along, across = quadratic_at(
        coefficients, start, size, u + (cosine * dx - sine * dy) * scale, v + (sine * dx + cosine * dy) * scale
    )
    return value, (cosine * along + sine * across) * scale, (cosine * across - sine * along) * scale
