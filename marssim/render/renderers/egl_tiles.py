"""A scene in PyBullet's EGL renderer, which draws on a graphics card, or with Mesa's software driver.

It reads meshes from files only, and knows neither texture coordinates nor hidden bodies. So a tile is an STL file that
is read and deleted. The picture shows only the tile of each pixel; the depth determines which of its rocks it is
(raster.py). The renderer's memory holds just over a million triangles; of larger scenes, only the tiles in view are
loaded.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.engines.bullet import quiet
from marssim.engines.egl import load_plugin, load_triton_first, probe, write_stl
from marssim.render.renderers.bullet_tiles import BodyTile, BulletTiles, opengl_projection

WINDOW = (1024, 768)  # [px] largest width and height that the plugin draws; it would scale larger pictures
MOST_FACES = 1_200_000  # triangles in its buffer of 128 MiB; one takes 108 bytes
_in_use = [0]  # number of clients in this process: a second one would draw into the first one's window


class EglTiles(BulletTiles):
    """The tiles of a scene, drawn by EGL. `draw` distinguishes the ground and the tiles of rocks."""

    def close(self) -> None:
        """Disconnect from PyBullet, which frees the bodies and the window; a second call does nothing."""
        if self._client is not None:
            with quiet():
                super().close()
            _in_use[0] -= 1

    def group_of(self, surface: np.ndarray) -> np.ndarray:
        """Return the group of each surface (N,): GROUND, or the number of the rock's tile from 1."""
        tile_of = np.zeros(len(self._rocks) + 1, dtype=np.int32)
        for index, tile in enumerate(self._tiles):
            if tile.rocks is not None:
                tile_of[tile.rocks + 1] = GROUND + 1 + index
        return tile_of[surface]

    def _prepare(self) -> None:
        assert self._client is not None
        if _in_use[0]:
            self._pb.disconnect(self._client)
            raise RuntimeError("close the PyBulletRenderer that draws with EGL before you build another one")
        egl = probe()
        if not egl.works:
            self._pb.disconnect(self._client)
            raise OSError(f"PyBullet cannot draw with EGL here: {egl.message}")
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
        shown = np.full(len(self._tile_of_body) + 1, SKY, dtype=np.int32)  # index -1, the last one, is the sky
        for index, tile in enumerate(self._tile_of_body):
            shown[index] = GROUND if self._tiles[tile].rocks is None else GROUND + 1 + tile
        return np.asarray(depth, dtype=float).reshape(shape), shown[np.asarray(body).reshape(shape)]

    def _show(self, wanted: np.ndarray) -> None:
        """Load all tiles if there is room, else those that are wanted, always in the same order.

        The order decides which of two surfaces is drawn in a pixel where they cross.
        """
        if self._faces.sum() <= MOST_FACES:
            wanted = np.ones(len(self._tiles), dtype=bool)
        elif self._faces[wanted].sum() > MOST_FACES:
            raise ValueError(
                f"the view has {self._faces[wanted].sum()} triangles, more than the {MOST_FACES} that PyBullet's EGL "
                "renderer holds; draw it with TinyRenderer"
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
        """Return the corners (F, 3, 3) of a tile's triangles."""
        tile = self._tiles[index]
        if tile.rocks is None:
            assert tile.grid is not None
            vertices, faces = tile.grid.mesh(tile.keep)
        else:
            vertices, faces, _ = self._rock_mesh(tile.rocks)
        return vertices[faces]

    def _size(self, tile: BodyTile) -> int:
        """Return the number of a tile's triangles."""
        if tile.rocks is None:
            assert tile.keep is not None
            return 2 * int(tile.keep.sum())
        return int((self._face_start[tile.rocks + 1] - self._face_start[tile.rocks]).sum())
