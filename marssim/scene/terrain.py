"""The ground as height fields: a fine grid inside a coarse one, from relief, landforms or a heightmap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from marssim.scene.ditches import Ditches, draw_ditch_across, draw_ditches
from marssim.scene.heightmap import HeightMapPart, read_heightmap
from marssim.scene.landforms import draw_craters, draw_fresh_craters, ripples
from marssim.scene.relief import ReliefConfig, long_waves, self_affine, wavenumber

__all__ = ["HeightGrid", "ReliefConfig", "Terrain", "build_terrain"]

COARSE_CELL = 1.0  # [m] grid of the coarse part
CROSSOVER = 5.0  # [m] wavelength at which the fine grid's spectrum takes over from the coarse grid's
FINEST_WAVE, FEWEST_CELLS = 0.36, 4.5  # shortest waves of the fine grid: metres, and cells if these are coarser
BLEND = 2.0  # [m] width of the strip in which the fine relief fades into the coarse one
CELLS_PER_CRATER = 3.0  # cells of a heightmap that a crater must span before the map shows it


@dataclass(frozen=True)
class HeightGrid:
    """Heights on a regular grid, linear on two triangles per cell.

    Each cell is split along the diagonal from its (x, y) corner to its (x + cell, y + cell) corner.

    Attributes:
        heights: (ny, nx) float64 [m]; row j lies at y = y0 + j cell, column i at x = x0 + i cell.
        x0: East coordinate of column 0 [m].
        y0: North coordinate of row 0 [m].
        cell: Grid spacing [m].
    """

    heights: np.ndarray
    x0: float
    y0: float
    cell: float

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least and largest coordinates of the grid: x0, y0, x1, y1 [m]."""
        ny, nx = self.heights.shape
        return self.x0, self.y0, self.x0 + (nx - 1) * self.cell, self.y0 + (ny - 1) * self.cell

    def locate(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the cells of points x, y (...) [m]: indices i, j and the position s, t in [0, 1] within the cell.

        Points outside are moved to the nearest edge of the grid.
        """
        ny, nx = self.heights.shape
        fx = np.clip((np.asarray(x, dtype=float) - self.x0) / self.cell, 0, nx - 1)
        fy = np.clip((np.asarray(y, dtype=float) - self.y0) / self.cell, 0, ny - 1)
        i = np.minimum(fx.astype(np.int64), nx - 2)
        j = np.minimum(fy.astype(np.int64), ny - 2)
        return i, j, fx - i, fy - j

    def gradient_at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the height [m] and the slopes dh/dx, dh/dy of the triangle below each point. x, y: (...) [m]."""
        i, j, s, t = self.locate(x, y)
        h = self.heights
        h00, h10, h01, h11 = h[j, i], h[j, i + 1], h[j + 1, i], h[j + 1, i + 1]
        lower = s >= t
        gx = np.where(lower, h10 - h00, h11 - h01)
        gy = np.where(lower, h11 - h10, h01 - h00)
        return h00 + gx * s + gy * t, gx / self.cell, gy / self.cell

    def smooth_heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return heights (...) [m] of the cubic spline through the nodes at points x, y (...) [m] on the grid."""
        at = [(np.asarray(y, dtype=float) - self.y0) / self.cell, (np.asarray(x, dtype=float) - self.x0) / self.cell]
        return ndimage.map_coordinates(self.heights, at, order=3, mode="mirror")

    def contains(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return whether points lie on the grid, edges included. x, y: [m], broadcast against each other."""
        x0, y0, x1, y1 = self.bounds
        return (np.asarray(x) >= x0) & (np.asarray(x) <= x1) & (np.asarray(y) >= y0) & (np.asarray(y) <= y1)

    def vertex_normals(self) -> np.ndarray:
        """Return the (ny * nx, 3) upward unit normals at the vertices of `mesh`, by central differences."""
        gy, gx = np.gradient(self.heights, self.cell)
        normals = np.stack([-gx, -gy, np.ones_like(gx)], axis=-1).reshape(-1, 3)
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def mesh(self, keep: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the grid as triangles whose normals point upward.

        Args:
            keep: (ny - 1, nx - 1) bool, the cells to triangulate; None takes all.

        Returns:
            Vertices (V, 3) float64 [m] and faces (F, 3) int32.
        """
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
    """The ground: a fine grid around the origin, and a coarse one out to the horizon with a hole for the fine one.

    The ground at the origin has height 0.

    Attributes:
        fine: The fine grid.
        coarse: The coarse grid, also under the fine one; `coarse_cells` are the cells around it.
        datum: Height to add to a scene's height for that of the drawn relief or of the heightmap [m].
        at: Position of the origin in the heightmap, east and north of its middle [m]; None without a heightmap.
    """

    fine: HeightGrid
    coarse: HeightGrid
    datum: float = 0.0
    at: tuple[float, float] | None = None

    def gradient_at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the height [m] and the slopes dh/dx, dh/dy of the ground triangle below each point x, y (...) [m]."""
        inside = self.fine.contains(x, y)
        return tuple(  # type: ignore[return-value]
            np.where(inside, a, b) for a, b in zip(self.fine.gradient_at(x, y), self.coarse.gradient_at(x, y))
        )

    def height_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m] at x, y (...) [m]. Outside the scene, it is that of the nearest edge."""
        return self.gradient_at(x, y)[0]

    @property
    def coarse_cells(self) -> np.ndarray:
        """The cells of the coarse grid that lie around the fine one: (ny - 1, nx - 1) bool."""
        ny, nx = self.coarse.heights.shape
        x = self.coarse.x0 + (np.arange(nx - 1) + 0.5) * self.coarse.cell
        y = self.coarse.y0 + (np.arange(ny - 1) + 0.5) * self.coarse.cell
        return ~self.fine.contains(x[None, :], y[:, None])


def build_terrain(
    config: ReliefConfig,
    size: float,
    cell: float,
    horizon: float,
    rng: np.random.Generator,
    clear: tuple[tuple[float, float, float], ...] = (),
    ditch_across: tuple[float, float, float, float] | None = None,
) -> Terrain:
    """Draw a terrain around the origin. The same state of rng gives the same terrain.

    Args:
        config: Shape of the ground.
        size: Side of the finely gridded square [m].
        cell: Grid spacing of that square [m].
        horizon: Half the side of the coarse square [m].
        rng: Random generator.
        clear: Discs (x, y, radius) [m] without ditches and fresh craters.
        ditch_across: x, y of the start and x, y of the end of a way [m] that one more ditch cuts; None for no such.

    Raises:
        ValueError: The sizes make no grid, or the heightmap cannot be read or does not cover the scene.
    """
    if not 0 < cell < size < 2 * horizon:
        raise ValueError(f"need 0 < cell < size < 2 horizon, got cell={cell}, size={size}, horizon={horizon}")
    half = int(np.ceil(size / 2 / COARSE_CELL)) * COARSE_CELL  # the fine square ends on lines of the coarse grid
    far = int(np.ceil(horizon / COARSE_CELL)) * COARSE_CELL
    n_coarse, n_fine = round(2 * far / COARSE_CELL) + 1, round(2 * half / cell) + 1
    x, far_x = np.linspace(-half, half, n_fine), np.linspace(-far, far, n_coarse)
    relief_rng, crater_rng, ripple_rng, place_rng, fresh_rng, ditch_rng = rng.spawn(6)

    window = _window(config, far, place_rng)
    fine, coarse = _relief(config, x, far_x, window, relief_rng)
    largest = config.crater_max_diameter
    if window is not None:  # the map shows the larger ones
        largest = min(largest, CELLS_PER_CRATER * window.cell)
    ditches = draw_ditches(config, far, clear, ditch_rng)
    if ditch_across is not None:
        ditches = Ditches((*ditches.ditches, draw_ditch_across(config, ditch_across, ditch_rng)))
    landforms = (
        draw_craters(config, far, largest, crater_rng),
        draw_fresh_craters(config, far, clear, fresh_rng),
        ditches,
    )
    for landform in landforms:
        landform.add_to(fine, x, x)
        landform.add_to(coarse, far_x, far_x)
    if window is None or config.ripple_wavelength < CELLS_PER_CRATER * window.cell:  # the map shows longer ones
        fine += ripples(config, n_fine, x[1] - x[0], ripple_rng)
    slope, azimuth = np.tan(np.deg2rad(config.regional_slope_deg)), np.deg2rad(config.regional_azimuth_deg)
    for heights, axis in ((fine, x), (coarse, far_x)):
        heights += slope * (np.cos(azimuth) * axis + np.sin(azimuth) * axis[:, None])

    # at the border the fine heights lie on the smooth surface through the coarse ones, which rays see (smooth_heights)
    coarse_grid = HeightGrid(coarse, -far, -far, COARSE_CELL)
    blended = fine.copy()
    strip = int(np.ceil(min(BLEND, half) / (x[1] - x[0]))) + 1
    for part in (np.s_[:strip], np.s_[-strip:], np.s_[:, :strip], np.s_[:, -strip:]):
        px, py = (axis[part] for axis in np.meshgrid(x, x, copy=False))
        edge = np.clip((half - np.maximum(np.abs(px), np.abs(py))) / BLEND, 0, 1)
        weight = edge * edge * (3 - 2 * edge)
        below = coarse_grid.smooth_heights(px, py)
        blended[part] = weight * fine[part] + (1 - weight) * below
    if n_fine % 2:
        offset = float(blended[n_fine // 2, n_fine // 2])
    else:  # the origin lies in the middle of a cell
        offset = float(HeightGrid(blended, -half, -half, x[1] - x[0]).gradient_at(np.array(0.0), np.array(0.0))[0])
    return Terrain(
        fine=HeightGrid(blended - offset, -half, -half, x[1] - x[0]),
        coarse=HeightGrid(coarse - offset, -far, -far, COARSE_CELL),
        datum=offset,
        at=None if window is None else window.at,
    )


def _window(config: ReliefConfig, far: float, rng: np.random.Generator) -> HeightMapPart | None:
    """Return the part of the heightmap under the scene; None without a heightmap."""
    if config.heightmap is None:
        return None
    assert config.heightmap_sha256 is not None
    source = read_heightmap(config.heightmap, config.heightmap_sha256, config.heightmap_scale, config.heightmap_height)
    return source.window(far, config.heightmap_at, rng)


def _relief(
    config: ReliefConfig, x: np.ndarray, far_x: np.ndarray, window: HeightMapPart | None, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the heights on the fine and the coarse grid [m]: self-affine noise plus the heightmap."""
    slope = float(np.tan(np.deg2rad(config.rms_slope_deg))) if window is None else window.rms_slope(config.hurst)

    def draw(axis: np.ndarray, coarse: bool) -> np.ndarray:
        cell = axis[1] - axis[0]
        n = fft.next_fast_len(len(axis), real=True)
        spectrum = self_affine(n, cell, config.hurst, slope, rng)
        k = wavenumber(n, cell)
        longer = 1 / np.sqrt(1 + (k * CROSSOVER / (2 * np.pi)) ** 8)
        if not coarse:  # what the grid cannot carry smoothly is left to the fine relief of marssim.render.relief
            finest = max(FINEST_WAVE, FEWEST_CELLS * cell)
            longer = np.sqrt((1 - longer**2) / (1 + (k * finest / (2 * np.pi)) ** 12))
        spectrum *= longer
        if window is not None:
            spectrum *= window.missing(k)
        return fft.irfft2(spectrum, s=(n, n))[: len(axis), : len(axis)]

    coarse, fine = draw(far_x, True), draw(x, False)
    if window is None:
        coarse += long_waves(far_x, fft.next_fast_len(len(far_x), real=True) * COARSE_CELL, config.hurst, slope, rng)
    fine += _sampled(coarse, (x - far_x[0]) / COARSE_CELL)
    if window is not None:
        fine += window.sample(x, x)
        coarse += window.sample(far_x, far_x)
    return fine, coarse


def _sampled(heights: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return a square grid of heights [m] at finer rows and columns, by cubic convolution (Keys 1981, a = -0.75).

    Only additions and multiplications of float64 in a fixed order: every processor gives the same bits.

    Args:
        heights: (N, N) [m].
        at: (M,) rows and columns to sample, 0 to N - 1. Beyond its edge, the grid continues at the edge's height.

    Returns:
        (M, M) [m].
    """
    first = np.floor(at).astype(np.int64)
    t = at - first
    u = 1 - t
    weights = [-0.75 * t * u * u, _near(t), _near(u), -0.75 * u * t * t]  # of four nodes from first - 1
    nodes = [np.clip(first + k, 0, len(heights) - 1) for k in (-1, 0, 1, 2)]
    rows = sum(weight[:, None] * heights[node] for weight, node in zip(weights, nodes))
    return np.asarray(sum(weight * rows[:, node] for weight, node in zip(weights, nodes)))


def _near(t: np.ndarray) -> np.ndarray:
    """Return the weight of the nearer nodes at distances t (M,) from them, 0 to 1."""
    return (1.25 * t - 2.25) * t * t + 1
