"""The G-buffer by rasterising: PyBullet tells what each pixel sees, the geometry is then made exact."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled
from marssim.base.dataset.frame import SKY
from marssim.render.geometry.gbuffer import GBuffer
from marssim.render.geometry.hits import seen
from marssim.render.geometry.mesh import scene_mesh
from marssim.render.geometry.raster import matching_faces
from marssim.render.geometry.visibility import SeesByRays
from marssim.render.renderers.bullet_tiles import BulletTiles
from marssim.render.renderers.egl_tiles import EglTiles
from marssim.scene.scene import Scene

NEAR = 0.1  # [m] what is nearer to the camera is not drawn
SLIP = 0.01  # share of the depth by which the exact hit may differ from the depth buffer before it is not believed


class Rasterizer(SeesByRays):
    """Renders a Scene with PyBullet's `getCameraImage`. Implements GBufferMaker.

    PyBullet decides which surface each pixel shows and about how far away; depth and normals are those of the very
    triangle of that surface which the pixel's ray meets there. So what may differ from ray casting is which surface a
    pixel on a silhouette shows. Shadows, occlusion and sub-pixel samples are by rays (visibility.py).
    egl: draw with PyBullet's EGL renderer instead of TinyRenderer; one Rasterizer that does may be open in a process.
    Raises ImportError where PyBullet is not installed, and OSError where EGL does not work.
    """

    def __init__(self, scene: Scene, egl: bool = False) -> None:
        self.scene = scene
        self._tiles = EglTiles(scene) if egl else BulletTiles(scene)
        mesh = scene_mesh(scene)
        super().__init__(mesh, scene.look.sun)
        self._group = self._tiles.group_of(mesh.surface)

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees; see GBuffer. pose: (4, 4) camera to world. Nothing nearer than 0.1 m is seen."""
        mesh, shape = self._seer().mesh, (camera.height, camera.width)
        guess, group = self.drawn(camera, pose)
        face = matching_faces(mesh, self._group, camera, pose, guess, group)
        _lend_faces(face.reshape(shape), group)
        _nearest_faces(
            face, group.ravel(), camera.rays().reshape(-1, 3), pose, mesh.vertices, mesh.faces, self._group, mesh.start
        )
        view = seen(mesh, camera, pose, face)
        rough = guess.astype(np.float32)
        slipped = view.hit & ~(np.abs(view.depth - rough) < SLIP * rough)
        view.depth[slipped] = rough[slipped]
        return view

    def drawn(self, camera: PinholeCamera, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What PyBullet draws, before it is made exact: (H, W) float64 depth [m], arbitrary in the sky, and (H, W)
        int32 SKY, GROUND, or a number that stands for a rock or for several (BulletTiles.group_of)."""
        return self._tiles.draw(camera, pose, NEAR, self._farthest(pose[:3, 3]))

    def close(self) -> None:
        """Free the PyBullet world; may be called twice."""
        self._tiles.close()
        super().close()

    def _farthest(self, eye: np.ndarray) -> float:
        reach = np.maximum(np.abs(self._tiles.low - eye), np.abs(self._tiles.high - eye))
        return float(np.linalg.norm(reach)) + 1.0


@compiled
def _lend_faces(face, surface):
    """On silhouettes PyBullet may show a surface that the ray just misses: take the face of a neighbour on it.

    face, surface: (H, W); what PyBullet tells apart counts as a surface.
    """
    height, width = face.shape
    known = face.copy()
    for row in range(height):
        for column in range(width):
            if surface[row, column] == SKY or known[row, column] >= 0:
                continue
            for j in range(max(row - 1, 0), min(row + 2, height)):
                for i in range(max(column - 1, 0), min(column + 2, width)):
                    if known[j, i] >= 0 and surface[j, i] == surface[row, column]:
                        face[row, column] = known[j, i]


@compiled
def _nearest_faces(face, surface, rays, pose, vertices, faces, of_face, start):
    """Where no neighbour shows the surface either, the face of it whose middle lies nearest to the ray."""
    for k in range(len(face)):
        if surface[k] == SKY or face[k] >= 0:
            continue
        best = np.inf
        for piece in range(len(start) - 1):
            if of_face[start[piece]] != surface[k]:
                continue
            for f in range(start[piece], start[piece + 1]):
                x, y, z = 0.0, 0.0, 0.0
                for c in range(3):
                    v = faces[f, c]
                    px, py, pz = vertices[v, 0] - pose[0, 3], vertices[v, 1] - pose[1, 3], vertices[v, 2] - pose[2, 3]
                    x += pose[0, 0] * px + pose[1, 0] * py + pose[2, 0] * pz
                    y += pose[0, 1] * px + pose[1, 1] * py + pose[2, 1] * pz
                    z += pose[0, 2] * px + pose[1, 2] * py + pose[2, 2] * pz
                if z > 0:
                    off = (x / z - rays[k, 0]) ** 2 + (y / z - rays[k, 1]) ** 2
                    if off < best:
                        best = off
                        face[k] = f
