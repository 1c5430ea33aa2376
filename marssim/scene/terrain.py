"""Relief: a self-affine height field with craters and ripples, on a fine grid inside a coarse one.

Mars is rough alike at all scales: the RMS height difference over a lag r grows as r^H, with Hurst exponent H of 0.5 to
0.8. The field is drawn in the Fourier domain with the isotropic spectrum S(k) = C k^-(2 + 2H), where C follows in
closed form from the RMS slope at 1 m (structure function of a self-affine surface).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import fft
from scipy.special import erfinv, gamma

CROSSOVER = 5.0  # [m] wavelength at which the fine grid's spectrum takes over from the coarse grid's
BLEND = 2.0  # [m] width of the strip in which the fine relief fades into the coarse one


@dataclass(frozen=True)
class ReliefConfig:
    """Knobs of the ground's shape; lengths in metres, angles in degrees."""

    hurst: float = 0.7  # Hurst exponent, 0.5 to 0.8 on Mars
    rms_slope_deg: float = 5.0  # RMS slope over a lag of 1 m
    regional_slope_deg: float = 0.0  # tilt of the whole scene
    regional_azimuth_deg: float = 0.0  # direction of steepest ascent, counter-clockwise from east
    crater_density: float = 0.004  # craters of more than 1 m diameter per square metre
    crater_max_diameter: float = 25.0
    ripple_amplitude: float = 0.012  # half of crest to trough
    ripple_wavelength: float = 0.9
    ripple_cover: float = 0.35  # share of the ground that carries ripples

    def __post_init__(self) -> None:
        if not 0 < self.hurst < 1:
            raise ValueError(f"hurst must lie in (0, 1), got {self.hurst}")
        if not 0 <= self.rms_slope_deg < 45:
            raise ValueError(f"rms_slope_deg must lie in [0, 45), got {self.rms_slope_deg}")
        if not 0 <= abs(self.regional_slope_deg) < 45:
            raise ValueError(f"regional_slope_deg must lie in (-45, 45), got {self.regional_slope_deg}")


@dataclass(frozen=True)
class HeightGrid:
    """Heights on a regular grid, linear on two triangles a cell.

    heights: (ny, nx) float64 [m]; row j is y = y0 + j cell, column i is x = x0 + i cell. Each cell is split along the
    diagonal from its (x, y) to its (x + cell, y + cell) corner.
    """

    heights: np.ndarray
    x0: float
    y0: float
    cell: float

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 [m]."""
        ny, nx = self.heights.shape
        return self.x0, self.y0, self.x0 + (nx - 1) * self.cell, self.y0 + (ny - 1) * self.cell

    def locate(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Cell indices i, j and the position s, t in [0, 1] within the cell; clamped to the grid."""
        ny, nx = self.heights.shape
        fx = np.clip((np.asarray(x, dtype=float) - self.x0) / self.cell, 0, nx - 1)
        fy = np.clip((np.asarray(y, dtype=float) - self.y0) / self.cell, 0, ny - 1)
        i = np.minimum(fx.astype(np.int64), nx - 2)
        j = np.minimum(fy.astype(np.int64), ny - 2)
        return i, j, fx - i, fy - j

    def gradient_at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and its slopes dh/dx, dh/dy on the triangle below each point. x, y: (...) [m]."""
        i, j, s, t = self.locate(x, y)
        h = self.heights
        h00, h10, h01, h11 = h[j, i], h[j, i + 1], h[j + 1, i], h[j + 1, i + 1]
        lower = s >= t
        gx = np.where(lower, h10 - h00, h11 - h01)
        gy = np.where(lower, h11 - h10, h01 - h00)
        return h00 + gx * s + gy * t, gx / self.cell, gy / self.cell

    def contains(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points lie on the grid, edges included. x, y: [m], broadcast. Returns bool."""
        x0, y0, x1, y1 = self.bounds
        return (np.asarray(x) >= x0) & (np.asarray(x) <= x1) & (np.asarray(y) >= y0) & (np.asarray(y) <= y1)

    def vertex_normals(self) -> np.ndarray:
        """(ny * nx, 3) unit normals at the vertices of mesh(), by central differences, upward."""
        gy, gx = np.gradient(self.heights, self.cell)
        normals = np.stack([-gx, -gy, np.ones_like(gx)], axis=-1).reshape(-1, 3)
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def mesh(self, keep: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) float64 and faces (F, 3) int32, normals upward; keep: (ny - 1, nx - 1) bool cells."""
        ny, nx = self.heights.shape
        x = self.x0 + np.arange(nx) * self.cell
        y = self.y0 + np.arange(ny) * self.cell
        vertices = np.stack([np.broadcast_to(x, (ny, nx)), np.broadcast_to(y[:, None], (ny, nx)), self.heights], -1)
        index = np.arange(ny * nx, dtype=np.int32).reshape(ny, nx)
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
        faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
        faces = faces.reshape(-1, 3) if keep is None else faces[keep].reshape(-1, 3)
        return vertices.reshape(-1, 3), np.ascontiguousarray(faces)


@dataclass(frozen=True)
class Terrain:
    """The ground: a fine grid around the origin, and a coarse one out to the horizon with a hole where the fine is."""

    fine: HeightGrid
    coarse: HeightGrid

    def gradient_at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height [m] and slopes dh/dx, dh/dy of the ground triangle below each point."""
        inside = self.fine.contains(x, y)
        return tuple(  # type: ignore[return-value]
            np.where(inside, a, b) for a, b in zip(self.fine.gradient_at(x, y), self.coarse.gradient_at(x, y))
        )

    def height_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Height of the ground [m]; x, y: (...) [m]. Outside the scene: that of the nearest edge."""
        return self.gradient_at(x, y)[0]

    def normal_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(..., 3) unit normal of the ground triangle below each point, world frame, upward."""
        _, gx, gy = self.gradient_at(x, y)
        normal = np.stack([-gx, -gy, np.ones_like(gx)], axis=-1)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def meshes(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """(vertices, faces) of the fine part and of the coarse part without its middle."""
        return self.fine.mesh(), self.coarse.mesh(keep=self.coarse_cells)

    @property
    def coarse_cells(self) -> np.ndarray:
        """(ny - 1, nx - 1) bool: the cells of the coarse grid that lie around the fine one."""
        ny, nx = self.coarse.heights.shape
        x = self.coarse.x0 + (np.arange(nx - 1) + 0.5) * self.coarse.cell
        y = self.coarse.y0 + (np.arange(ny - 1) + 0.5) * self.coarse.cell
        return ~self.fine.contains(x[None, :], y[:, None])


def self_affine(n: int, cell: float, hurst: float, rms_slope: float, rng: np.random.Generator) -> np.ndarray:
    """White Gaussian noise shaped to a self-affine spectrum, still in the Fourier domain.

    rms_slope: RMS height difference over 1 m, tan of the RMS slope. Returns (n, n // 2 + 1) complex spectrum whose
    irfft2 is the periodic field [m] of side n * cell.
    """
    k = wavenumber(n, cell)
    k[0, 0] = np.inf
    # structure function: E[(h(x + r) - h(x))^2] = 4 pi C I(H) r^2H for S = C k^-(2 + 2H)
    integral = 2.0 ** (-1 - 2 * hurst) * gamma(1 - hurst) / (hurst * gamma(1 + hurst))
    amplitude = rms_slope / np.sqrt(4 * np.pi * integral)
    return fft.rfft2(rng.standard_normal((n, n))) * (amplitude * k ** (-1 - hurst) * 2 * np.pi / cell)


def wavenumber(n: int, cell: float) -> np.ndarray:
    """(n, n // 2 + 1) absolute wave numbers [rad / m] of an rfft2."""
    ky = 2 * np.pi * np.fft.fftfreq(n, cell)
    kx = 2 * np.pi * np.fft.rfftfreq(n, cell)
    return np.hypot(ky[:, None], kx[None, :])


def _lowpass(k: np.ndarray) -> np.ndarray:
    return 1 / np.sqrt(1 + (k * CROSSOVER / (2 * np.pi)) ** 8)


def build_terrain(config: ReliefConfig, size: float, cell: float, horizon: float, rng: np.random.Generator) -> Terrain:
    """Draw a terrain around the origin.

    size: side of the finely gridded square [m]; cell: its grid [m]; horizon: half the side of the coarse square [m].
    The same rng state gives the same terrain. Raises ValueError for sizes that make no grid.
    """
    if not 0 < cell < size < 2 * horizon:
        raise ValueError(f"need 0 < cell < size < 2 horizon, got cell={cell}, size={size}, horizon={horizon}")
    coarse_cell = 1.0
    half = int(np.ceil(size / 2 / coarse_cell)) * coarse_cell  # the fine square ends on lines of the coarse grid
    far = int(np.ceil(horizon / coarse_cell)) * coarse_cell
    n_coarse, n_fine = round(2 * far / coarse_cell) + 1, round(2 * half / cell) + 1
    fine_cell = 2 * half / (n_fine - 1)
    slope = float(np.tan(np.deg2rad(config.rms_slope_deg)))

    n = fft.next_fast_len(n_coarse, real=True)
    spectrum = self_affine(n, coarse_cell, config.hurst, slope, rng) * _lowpass(wavenumber(n, coarse_cell))
    coarse = fft.irfft2(spectrum, s=(n, n))[:n_coarse, :n_coarse]
    n = fft.next_fast_len(n_fine, real=True)
    k = wavenumber(n, fine_cell)
    spectrum = self_affine(n, fine_cell, config.hurst, slope, rng) * np.sqrt(1 - _lowpass(k) ** 2)
    detail = fft.irfft2(spectrum, s=(n, n))[:n_fine, :n_fine]

    grid = np.linspace(-half, half, n_fine)
    at = ((grid + far) / coarse_cell).astype(np.float32)
    maps = np.meshgrid(at, at)
    smooth = cv2.remap(coarse.astype(np.float32), maps[0], maps[1], cv2.INTER_CUBIC).astype(float)
    x, y = np.meshgrid(grid, grid)
    xc, yc = np.meshgrid(np.linspace(-far, far, n_coarse), np.linspace(-far, far, n_coarse))
    fine, coarse = smooth + detail, coarse.copy()
    for add in (_craters(config, far, rng), _ripples(config, rng), _regional(config)):
        fine += add(x, y)
        coarse += add(xc, yc)

    # on the border the fine heights must lie on the coarse triangles' edges, or light shines through the seam
    coarse_grid = HeightGrid(coarse, -far, -far, coarse_cell)
    edge = np.clip((half - np.maximum(np.abs(x), np.abs(y))) / BLEND, 0, 1)
    weight = edge * edge * (3 - 2 * edge)
    fine = weight * fine + (1 - weight) * coarse_grid.gradient_at(x, y)[0]
    offset = float(fine[n_fine // 2, n_fine // 2])
    return Terrain(
        fine=HeightGrid(fine - offset, -half, -half, fine_cell),
        coarse=HeightGrid(coarse - offset, -far, -far, coarse_cell),
    )


def _regional(config: ReliefConfig):
    slope = np.tan(np.deg2rad(config.regional_slope_deg))
    azimuth = np.deg2rad(config.regional_azimuth_deg)
    return lambda x, y: slope * (np.cos(azimuth) * x + np.sin(azimuth) * y)


def _craters(config: ReliefConfig, far: float, rng: np.random.Generator):
    """Bowls with raised rims: number falls as D^-2, depth from 0.2 D (fresh) to 0.03 D (worn)."""
    count = rng.poisson(config.crater_density * (2 * far) ** 2)
    centre = rng.uniform(-far, far, (count, 2))
    diameter = np.minimum(rng.pareto(2.0, count) + 1, config.crater_max_diameter)
    depth = diameter * 0.2 * 0.15 ** rng.uniform(0, 1, count)
    depth *= np.minimum(1, 4 / diameter)  # large craters in sand are shallow

    def add(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        out = np.zeros_like(x)
        cell = x[0, 1] - x[0, 0]
        for (cx, cy), d, h in zip(centre, diameter, depth):
            reach = 1.5 * d
            i0, i1 = np.searchsorted(x[0], (cx - reach, cx + reach))
            j0, j1 = np.searchsorted(y[:, 0], (cy - reach, cy + reach))
            if i1 <= i0 or j1 <= j0 or d < 3 * cell:
                continue
            window = np.s_[j0:j1, i0:i1]
            r = np.hypot(x[window] - cx, y[window] - cy) / (d / 2)
            rim = 0.2 * h
            bowl = (h + rim) * np.minimum(r, 1) ** 2 - h
            apron = rim * np.maximum(0, (3 - r) / 2) ** 3
            out[window] += np.where(r < 1, bowl, apron)
        return out

    return add


def _ripples(config: ReliefConfig, rng: np.random.Generator):
    """Aeolian ripples: sharp crests across the wind, in patches, with wandering phase."""
    wind = rng.uniform(0, np.pi)
    phases = rng.uniform(0, 2 * np.pi, (6, 2))
    directions = rng.uniform(0, 2 * np.pi, (6, 2))

    def wander(x: np.ndarray, y: np.ndarray, column: int, wavelength: float) -> np.ndarray:
        out = np.zeros_like(x)
        for n, (phase, direction) in enumerate(zip(phases[:, column], directions[:, column])):
            k = 2 * np.pi / (wavelength * (1 + 0.45 * n))
            out += np.sin(k * (np.cos(direction) * x + np.sin(direction) * y) + phase)
        return out / np.sqrt(3.0)  # unit variance

    def add(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        if config.ripple_amplitude == 0 or config.ripple_cover == 0 or x[0, 1] - x[0, 0] > config.ripple_wavelength / 3:
            return np.zeros_like(x)
        along = np.cos(wind) * x + np.sin(wind) * y
        phase = 2 * np.pi * along / config.ripple_wavelength + 1.3 * wander(x, y, 0, 5 * config.ripple_wavelength)
        crest = 1 - 2 * np.abs(np.sin(phase / 2)) ** 0.8
        threshold = np.sqrt(2) * erfinv(1 - 2 * min(config.ripple_cover, 0.999))
        patch = np.clip((wander(x, y, 1, 7.0) - threshold) / 0.6, 0, 1)
        return config.ripple_amplitude * crest * patch

    return add
