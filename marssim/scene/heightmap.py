"""Heightmaps from files (NumPy array, 16-bit PNG, GeoTIFF), and the roughness that they lack below their resolution.

In a file, row 0 is the northern edge and column 0 the western one, as in an image. A value belongs to the middle of its
cell.
"""

from __future__ import annotations

import hashlib
import math
import os
import stat
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from PIL import TiffImagePlugin
from scipy import ndimage

from marssim.base.files.decoding import decode
from marssim.base.files.npy import read_npy
from marssim.base.files.png import decode_png

PIXEL_SCALE, GEO_KEYS, NO_DATA = 33550, 34735, 42113  # TIFF tags of GeoTIFF and GDAL
MODEL_TYPE, GEOGRAPHIC, LINEAR_UNIT, METRE = 1024, 2, 3076, 9001  # GeoTIFF keys and values
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

    def window(self, half: float, at: tuple[float, float] | None, rng: np.random.Generator) -> Window:
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
                f"{2 * half:g} x {2 * half:g} m; choose a smaller `horizon` or another file"
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
                return Window(part, self.cell, x0, y0, drawn if at is None else at)
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
class Window:
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


@lru_cache(maxsize=8)
def _digest(path: str, size: int, changed: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@lru_cache(maxsize=1)
def read_heightmap(path: str, digest: str, scale: float | None, height: float | None) -> HeightMap:
    """Read a heightmap.

    Args:
        path: A .npy, .png, .tif or .tiff file.
        digest: SHA-256 of the file; a key of the cache.
        scale: Side of a cell [m]; None takes that of the file.
        height: Metres of a unit of the values; None means 1.

    Raises:
        ValueError: The file cannot be read, or lacks what is needed. The message is one line that names the file.
    """
    name = f"{FIELD} {path}"
    suffix = Path(path).suffix.lower()
    nodata: float | None = None
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
        file_scale, nodata = _read_tags(path, name, scale is None)
        scale = file_scale if scale is None else scale
    else:
        raise ValueError(f"{name}: ends in neither .npy, .png, .tif nor .tiff")
    if scale is None:
        raise ValueError(f"{name}: has no cell size; give `relief.heightmap_scale` [m]")
    if min(values.shape) < 2:
        raise ValueError(f"{name}: has {values.shape[1]} x {values.shape[0]} cells, too few")
    heights = values.astype(float) * (1.0 if height is None else height)
    if nodata is not None:
        # The tag is text, whose few digits may mean a float32. An integer type cannot hold every nodata value.
        empty = values.dtype.type(nodata) if values.dtype.kind == "f" else np.float64(nodata)
        heights[values.astype(float) == empty] = np.nan
    heights[~np.isfinite(heights)] = np.nan
    return HeightMap(np.ascontiguousarray(heights[::-1]), float(scale), name)


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


def _read_tags(path: str, name: str, need_scale: bool) -> tuple[float | None, float | None]:
    """Return the cell size [m] and the nodata value of a GeoTIFF, None for what the file does not state."""
    try:
        with open(path, "rb") as file, warnings.catch_warnings(action="ignore"):  # the caller reports a broken file
            header = file.read(8)
            if header[2:4] in (b"+\x00", b"\x00+"):  # BigTIFF
                header += file.read(8)
            tags = TiffImagePlugin.ImageFileDirectory_v2(header)
            file.seek(tags.next)
            tags.load(file)
            scale, keys, nodata = (tags.get(tag) for tag in (PIXEL_SCALE, GEO_KEYS, NO_DATA))
    except Exception as error:  # a broken directory may raise anything in the reader
        raise ValueError(f"{name}: its tags cannot be read ({error})") from None
    if need_scale and keys is not None and not _are_numbers(keys, 4):
        raise ValueError(f"{name}: its tag of keys ({GEO_KEYS}) must be numbers, is {keys!r:.60}")
    if need_scale and scale is not None and not (_are_numbers(scale, 2) and min(scale[:2]) > 0):
        wanted = "must be two numbers above 0 or more"
        raise ValueError(f"{name}: its tag of the cells' size ({PIXEL_SCALE}) {wanted}, is {scale!r:.60}")
    if need_scale and keys is not None:
        entries = {key: value for key, place, _, value in zip(*[iter(keys[4:])] * 4) if place == 0}
        if entries.get(MODEL_TYPE) == GEOGRAPHIC:
            raise ValueError(f"{name}: its cells are in degrees; project it, or give `relief.heightmap_scale` [m]")
        if entries.get(LINEAR_UNIT, METRE) != METRE:
            raise ValueError(f"{name}: its cells are not measured in metres; give `relief.heightmap_scale` [m]")
    if need_scale and scale is not None and not np.isclose(scale[0], scale[1], rtol=1e-3):
        raise ValueError(f"{name}: its cells are {scale[0]:g} x {scale[1]:g} m, not square; resample it")
    try:
        empty = None if nodata is None else float(str(nodata).strip(" \0"))
    except ValueError:
        raise ValueError(f"{name}: its nodata tag must be a number, is {nodata!r}") from None
    return (float(scale[0]) if need_scale and scale is not None else None), empty


def _are_numbers(tag: object, least: int) -> bool:
    """Return whether a tag is a tuple of finite numbers, `least` or more."""
    return (
        isinstance(tag, tuple)
        and len(tag) >= least
        and all(isinstance(value, int | float) and math.isfinite(value) for value in tag)
    )
