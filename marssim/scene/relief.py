"""What shapes the ground: the knobs, and self-affine noise.

Mars is rough alike at all scales: the RMS height difference over a lag r grows as r^H, with Hurst exponent H of 0.5 to
0.8. The field is drawn in the Fourier domain with the isotropic spectrum S(k) = C k^-(2 + 2H), where C follows in
closed form from the RMS slope at 1 m (structure function of a self-affine surface).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft
from scipy.special import gamma

from marssim.scene.heightmap import FIELD, file_digest
from marssim.scene.ranges import Range

SUBHARMONICS = 3  # times that the middle of the Fourier grid is split


@dataclass(frozen=True)
class ReliefConfig:
    """The shape of the ground."""

    hurst: float = 0.7
    """Hurst exponent of the relief, between 0 and 1: small is rough, large is rolling; 0.5 to 0.8 on Mars"""
    rms_slope_deg: float = 5.0
    """RMS slope of the relief over 1 m [deg], without craters and ripples; 4.8 to 5.4 at Pathfinder and Viking 1;
    not used with a heightmap, whose own roughness goes on below its resolution"""
    regional_slope_deg: float = 0.0
    """tilt of the whole scene [deg]"""
    regional_azimuth_deg: float = 0.0
    """direction in which the tilt rises most [deg], counter-clockwise from east"""
    crater_density: float = 0.004
    """craters from 1 m to the largest diameter on a square metre; the number above a diameter falls as its square"""
    crater_max_diameter: float = 25.0
    """largest crater [m]; with a heightmap, only craters too small for it are drawn"""
    crater_depth: Range = (0.03, 0.2)
    """depth from rim to floor over diameter, LOW HIGH: each crater lies between worn (.03) and fresh (.2)"""
    crater_fill_diameter: float = 4.0
    """craters wider than this [m] are partly filled with sand: as deep as one of this width"""
    ripple_amplitude: float = 0.012
    """height of aeolian ripples [m], half of crest to trough"""
    ripple_wavelength: float = 0.9
    """distance between ripple crests [m]"""
    ripple_cover: float = 0.35
    """share of the ground that carries ripples, 0 to 1"""
    heightmap: str | None = None
    """file with measured heights instead of drawn relief: .npy [m], 16-bit .png, or .tif (GeoTIFF); north is up. A
    scene's heights count from the ground in its middle; heightmap.datum in sample.json, added to them, gives the
    file's"""
    heightmap_scale: float | None = None
    """side of a heightmap cell [m]; not needed for a GeoTIFF in metres"""
    heightmap_height: float | None = None
    """metres of height for each unit of the heightmap's values; needed for .png, 1 for the others"""
    heightmap_at: Range | None = (0.0, 0.0)
    """where the scene lies: metres east and north of the heightmap's middle; None: each scene draws its own place"""
    heightmap_sha256: str | None = None
    """digest of the heightmap; filled in from the file, so that the data tell what they were made of. Given, another
    file is refused"""

    def __post_init__(self) -> None:
        if not 0 < self.hurst < 1:
            raise ValueError(f"hurst must lie in (0, 1), got {self.hurst}")
        if not 0 <= self.rms_slope_deg < 45:
            raise ValueError(f"rms_slope_deg must lie in [0, 45), got {self.rms_slope_deg}")
        if not 0 <= abs(self.regional_slope_deg) < 45:
            raise ValueError(f"regional_slope_deg must lie in (-45, 45), got {self.regional_slope_deg}")
        if not abs(self.regional_azimuth_deg) <= 360:
            raise ValueError(f"regional_azimuth_deg must lie in [-360, 360], got {self.regional_azimuth_deg}")
        if not 0 <= self.crater_density <= 1:
            raise ValueError(f"crater_density must lie in [0, 1], got {self.crater_density}")
        if not 1 <= self.crater_max_diameter <= 200:
            raise ValueError(f"crater_max_diameter must lie in [1, 200], got {self.crater_max_diameter}")
        if not 0 < self.crater_depth[0] <= self.crater_depth[1] <= 0.3:
            raise ValueError(f"crater_depth must be a range within (0, 0.3], got {self.crater_depth}")
        if not 0 < self.crater_fill_diameter < np.inf:
            raise ValueError(f"crater_fill_diameter must be positive and finite, got {self.crater_fill_diameter}")
        if not 0 <= self.ripple_amplitude <= 0.5:
            raise ValueError(f"ripple_amplitude must lie in [0, 0.5], got {self.ripple_amplitude}")
        if not 0.1 <= self.ripple_wavelength <= 50:
            raise ValueError(f"ripple_wavelength must lie in [0.1, 50], got {self.ripple_wavelength}")
        if not 0 <= self.ripple_cover <= 1:
            raise ValueError(f"ripple_cover must lie in [0, 1], got {self.ripple_cover}")
        for name in ("heightmap_scale", "heightmap_height"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} must be positive, got {value}")
        if self.heightmap_at is not None and not np.isfinite(self.heightmap_at).all():
            raise ValueError(f"heightmap_at must be finite, got {self.heightmap_at}")
        if self.heightmap is None:
            for name in ("heightmap_scale", "heightmap_height", "heightmap_at", "heightmap_sha256"):
                if getattr(self, name) != getattr(ReliefConfig, name):
                    raise ValueError(f"{name} says how a heightmap is taken, which needs {FIELD}")
        else:
            digest = file_digest(self.heightmap)
            if self.heightmap_sha256 not in (None, digest):
                raise ValueError(f"{FIELD} {self.heightmap}: its SHA-256 is {digest}, not {self.heightmap_sha256}")
            object.__setattr__(self, "heightmap_sha256", digest)


def self_affine(n: int, cell: float, hurst: float, rms_slope: float, rng: np.random.Generator) -> np.ndarray:
    """White Gaussian noise shaped to a self-affine spectrum, still in the Fourier domain.

    rms_slope: RMS height difference over 1 m, tan of the RMS slope. Returns (n, n // 2 + 1) complex spectrum whose
    irfft2 is the periodic field [m] of side n * cell; waves longer than that are long_waves().
    """
    k = wavenumber(n, cell)
    k[0, 0] = np.inf
    amplitude = _amplitude(hurst, rms_slope) * k ** (-1 - hurst)
    for j in (-1, 0, 1):  # of the next cells the Fourier grid is too coarse
        for i in (0, 1):
            if (i, j) != (0, 0):
                amplitude[j, i] *= _over_cell(i, j, hurst)
    return fft.rfft2(rng.standard_normal((n, n))) * (amplitude * 2 * np.pi / cell)


def long_waves(x: np.ndarray, period: float, hurst: float, rms_slope: float, rng: np.random.Generator) -> np.ndarray:
    """(len(x), len(x)) heights [m] on the grid x, x of the waves longer than `period` [m] of the self-affine field.

    Without them a field of that side would be too level: at H = 0.7 they are a third of the variance of slopes over a
    twentieth of it. The cell around k = 0 of the Fourier grid is split into 3 x 3, and its middle again (subharmonics;
    Lane, Glindemann and Dainty 1992). What is longer than 27 periods is a plane over this ground.
    """
    out = np.zeros((len(x), len(x)))
    amplitude = _amplitude(hurst, rms_slope)
    for part in range(1, SUBHARMONICS + 1):
        step = 2 * np.pi / period / 3**part
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                if i == j == 0:
                    continue
                k = step * np.hypot(i, j)
                swing = amplitude * _over_cell(i, j, hurst) * k ** (-1 - hurst) * step
                wave = swing * (rng.standard_normal(2) @ (1, 1j))
                out += (np.exp(1j * step * j * x)[:, None] * (wave * np.exp(1j * step * i * x))).real
    # E[(dh/dx)^2] of S(k) = C k^-(2 + 2H) within the square |kx|, |ky| < step / 2, in polar coordinates
    angle = (np.arange(64) + 0.5) * np.pi / 256
    edge = step / 2 / np.cos(angle)
    tilt = amplitude * np.sqrt(np.pi * np.mean(edge ** (2 - 2 * hurst)) / (2 - 2 * hurst))
    east, north = tilt * rng.standard_normal(2)
    return out + east * x + north * x[:, None]


@lru_cache(maxsize=64)
def _over_cell(i: int, j: int, hurst: float) -> float:
    """What the amplitude at the middle of the cell (i, j) of a Fourier grid is short of: the slopes of its waves.

    Square root of the mean of k^2 S(k) ~ k^-2H over the cell, over its value in the middle.
    """
    at = (np.arange(32) + 0.5) / 32 - 0.5
    mean = np.mean(np.hypot(i + at, j + at[:, None]) ** (-2 * hurst))
    return float(np.sqrt(mean) * np.hypot(i, j) ** hurst)


def _amplitude(hurst: float, rms_slope: float) -> float:
    """Square root of C, from the structure function E[(h(x + r) - h(x))^2] = 4 pi C I(H) r^2H."""
    integral = 2.0 ** (-1 - 2 * hurst) * gamma(1 - hurst) / (hurst * gamma(1 + hurst))
    return rms_slope / float(np.sqrt(4 * np.pi * integral))


def wavenumber(n: int, cell: float) -> np.ndarray:
    """(n, n // 2 + 1) absolute wave numbers [rad / m] of an rfft2."""
    ky = 2 * np.pi * np.fft.fftfreq(n, cell)
    kx = 2 * np.pi * np.fft.rfftfreq(n, cell)
    return np.hypot(ky[:, None], kx[None, :])
