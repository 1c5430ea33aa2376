"""A Scene in PyBullet's EGL renderer, which draws on a graphics card, or in Mesa's software where it is told to.

It takes meshes from files alone, and keeps neither texture coordinates nor what is hidden from it. So a tile is an STL
file that is read and deleted, its body is all that the picture tells of it, and which rock of the tile a pixel shows is
found by its depth (raster.py). Its memory holds a good million triangles; of larger scenes, those in view are drawn.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.engines.bullet import quiet
from marssim.engines.egl import load_plugin, load_triton_first, probe, write_stl
from marssim.render.renderers.bullet_tiles import BulletTiles, Tile, opengl_projection

WINDOW = (1024, 768)  # [px] width and height that the plugin draws at most; it would scale larger pictures
MOST_FACES = 1_200_000  # its buffer is 128 MiB, a triangle of an STL file takes 108 bytes
_in_use = [0]  # clients in this process: a second one would draw into the first one's window


class EglTiles(BulletTiles):
    """The tiles of a Scene, drawn by EGL. `draw` tells apart the ground and the tiles of rocks."""

    def close(self) -> None:
        """Disconnect from PyBullet, which frees the bodies and the window; may be called twice."""
        if self._client is not None:
            with quiet():
                super().close()
            _in_use[0] -= 1

    def group_of(self, surface: np.ndarray) -> np.ndarray:
        """GROUND, or the number of a rock's tile from 1, of surfaces (N,)."""
        tile_of = np.zeros(len(self._rocks) + 1, dtype=np.int32)
        for index, tile in enumerate(self._tiles):
            if tile.rocks is not None:
                tile_of[tile.rocks + 1] = GROUND + 1 + index
        return tile_of[surface]

    def _prepare(self) -> None:
        assert self._client is not None
        if _in_use[0]:
            self._pb.disconnect(self._client)
            raise RuntimeError("close the PyBulletRenderer that draws with EGL before another one is made")
        found = probe()
        if not found.works:
            self._pb.disconnect(self._client)
            raise OSError(f"PyBullet cannot draw with EGL here: {found.message}")
        load_triton_first()
        with quiet():
            loaded = load_plugin(self._pb, self._client)
        if not loaded:
            self._pb.disconnect(self._client)
            raise OSError("PyBullet cannot draw with EGL here: its plugin did not start")
        _in_use[0] += 1
        self._faces = np.array([self._size(tile) for tile in self._tiles])

    def _picture(
        self, camera: PinholeCamera, view: np.ndarray, near: float, far: float
    ) -> tuple[np.ndarray, np.ndarray]:
        shape = (camera.height, camera.width)
        depth, group = np.ones(shape), np.full(shape, SKY, dtype=np.int32)
        for top in range(0, camera.height, WINDOW[1]):
            for left in range(0, camera.width, WINDOW[0]):
                width, height = min(WINDOW[0], camera.width - left), min(WINDOW[1], camera.height - top)
                part = np.s_[top : top + height, left : left + width]
                depth[part], group[part] = self._part(camera.cropped(left, top, width, height), view, near, far)
        return depth, group

    def _part(self, camera: PinholeCamera, view: np.ndarray, near: float, far: float) -> tuple[np.ndarray, np.ndarray]:
        projection = opengl_projection(camera, near, far, 0.5, 0.5)
        self._show(self._inside(projection @ view))
        with quiet():
            _, _, _, depth, body = self._pb.getCameraImage(
                camera.width, camera.height, view.T.ravel().tolist(), projection.T.ravel().tolist(), shadow=0,
                renderer=self._pb.ER_BULLET_HARDWARE_OPENGL, physicsClientId=self._client,
            )  # fmt: skip
        shape = (camera.height, camera.width)
        shown = np.full(len(self._tile_of_body) + 1, SKY, dtype=np.int32)  # the last one is of -1, the sky
        for index, tile in enumerate(self._tile_of_body):
            shown[index] = GROUND if self._tiles[tile].rocks is None else GROUND + 1 + tile
        return np.asarray(depth, dtype=float).reshape(shape), shown[np.asarray(body).reshape(shape)]

    def _show(self, wanted: np.ndarray) -> None:
        """Hold all tiles if there is room, else those that are wanted: in their order, whatever was drawn before.

        Which of two surfaces that cross in a pixel is drawn there depends on the order.
        """
        if self._faces.sum() <= MOST_FACES:
            wanted = np.ones(len(self._tiles), dtype=bool)
        elif self._faces[wanted].sum() > MOST_FACES:
            raise ValueError(
                f"a view of {self._faces[wanted].sum()} triangles is more than the {MOST_FACES} that PyBullet's EGL "
                "renderer holds; its TinyRenderer draws it"
            )
        if np.array_equal(wanted, self._shown):
            return
        if self._tile_of_body:
            with quiet():
                self._pb.resetSimulation(physicsClientId=self._client)
            self._tile_of_body.clear()
        for tile in np.flatnonzero(wanted):
            self._add(int(tile))
        self._shown = wanted

    def _add(self, index: int) -> None:
        with tempfile.TemporaryDirectory() as folder, quiet():
            file = Path(folder) / "tile.stl"
            write_stl(file, self._corners_of(index))
            shape = self._pb.createVisualShape(self._pb.GEOM_MESH, fileName=str(file), physicsClientId=self._client)
            body = self._pb.createMultiBody(0, -1, shape, physicsClientId=self._client)
        assert body == len(self._tile_of_body)
        self._tile_of_body.append(index)

    def _corners_of(self, index: int) -> np.ndarray:
        """(F, 3, 3) of a tile's triangles."""
        tile = self._tiles[index]
        if tile.rocks is None:
            assert tile.grid is not None
            vertices, faces = tile.grid.mesh(tile.keep)
        else:
            vertices, faces, _ = self._rock_mesh(tile.rocks)
        return vertices[faces]

    def _size(self, tile: Tile) -> int:
        """Number of a tile's triangles."""
        if tile.rocks is None:
            assert tile.keep is not None
            return 2 * int(tile.keep.sum())
        return int((self._face_start[tile.rocks + 1] - self._face_start[tile.rocks]).sum())
