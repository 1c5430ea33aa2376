"""The shape of the ground: its config, and self-affine noise.

Mars has similar roughness at all scales: the RMS height difference over a distance r grows as r^H, with a Hurst
exponent H of 0.5 to 0.8. The height field is drawn in the Fourier domain with the isotropic spectrum
S(k) = C k^-(2 + 2H). C follows in closed form from the RMS slope at 1 m (structure function of a self-affine surface).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft
from scipy.special import gamma

from marssim.scene.heightmap import FIELD, check_digest, file_digest
from marssim.scene.ranges import Range, check_ranges

# least and largest value of the ranges of steep landforms; walls that are steeper do not show on a grid of 8 cm
STEEP_LIMITS = {
    "fresh_crater_diameter": (1.0, 50.0),
    "ditch_width": (0.4, 20.0),
    "ditch_depth": (0.1, 5.0),
    "ditch_wall_deg": (20.0, 70.0),
    "ditch_length": (1.0, 200.0),
    "ditch_meander_deg": (0.0, 90.0),
}
SUBHARMONICS = 3  # how often the middle cell of the Fourier grid is split


@dataclass(frozen=True)
class ReliefConfig:
    """The shape of the ground, drawn or from a heightmap."""

    hurst: float = 0.7
    """Hurst exponent of the relief, between 0 and 1: a small one is rough, a large one rolling. Mars has 0.5 to 0.8."""
    rms_slope_deg: float = 5.0
    """RMS slope of the relief over 1 m [deg], at least 0 and below 45, without craters and ripples. Pathfinder and
    Viking 1 have 4.8 to 5.4. A heightmap ignores it: its own roughness continues below its resolution."""
    regional_slope_deg: float = 0.0
    """Tilt of the whole scene [deg], above -45 and below 45; 0 is level. A heightmap is tilted too."""
    regional_azimuth_deg: float = 0.0
    """Direction in which the tilted scene rises most [deg], -360 to 360, counter-clockwise from east."""
    crater_density: float = 0.004
    """Number of craters on a square metre, 0 to 1, of diameters from 1 m up to the largest. The number above a diameter
    falls with the square of the diameter."""
    crater_max_diameter: float = 25.0
    """Diameter of the largest craters [m], 1 to 200. On a heightmap, only craters too small for its resolution are
    drawn."""
    crater_depth: Range = (0.03, 0.2)
    """Depth of craters from rim to floor over their diameter, LOW HIGH, above 0 and up to 0.3: 0.03 is worn, 0.2 is
    fresh."""
    crater_fill_diameter: float = 4.0
    """Diameter of the deepest craters [m], above 0. Wider craters are filled with sand and are no deeper than these."""
    fresh_crater_density: float = 0.0
    """Number of further craters on a square metre, 0 to 0.1, that are all fresh: their walls have 38 deg, too steep to
    climb. They are drawn on heightmaps too."""
    fresh_crater_diameter: Range = (2.0, 6.0)
    """Diameter of these fresh craters [m], LOW HIGH, 1 to 50."""
    ditch_density: float = 0.0
    """Number of ditches on a square metre, 0 to 0.1: narrow troughs with steep walls, as gullies and cracks. They are
    drawn on heightmaps too."""
    ditch_width: Range = (0.8, 2.5)
    """Width of ditches from brink to brink [m], LOW HIGH, 0.4 to 20."""
    ditch_depth: Range = (0.5, 1.2)
    """Depth of ditches [m], LOW HIGH, 0.1 to 5. Narrow ones are shallower where their walls would meet."""
    ditch_wall_deg: Range = (40.0, 60.0)
    """Slope of the walls of ditches [deg], LOW HIGH, 20 to 70."""
    ditch_length: Range = (6.0, 20.0)
    """Length of ditches [m], LOW HIGH, 1 to 200."""
    ditch_meander_deg: Range = (0.0, 40.0)
    """Largest angle between a ditch and its mean direction [deg], LOW HIGH, 0 to 90: 0 is straight."""
    ripple_amplitude: float = 0.012
    """Amplitude of the wind's large ripples [m], 0 to 0.5: half the height from trough to crest. On a heightmap, only
    ripples too small for its resolution are drawn."""
    ripple_wavelength: float = 0.9
    """Distance between the crests of ripples [m], 0.1 to 50."""
    ripple_cover: float = 0.35
    """Share of the ground that carries ripples, 0 to 1."""
    heightmap: str | None = None
    """File with measured heights that replace the drawn relief: .npy [m], 16-bit .png, or .tif (GeoTIFF), with north
    up. The ground in the middle of a scene has height 0; heightmap.datum of sample.json is the file's height there."""
    heightmap_scale: float | None = None
    """Side of a heightmap's cell [m], above 0. A GeoTIFF in metres needs none."""
    heightmap_height: float | None = None
    """Height of one unit of the heightmap's values [m], above 0. A .png needs it. It defaults to 1 for .npy, and to
    GDAL's scale and offset in the file, or 1, for a GeoTIFF."""
    heightmap_at: Range | None = (0.0, 0.0)
    """Place of the scene in the heightmap: metres east and north of its middle. With None, each scene draws a place."""
    heightmap_sha256: str | None = None
    """SHA-256 of the heightmap. It is filled in from the file, so that a dataset records its source. If it is given,
    a file with another digest is refused."""

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
        for name in ("fresh_crater_density", "ditch_density"):
            if not 0 <= getattr(self, name) <= 0.1:
                raise ValueError(f"{name} must lie in [0, 0.1], got {getattr(self, name)}")
        check_ranges(self, STEEP_LIMITS)
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
                    raise ValueError(f"{name} describes a heightmap, so it needs {FIELD}")
        else:
            digest = file_digest(self.heightmap) if self.heightmap_sha256 is None else self.heightmap_sha256
            check_digest(self.heightmap, digest)
            object.__setattr__(self, "heightmap_sha256", digest)


def self_affine(n: int, cell: float, hurst: float, rms_slope: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the spectrum of a self-affine height field: white Gaussian noise, shaped in the Fourier domain.

    Args:
        n: Number of grid nodes along a side.
        cell: Grid spacing [m].
        hurst: Hurst exponent.
        rms_slope: RMS height difference over 1 m, the tangent of the RMS slope.
        rng: Random generator.

    Returns:
        (n, n // 2 + 1) complex spectrum. Its irfft2 is the periodic field [m] of side n * cell. `long_waves` draws the
        waves that are longer than that side.
    """
    k = wavenumber(n, cell)
    k[0, 0] = np.inf
    amplitude = _amplitude(hurst, rms_slope) * k ** (-1 - hurst)
    for j in (-1, 0, 1):  # next to k = 0 the spectrum varies too much over a cell of the Fourier grid
        for i in (0, 1):
            if (i, j) != (0, 0):
                amplitude[j, i] *= _over_cell(i, j, hurst)
    return fft.rfft2(rng.standard_normal((n, n))) * (amplitude * 2 * np.pi / cell)


def long_waves(x: np.ndarray, period: float, hurst: float, rms_slope: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the waves of a self-affine field that are longer than its period.

    Without them a field of that side would be too level: at H = 0.7 they make up a third of the variance of slopes over
    a twentieth of the side. The cell around k = 0 of the Fourier grid is split into 3 x 3 cells, and its middle again
    (subharmonics; Lane, Glindemann and Dainty 1992). Waves longer than 27 periods become a plane.

    Args:
        x: (N,) grid coordinates [m], the same along both axes.
        period: Side of the periodic field [m].
        hurst: Hurst exponent.
        rms_slope: RMS height difference over 1 m.
        rng: Random generator.

    Returns:
        (N, N) heights [m].
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
    """Return the factor from the amplitude at the middle of a cell of the Fourier grid to that of all its slopes.

    It is the square root of the mean of k^2 S(k) ~ k^-2H over the cell (i, j), over the value in the middle.
    """
    at = (np.arange(32) + 0.5) / 32 - 0.5
    mean = np.mean(np.hypot(i + at, j + at[:, None]) ** (-2 * hurst))
    return float(np.sqrt(mean) * np.hypot(i, j) ** hurst)


def _amplitude(hurst: float, rms_slope: float) -> float:
    """Return the square root of C, from the structure function E[(h(x + r) - h(x))^2] = 4 pi C I(H) r^2H."""
    integral = 2.0 ** (-1 - 2 * hurst) * gamma(1 - hurst) / (hurst * gamma(1 + hurst))
    return rms_slope / float(np.sqrt(4 * np.pi * integral))


def wavenumber(n: int, cell: float) -> np.ndarray:
    """Return the (n, n // 2 + 1) absolute wave numbers [rad/m] of an rfft2 of n x n nodes; cell: their spacing [m]."""
    ky = 2 * np.pi * np.fft.fftfreq(n, cell)
    kx = 2 * np.pi * np.fft.rfftfreq(n, cell)
    return np.hypot(ky[:, None], kx[None, :])
