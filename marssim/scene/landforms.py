"""Landforms on the relief: impact craters and the wind's large ripples."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import fft

from marssim.scene.relief import ReliefConfig

APRON = 3.0  # crater radii out to which the rim reaches
FRESH = 0.2  # depth over diameter of a fresh crater
SHORTER = 0.3  # wavelength of small ripples over that of the large ones that they ride on
PATCH = 7.0  # [m] size of the patches of ripples


@dataclass(frozen=True)
class Craters:
    """Bowls with raised rims.

    A fresh crater is a parabola of depth 0.2 D with a sharp rim of 0.04 D (Melosh 1989, simple craters): its wall has
    38 deg below the rim. A worn one is shallow, with a flat floor and a round rim.

    Attributes:
        centre: (N, 2) x, y [m].
        diameter: (N,) [m].
        freshness: (N,) from 0, worn, to 1, fresh.
        depth: (N,) depth from rim to floor [m].
    """

    centre: np.ndarray
    diameter: np.ndarray
    freshness: np.ndarray
    depth: np.ndarray

    def add_to(self, heights: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """Add the craters to heights, in place. Craters of less than 3 cells are left out.

        Args:
            heights: (ny, nx) [m].
            x: (nx,) ascending coordinates [m].
            y: (ny,) ascending coordinates [m].
        """
        cell = x[1] - x[0]
        for (cx, cy), d, depth, fresh in zip(self.centre, self.diameter, self.depth, self.freshness):
            reach = APRON * d / 2
            i0, i1 = np.searchsorted(x, (cx - reach, cx + reach))
            j0, j1 = np.searchsorted(y, (cy - reach, cy + reach))
            if i1 > i0 and j1 > j0 and d >= 3 * cell:
                r = np.hypot(x[i0:i1] - cx, y[j0:j1, None] - cy) / (d / 2)
                heights[j0:j1, i0:i1] += depth * crater_profile(r, fresh)


def draw_craters(config: ReliefConfig, far: float, largest: float, rng: np.random.Generator) -> Craters:
    """Draw craters of all ages. Their number falls as D^-2; their depths are uniform in the logarithm.

    Args:
        config: Density and depth; the density counts craters from 1 m to config.crater_max_diameter.
        far: Half the side of the square that they lie in [m].
        largest: Diameter of the largest craters that are kept [m], at most config.crater_max_diameter. Below 1 m,
            there are none.
        rng: Random generator.
    """
    share = (1 - largest**-2.0) / (1 - config.crater_max_diameter**-2.0) if largest > 1 else 0.0
    count = rng.poisson(share * config.crater_density * (2 * far) ** 2) if largest > 1 else 0
    centre = rng.uniform(-far, far, (count, 2))
    diameter = (1 - rng.uniform(0, 1 - largest**-2.0, count)) ** -0.5 if count else np.zeros(0)
    low, high = np.log(config.crater_depth)
    ratio = np.exp(rng.uniform(low, high, count))
    depth = ratio * np.minimum(diameter, config.crater_fill_diameter)
    return Craters(centre, diameter, np.clip(ratio / FRESH, 0, 1), depth)


def draw_fresh_craters(
    config: ReliefConfig, far: float, clear: tuple[tuple[float, float, float], ...], rng: np.random.Generator
) -> Craters:
    """Draw fresh craters only, with diameters uniform in the logarithm.

    Args:
        config: Density and diameters of the fresh craters.
        far: Half the side of the square that they lie in [m].
        clear: Discs (x, y, radius) [m] that no rim reaches.
        rng: Random generator.
    """
    count = rng.poisson(config.fresh_crater_density * (2 * far) ** 2)
    centre = rng.uniform(-far, far, (count, 2))
    low, high = np.log(config.fresh_crater_diameter)
    diameter = np.exp(rng.uniform(low, high, count))
    keep = np.ones(count, bool)
    for x, y, radius in clear:
        keep &= np.hypot(*(centre - (x, y)).T) > radius + diameter / 2
    return Craters(centre[keep], diameter[keep], np.ones(keep.sum()), FRESH * diameter[keep])


def crater_profile(r: np.ndarray, freshness: float) -> np.ndarray:
    """Return the height of a crater's profile, in units of its depth from rim to floor; 0 far away.

    Args:
        r: (...) distances from the middle, in crater radii.
        freshness: From 0, worn, to 1, fresh.
    """
    rim = 0.08 + 0.12 * freshness
    inner = np.minimum(r, 1)
    bowl = freshness * inner**2 + (1 - freshness) * inner**2 * (3 - 2 * inner) * inner**0.5
    taper = np.clip((APRON - r) / (APRON - 1), 0, 1)
    return np.where(r < 1, bowl - (1 - rim), rim * np.maximum(r, 1) ** -2.0 * taper * taper * (3 - 2 * taper))


def ripples(config: ReliefConfig, n: int, cell: float, rng: np.random.Generator) -> np.ndarray:
    """Draw aeolian ripples: sharp crests across the wind, in patches.

    The crests follow the phase of a narrow-band random wave. It has forks and ends where the wave vanishes, as real
    ripples have. Small ripples ride on the large ones. Ripples of less than 3 cells are left out.

    Args:
        config: Amplitude, wavelength and cover.
        n: Number of grid nodes along a side.
        cell: Grid spacing [m].
        rng: Random generator.

    Returns:
        (n, n) heights [m]; 0 between the patches.
    """
    wind = rng.uniform(0, np.pi)
    seeds = rng.spawn(3)
    if config.ripple_amplitude == 0 or config.ripple_cover == 0 or config.ripple_wavelength < 3 * cell:
        return np.zeros((n, n))
    size = fft.next_fast_len(n)
    out = config.ripple_amplitude * _wave_train(size, cell, config.ripple_wavelength, wind, seeds[0])[:n, :n]
    small = SHORTER * config.ripple_wavelength
    if small >= 3 * cell:
        turned = wind + rng.normal(0, 0.25)
        out += 0.6 * SHORTER * config.ripple_amplitude * _wave_train(size, cell, small, turned, seeds[1])[:n, :n]
    return out * _patches(n, cell, config.ripple_cover, seeds[2])


def _wave_train(n: int, cell: float, wavelength: float, wind: float, rng: np.random.Generator) -> np.ndarray:
    """Return (n, n) ripples with crests of about 1 and troughs of about -1; cell, wavelength [m]; wind [rad]."""
    k = 2 * np.pi / wavelength
    kx, ky = 2 * np.pi * np.fft.fftfreq(n, cell)[None, :] / k, 2 * np.pi * np.fft.fftfreq(n, cell)[:, None] / k
    along, across = np.cos(wind) * kx + np.sin(wind) * ky, np.cos(wind) * ky - np.sin(wind) * kx
    band = np.exp(-0.5 * (((along - 1) / 0.13) ** 2 + (across / 0.2) ** 2))
    # white noise is white in the Fourier domain too, so it is drawn there
    least = min(1e-4, 0.5 * float(band.max()))  # of a wave that is long for the square, one node at least
    row, column = np.flatnonzero(band.max(axis=1) > least), np.flatnonzero(band.max(axis=0) > least)
    # in double precision: functions of single precision differ between processors in their fifth digit
    wave = np.zeros((n, n), dtype=np.complex128)
    drawn = rng.standard_normal((len(row), len(column), 2)) @ (1, 1j)
    wave[np.ix_(row, column)] = band[np.ix_(row, column)] * drawn
    wave = fft.ifft2(wave, overwrite_x=True)
    strength = np.abs(wave)
    phase = np.angle(wave)
    phase += 0.35 * np.sin(phase)  # narrow crests, wide troughs; both sides of a crest are alike
    crest = 1.3 - 2 * np.abs(np.sin(phase / 2)) ** 0.8
    return crest * np.minimum(1, strength / (0.8 * np.sqrt(np.mean(strength**2))))


def _patches(n: int, cell: float, cover: float, rng: np.random.Generator) -> np.ndarray:
    """Return an (n, n) mask: 1 in patches that cover about the share `cover`, 0 between them, with soft borders."""
    if cover >= 1:
        return np.ones((n, n))
    nodes = max(8, int(np.ceil(n * cell / PATCH)) * 2)
    noise = cv2.GaussianBlur(rng.standard_normal((nodes + 8, nodes + 8)), (0, 0), 1.0)[4:-4, 4:-4]
    field = cv2.resize(noise, (n, n), interpolation=cv2.INTER_CUBIC)
    edge = np.quantile(field, 1 - cover)
    return np.clip((field - edge) / (0.5 * noise.std()) + 0.5, 0, 1)
