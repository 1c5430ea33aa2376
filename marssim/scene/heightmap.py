"""Heightmaps from files (NumPy array, 16-bit PNG, GeoTIFF), and the roughness that they lack below their resolution.

In a file, row 0 is the northern edge and column 0 the western one, as in an image, unless the tags of a GeoTIFF say
otherwise. A value belongs to the middle of its cell.
"""

from __future__ import annotations

import hashlib
import os
import stat
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from marssim.base.files.decoding import decode
from marssim.base.files.geotiff_tags import GeoTags, read_geotiff_tags
from marssim.base.files.npy import read_npy
from marssim.base.files.png import decode_png

MARGIN = 6  # cells around the scene that the interpolation needs
ROUNDING = 1e-6  # cells by which a division may be off
LEAST_CELLS = 8  # cells along the side of a scene
FIELD = "`relief.heightmap`"  # field of SceneConfig that messages begin with; commands turn names in ` ` into flags
HIGHEST = 1e7  # [m] largest height, also of maps whose heights count from the centre of Mars
STEEPEST = 20.0  # steepest rise from cell to cell, in cell sizes
PLACES = 200  # places tried for a scene that draws its place


@dataclass(frozen=True)
class HeightMap:
    """A heightmap as read from a file.

    Attributes:
        heights: (ny, nx) float64 [m], row 0 south; nan where the file has no data.
        cell: Side of a cell [m].
        name: Name of the file, for messages.
    """

    heights: np.ndarray
    cell: float
    name: str

    def window(self, half: float, at: tuple[float, float] | None, rng: np.random.Generator) -> HeightMapPart:
        """Return the part of the map under a scene.

        A scene may reach to the border of the outermost cells, half a cell beyond their middles, and has their height
        there.

        Args:
            half: Half the side of the scene [m].
            at: Middle of the scene, east and north of the map's middle [m]; None draws it.
            rng: Random generator for a drawn place.

        Raises:
            ValueError: The scene reaches beyond the map, the map has gaps there, or its heights are implausible.
        """
        ny, nx = self.heights.shape
        reach = half / self.cell
        room = np.array([nx, ny]) / 2 - reach + ROUNDING
        if room.min() < 0:
            raise ValueError(
                f"{self.name}: covers {nx * self.cell:g} x {ny * self.cell:g} m, too small for the scene of "
                f"{2 * half:g} x {2 * half:g} m; choose a smaller horizon (--horizon, or that of a place file), or "
                "another file"
            )
        if 2 * reach < LEAST_CELLS:
            raise ValueError(
                f"{self.name}: a scene of {2 * half:g} m is only {2 * reach:.1f} cells of {self.cell:g} m wide; "
                f"a finer map is needed"
            )
        if at is not None and (np.abs(np.array(at) / self.cell) > room).any():
            raise ValueError(
                f"{self.name}: a scene of {2 * half:g} m at {at[0]:g}, {at[1]:g} reaches beyond the map; "
                f"`relief.heightmap_at` may be +-{room[0] * self.cell:g} m east and +-{room[1] * self.cell:g} m north"
            )
        inner = np.maximum(np.array([nx - 1, ny - 1]) / 2 - reach, 0)  # a drawn scene stays within the cells' middles
        for _ in range(1 if at is not None else PLACES):
            offset = rng.uniform(-inner, inner) if at is None else np.array(at, dtype=float) / self.cell
            middle = np.array([nx - 1, ny - 1]) / 2 + offset
            i0, j0 = np.maximum(np.floor(middle - reach).astype(int) - MARGIN, 0)
            i1, j1 = np.ceil(middle + reach).astype(int) + MARGIN + 1
            part = self.heights[j0:j1, i0:i1]
            holes = np.mean(~np.isfinite(part))
            if holes == 0:
                self._check_heights(part)
                x0, y0 = (i0 - middle[0]) * self.cell, (j0 - middle[1]) * self.cell
                drawn = float(offset[0] * self.cell), float(offset[1] * self.cell)
                return HeightMapPart(part, self.cell, x0, y0, drawn if at is None else at)
        if at is None:
            raise ValueError(f"{self.name}: no place without gaps in the data was found for a scene of {2 * half:g} m")
        raise ValueError(
            f"{self.name}: {100 * holes:.3g} % of the scene's ground has no data (nan or nodata); choose "
            f"another `relief.heightmap_at`"
        )

    def _check_heights(self, part: np.ndarray) -> None:
        """Raise ValueError for implausible heights or steps: the unit is wrong, or gaps are not marked as such."""
        doubt = "are its values metres (`relief.heightmap_height`), and are all cells without data nan or nodata?"
        if (highest := float(np.abs(part).max())) > HIGHEST:
            raise ValueError(f"{self.name}: has heights of {highest:g} m; {doubt}")
        step = max(float(np.abs(np.diff(part, axis=axis)).max()) for axis in (0, 1))
        if step > STEEPEST * self.cell:
            raise ValueError(f"{self.name}: rises by {step:g} m from one cell of {self.cell:g} m to the next; {doubt}")


@dataclass(frozen=True)
class HeightMapPart:
    """The part of a heightmap under a scene.

    Attributes:
        heights: (ny, nx) [m], row 0 south, all finite.
        cell: Side of a cell [m].
        x0: East coordinate of heights[0, 0] in the scene [m].
        y0: North coordinate of heights[0, 0] in the scene [m].
        at: Origin of the scene, east and north of the map's middle [m].
    """

    heights: np.ndarray
    cell: float
    x0: float
    y0: float
    at: tuple[float, float]

    def sample(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the heights on a regular grid, by cubic splines; a map finer than the grid is smoothed first.

        Args:
            x: (nx,) east coordinates in the scene [m], equally spaced.
            y: (ny,) north coordinates [m], with the same spacing.

        Returns:
            (ny, nx) heights [m].
        """
        ratio = (x[1] - x[0]) / self.cell
        heights = self.heights
        if ratio > 1:
            heights = cv2.GaussianBlur(heights, (0, 0), 0.45 * float(ratio), borderType=cv2.BORDER_REPLICATE)
        at = np.meshgrid((y - self.y0) / self.cell, (x - self.x0) / self.cell, indexing="ij")
        return ndimage.map_coordinates(heights, at, order=3, mode="nearest")

    def missing(self, k: np.ndarray) -> np.ndarray:
        """Return the share of the amplitude that the splines lack at wave numbers k [rad/m], from 0 (long waves) to 1.

        Cubic splines halve the amplitude at the grid's Nyquist wave number, and it falls as k^8 around it.
        """
        shown = 1 / (1 + np.minimum(k * self.cell / np.pi, 1e6) ** 8)
        return np.sqrt(1 - shown**2)

    def rms_slope(self, hurst: float) -> float:
        """Return the RMS height difference over 1 m, if the roughness continues below the cells with a Hurst exponent.

        It comes from second differences over 2 cells, which do not depend on a regional slope:
        E[(h(x + r) - 2 h(x) + h(x - r))^2] = (4 - 2^2H) E[(h(x + r) - h(x))^2].
        """
        lag = 2
        h = self.heights
        second = [
            np.mean((h[2 * lag :] - 2 * h[lag:-lag] + h[: -2 * lag]) ** 2),
            np.mean((h[:, 2 * lag :] - 2 * h[:, lag:-lag] + h[:, : -2 * lag]) ** 2),
        ]
        return float(np.sqrt(np.mean(second) / (4 - 4**hurst)) / (lag * self.cell) ** hurst)


def file_digest(path: str) -> str:
    """Return the SHA-256 of a heightmap. Raises ValueError, which names the file, if it cannot be read."""
    try:
        state = os.stat(path)
        if stat.S_ISREG(state.st_mode) or stat.S_ISDIR(state.st_mode):  # a folder cannot be opened
            return _digest(path, state.st_size, state.st_mtime_ns)
    except OSError as error:
        raise ValueError(f"{FIELD} {path}: {(error.strerror or str(error)).lower()}") from None
    raise ValueError(f"{FIELD} {path}: is a device or a pipe, not a file")  # which may have no end


def check_digest(path: str, digest: str) -> None:
    """Raise ValueError, which names the file, if a heightmap has another SHA-256, or cannot be read."""
    if (actual := file_digest(path)) != digest:
        raise ValueError(f"{FIELD} {path}: its SHA-256 is {actual}, not {digest}")


@lru_cache(maxsize=8)
def _digest(path: str, size: int, changed: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@lru_cache(maxsize=1)
def read_heightmap(path: str, digest: str, scale: float | None, height: float | None) -> HeightMap:
    """Read a heightmap.

    Args:
        path: A .npy, .png, .tif or .tiff file.
        digest: SHA-256 that the file must have.
        scale: Side of a cell [m]; None takes that of the file.
        height: Metres of a unit of the values; None means what the file says, or 1.

    Raises:
        ValueError: The file cannot be read, or lacks what is needed. The message is one line that names the file.
    """
    name = f"{FIELD} {path}"
    check_digest(path, digest)
    suffix = Path(path).suffix.lower()
    tags = GeoTags()
    if suffix == ".npy":
        values = _read_npy(path, name)
    elif suffix == ".png":
        values = _read_image(path, name)
        if values.dtype != np.uint16:
            raise ValueError(f"{name}: has {8 * values.itemsize} bits a pixel, 16 are needed")
        if height is None:
            raise ValueError(f"{name}: a PNG has no unit of height; give `relief.heightmap_height` [m]")
    elif suffix in (".tif", ".tiff"):
        values = _read_image(path, name)
        if values.dtype == np.uint8 and height is None:
            raise ValueError(f"{name}: has 8 bits a pixel, as pictures have; give `relief.heightmap_height` [m]")
        tags = read_geotiff_tags(path, name, "`relief.heightmap_scale`", scale is not None)
        scale = tags.cell if scale is None else scale
    else:
        raise ValueError(f"{name}: ends in neither .npy, .png, .tif nor .tiff")
    if scale is None:
        raise ValueError(f"{name}: has no cell size; give `relief.heightmap_scale` [m]")
    if min(values.shape) < 2:
        raise ValueError(f"{name}: has {values.shape[1]} x {values.shape[0]} cells, too few")
    heights = values.astype(float)
    heights = tags.scale * heights + tags.offset if height is None else height * heights
    if tags.nodata is not None:
        # The tag is text, whose few digits may mean a float32. An integer type cannot hold every nodata value.
        with np.errstate(over="ignore"):
            empty = values.dtype.type(tags.nodata) if values.dtype.kind == "f" else np.float64(tags.nodata)
        heights[values.astype(float) == empty] = np.nan
    heights[~np.isfinite(heights)] = np.nan
    rows, columns = 1 if tags.south_first else -1, -1 if tags.east_first else 1
    return HeightMap(np.ascontiguousarray(heights[::rows, ::columns]), float(scale), name)


def _read_npy(path: str, name: str) -> np.ndarray:
    try:
        values = read_npy(path)
    except ValueError as error:
        raise ValueError(f"{name}: cannot be read as a .npy file ({error})") from None
    if values.ndim != 2 or values.dtype.kind not in "iuf":
        raise ValueError(f"{name}: must be a two-dimensional array of numbers, is {values.dtype} {values.shape}")
    return values


def _read_image(path: str, name: str) -> np.ndarray:
    data = Path(path).read_bytes()
    values = decode_png(data) if path.lower().endswith(".png") else decode(data)
    if values is None:
        raise ValueError(f"{name}: cannot be read as an image; it may be truncated or of another format")
    if values.ndim != 2:
        raise ValueError(f"{name}: has {values.shape[2]} channels, a heightmap has one")
    return values
