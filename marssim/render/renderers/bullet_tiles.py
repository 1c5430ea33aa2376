"""A scene as visual bodies in PyBullet, in tiles, so that a view costs only what lies in its frustum.

PyBullet does not report the triangle or the rock behind a pixel, and thousands of bodies are slow to build: the time
grows with the square of their number. So a tile of rocks is one body, and each rock in it has a flat colour of a small
palette. Rendered under ambient light alone, the colour image is an exact image of ids.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.base.files.png import encode_png
from marssim.engines.bullet import import_pybullet
from marssim.scene.rocks.mesh import Rocks
from marssim.scene.scene import Scene
from marssim.scene.terrain import HeightGrid

TILE_CELLS = 56  # grid cells along a side of a tile of ground
ROCK_TILE = (4.0, 16.0)  # [m] side of a tile of rocks, on the fine grid and outside it
PALETTE = (16, 8)  # steps of red and of green; 128 rocks per tile stay below PyBullet's limit of vertices
STEP = 16  # of 255, difference of neighbouring colours
PLAIN = [1.0, 1.0, 1.0, 1.0]
GROUND_COLOUR = [0.0, 0.0, 0.0, 1.0]
HIDDEN = [0.0, 0.0, 0.0, 0.0]  # TinyRenderer skips a fully transparent body before it looks at its triangles
PALETTE_UV = [  # texture coordinates of each colour of the palette; v runs upward
    ((red + 0.5) / PALETTE[0], 1 - (green + 0.5) / PALETTE[1])
    for green in range(PALETTE[1])
    for red in range(PALETTE[0])
]
_rows: list[list[float]] = []  # rows that createVisualShape has leaked, used again; see _borrow_rows


@dataclass(frozen=True)
class BodyTile:
    """One body: a block of grid cells, or some rocks.

    Attributes:
        low: (3,) lower corner of its box [m].
        high: (3,) upper corner [m].
        grid: The ground under the tile; None for rocks.
        keep: (ny - 1, nx - 1) bool cells of the grid that it holds; None for rocks.
        rocks: (N,) indices of its rocks; None for ground.
    """

    low: np.ndarray
    high: np.ndarray
    grid: HeightGrid | None = None
    keep: np.ndarray | None = None
    rocks: np.ndarray | None = None


class BulletTiles:
    """The tiles of a scene in a separate DIRECT client of PyBullet. A tile is built when it first comes into view."""

    def __init__(self, scene: Scene) -> None:
        self._rocks = scene.bodies
        self._face_start = np.searchsorted(scene.bodies.face_rock, np.arange(len(scene.bodies) + 1))
        terrain = scene.terrain
        every = np.ones(np.array(terrain.fine.heights.shape) - 1, dtype=bool)
        ground = [*_grid_tiles(terrain.fine, every), *_grid_tiles(terrain.coarse, terrain.coarse_cells)]
        self._tiles = [*ground, *_rock_tiles(scene.bodies, scene.half)]
        low, high = np.stack([t.low for t in self._tiles]), np.stack([t.high for t in self._tiles])
        self.low, self.high = low.min(axis=0), high.max(axis=0)
        pick = np.array(list(product((False, True), repeat=3)))
        corners = np.where(pick[None], high[:, None], low[:, None])  # (tiles, 8, 3)
        self._corners = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=-1)
        self._body = np.full(len(self._tiles), -1)
        self._shown = np.zeros(len(self._tiles), dtype=bool)
        self._tile_of_body: list[int] = []
        self._pb = import_pybullet()
        self._client: int | None = self._pb.connect(self._pb.DIRECT)
        self._prepare()

    def group_of(self, surface: np.ndarray) -> np.ndarray:
        """Return the groups (N,) int32 of surfaces (N,): `draw` cannot distinguish surfaces of one group."""
        return surface

    def draw(self, camera: PinholeCamera, pose: np.ndarray, near: float, far: float) -> tuple[np.ndarray, np.ndarray]:
        """Draw what each pixel shows between two depths.

        Args:
            camera: The camera.
            pose: (4, 4) camera to world.
            near: Least depth [m].
            far: Largest depth [m].

        Returns:
            (H, W) float64 depth [m] to the precision of the depth buffer, arbitrary in the sky; and (H, W) int32 groups
            of `group_of`, SKY where nothing is.

        Raises:
            RuntimeError: The renderer is closed.
        """
        if self._client is None:
            raise RuntimeError("this PyBulletRenderer is closed")
        view = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
        buffer, group = self._picture(camera, view, near, far)
        return far * near / (far - (far - near) * np.minimum(buffer, 1.0)), group

    def _prepare(self) -> None:
        """Prepare the client."""
        self._texture = self._load_palette()

    def _picture(
        self, camera: PinholeCamera, view: np.ndarray, near: float, far: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return OpenGL's depth (H, W), 0 to 1, and groups (H, W). view: (4, 4) OpenGL matrix for column vectors."""
        # TinyRenderer samples the left edge of a pixel in u and the lower edge in v, as tests against rays confirm
        projection = opengl_projection(camera, near, far, 0.0, 1.0)
        self._show(self._inside(projection @ view))
        width, height = camera.width, camera.height
        _, _, colour, depth, body = self._pb.getCameraImage(
            width, height, view.T.ravel().tolist(), projection.T.ravel().tolist(), shadow=0,
            lightColor=[1, 1, 1], lightAmbientCoeff=1, lightDiffuseCoeff=0, lightSpecularCoeff=0,
            renderer=self._pb.ER_TINY_RENDERER, physicsClientId=self._client,
        )  # fmt: skip
        body = np.asarray(body).reshape(height, width)
        colour = np.asarray(colour, dtype=np.uint8).reshape(height, width, 4)
        return np.asarray(depth, dtype=float).reshape(height, width), self._surface(body, colour)

    def close(self) -> None:
        """Disconnect from PyBullet, which frees the bodies; a second call does nothing."""
        if self._client is not None:
            self._pb.disconnect(self._client)
            self._client = None

    def _surface(self, body: np.ndarray, colour: np.ndarray) -> np.ndarray:
        surface = np.full(body.shape, SKY, dtype=np.int32)
        table = np.full((len(self._tile_of_body) + 1, PALETTE[0] * PALETTE[1]), GROUND, dtype=np.int32)
        rock_body = np.zeros(len(table), dtype=bool)
        for index, tile in enumerate(self._tile_of_body):
            rocks = self._tiles[tile].rocks
            if rocks is not None:
                table[index, : len(rocks)] = rocks + 1
                rock_body[index] = True
        hit = body >= 0
        surface[hit] = GROUND
        rock = hit & rock_body[body]
        red, green = (colour[rock][:, channel].astype(np.int64) // STEP for channel in (0, 1))
        surface[rock] = table[body[rock], red + PALETTE[0] * green]
        return surface

    def _inside(self, clip: np.ndarray) -> np.ndarray:
        """Return (tiles,) bool: a part of the tile's box may lie in the frustum."""
        corner = self._corners @ clip.T
        w = corner[..., 3:]
        beyond: np.ndarray = np.concatenate([corner[..., :3] > w, corner[..., :3] < -w], axis=-1)
        return np.logical_not(np.any(np.all(beyond, axis=1), axis=1))

    def _show(self, wanted: np.ndarray) -> None:
        for tile in np.flatnonzero(wanted & (self._body < 0)):
            self._build(int(tile))
        for tile in np.flatnonzero((wanted != self._shown) & (self._body >= 0)):
            rock = self._tiles[tile].rocks is not None
            shade = HIDDEN if not wanted[tile] else PLAIN if rock else GROUND_COLOUR
            self._pb.changeVisualShape(int(self._body[tile]), -1, rgbaColor=shade, physicsClientId=self._client)
        self._shown = wanted

    def _build(self, index: int) -> None:
        tile = self._tiles[index]
        mesh: dict[str, list] = {}
        if tile.rocks is None:
            assert tile.grid is not None
            vertices, faces = tile.grid.mesh(tile.keep)
        else:
            vertices, faces, palette = self._rock_mesh(tile.rocks)
            mesh["uvs"] = [PALETTE_UV[n] for n in palette.tolist()]
        mesh |= {"vertices": _borrow_rows(vertices), "indices": faces.ravel().tolist()}
        shape = self._pb.createVisualShape(
            self._pb.GEOM_MESH,
            rgbaColor=GROUND_COLOUR if tile.rocks is None else PLAIN,
            physicsClientId=self._client,
            **mesh,
        )
        for leaked in mesh.values():
            leaked.clear()  # PyBullet never frees these lists (see _borrow_rows)
        if shape < 0:
            raise RuntimeError(f"PyBullet refused a mesh of {len(vertices)} vertices and {len(faces)} faces")
        body = self._pb.createMultiBody(0, -1, shape, physicsClientId=self._client)
        if tile.rocks is not None:
            self._pb.changeVisualShape(body, -1, textureUniqueId=self._texture, physicsClientId=self._client)
        assert body == len(self._tile_of_body)
        self._tile_of_body.append(index)
        self._body[index] = body
        self._shown[index] = True

    def _rock_mesh(self, rocks: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the vertices (V, 3), the faces (F, 3) and the palette index of each vertex (V,) of some rocks."""
        faces = [self._rocks.faces[self._face_start[n] : self._face_start[n + 1]] for n in rocks]
        used, renumbered = np.unique(np.concatenate(faces), return_inverse=True)
        renumbered = renumbered.reshape(-1, 3)
        local = np.empty(len(used), dtype=int)
        local[renumbered] = np.repeat(np.arange(len(rocks)), [len(f) for f in faces])[:, None]
        return self._rocks.vertices[used], renumbered, local

    def _load_palette(self) -> int:
        red, green = np.meshgrid(np.arange(PALETTE[0]), np.arange(PALETTE[1]))
        image = np.stack([np.zeros_like(red), green, red], axis=-1) * STEP + STEP // 2
        handle, path = tempfile.mkstemp(suffix=".png")
        try:
            os.close(handle)
            Path(path).write_bytes(encode_png(image.astype(np.uint8)))
            return int(self._pb.loadTexture(path, physicsClientId=self._client))
        finally:
            os.unlink(path)


def opengl_projection(camera: PinholeCamera, near: float, far: float, left: float, top: float) -> np.ndarray:
    """Return the OpenGL projection of a camera, for column vectors and images whose row 0 is on top.

    Args:
        camera: The camera.
        near: Least depth [m].
        far: Largest depth [m].
        left: Where in a pixel the renderer samples, from its left edge [px]. OpenGL's convention is 0.5.
        top: The same from its upper edge [px].

    Returns:
        (4, 4).
    """
    out = np.zeros((4, 4))
    out[0, 0], out[1, 1] = 2 * camera.fx / camera.width, 2 * camera.fy / camera.height
    out[0, 2] = 1 - 2 * (camera.cx + left) / camera.width
    out[1, 2] = 2 * (camera.cy + top) / camera.height - 1
    out[2, 2], out[2, 3] = -(far + near) / (far - near), -2 * far * near / (far - near)
    out[3, 2] = -1
    return out


def _borrow_rows(vertices: np.ndarray) -> list[list[float]]:
    """Return vertices (V, 3) as a list of rows that every call uses again.

    createVisualShape leaks a reference to the list and to each row in it: 600 bytes a vertex, half a gigabyte for a
    rocky scene. Rows that are used again cost that memory once.
    """
    values = vertices.tolist()
    while len(_rows) < len(values):
        _rows.append([0.0, 0.0, 0.0])
    borrowed = _rows[: len(values)]
    for row, value in zip(borrowed, values):
        row[:] = value
    return borrowed


def _grid_tiles(grid: HeightGrid, keep: np.ndarray) -> list[BodyTile]:
    """Return blocks of the grid's cells; keep: (ny - 1, nx - 1) bool, the cells to show."""
    ny, nx = grid.heights.shape
    out = []
    for j, i in product(range(0, ny - 1, TILE_CELLS), range(0, nx - 1, TILE_CELLS)):
        kept = keep[j : j + TILE_CELLS, i : i + TILE_CELLS]
        if kept.any():
            heights = grid.heights[j : j + TILE_CELLS + 1, i : i + TILE_CELLS + 1]
            part = HeightGrid(heights, grid.x0 + i * grid.cell, grid.y0 + j * grid.cell, grid.cell)
            x0, y0, x1, y1 = part.bounds
            low, high = np.array([x0, y0, heights.min()]), np.array([x1, y1, heights.max()])
            out.append(BodyTile(low, high, grid=part, keep=kept))
    return out


def _rock_tiles(rocks: Rocks, half: float) -> list[BodyTile]:
    """Return tiles of rocks that lie together, each with at most as many rocks as the palette has colours."""
    if len(rocks) == 0:
        return []
    corner = rocks.vertices[rocks.faces].reshape(len(rocks.faces), 3, 3)
    start = np.searchsorted(rocks.face_rock, np.arange(len(rocks)))
    low = np.minimum.reduceat(corner.min(axis=1), start)
    high = np.maximum.reduceat(corner.max(axis=1), start)
    outside = (np.abs(rocks.centre[:, :2]).max(axis=1) > half).astype(int)
    cell = np.floor(rocks.centre[:, :2] / np.array(ROCK_TILE)[outside][:, None])
    order = np.lexsort((cell[:, 0], cell[:, 1], outside))
    key = np.column_stack([outside, cell])[order]
    border = np.flatnonzero(np.any(key[1:] != key[:-1], axis=1)) + 1
    out = []
    for a, b in pairwise([0, *border.tolist(), len(order)]):
        for first in range(a, b, PALETTE[0] * PALETTE[1]):
            members = order[first : min(b, first + PALETTE[0] * PALETTE[1])]
            out.append(BodyTile(low[members].min(axis=0), high[members].max(axis=0), rocks=members))
    return out
