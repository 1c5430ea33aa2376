"""The G-buffer by ray casting with Embree: one ray through each pixel centre."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.camera import PinholeCamera, rotate
from marssim.engines.embree import TriangleRays
from marssim.render.geometry.gbuffer import GBuffer, Hits
from marssim.render.geometry.hits import hits, seen
from marssim.render.geometry.mesh import Mesh, scene_mesh
from marssim.render.geometry.visibility import SELF_GAP, SeesByRays
from marssim.scene.scene import Scene


class MeshCaster:
    """Rays against triangle meshes."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self._mesh = _joined([mesh for mesh in meshes if len(mesh.faces)])
        self._rays = TriangleRays(self._mesh.vertices, self._mesh.faces)

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> Hits:
        """What any rays of a camera meet. rays: (N, 3) camera frame, scaled to z = 1; pose: (4, 4) camera to world."""
        return hits(self._mesh, pose, rays, self._first_faces(rays, pose))

    def free(
        self, points: np.ndarray, normals: np.ndarray, directions: np.ndarray, reach: np.ndarray | None
    ) -> np.ndarray:
        """(N,) bool: nothing stands on the way from surface points.

        points, normals, directions: (N, 3), world; directions of unit length; reach: (N,) [m], None for any distance.
        """
        if len(points) == 0:
            return np.zeros(0, dtype=bool)
        return self._rays.meet(points + SELF_GAP * normals, directions, reach)[0] < 0

    def close(self) -> None:
        """Free the acceleration structure; may be called twice."""
        self._rays.close()

    def _first_faces(self, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """(N,) int32 the face that each ray meets first, negative for none; arguments as of trace."""
        world_rays = rotate(rays.astype(np.float32), pose[:3, :3].astype(np.float32))
        # Embree works in float32 and only names the triangle; where the ray meets it is computed in float64
        return self._rays.meet(pose[None, :3, 3], world_rays)[0]


class Raycaster(MeshCaster, SeesByRays):
    """Renders a Scene with Embree. Implements GBufferMaker; needs no PyBullet."""

    def __init__(self, scene: Scene) -> None:
        mesh = scene_mesh(scene)
        MeshCaster.__init__(self, [mesh])
        SeesByRays.__init__(self, mesh, scene.look.sun)
        self.scene = scene

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees; see GBuffer. pose: (4, 4) camera to world."""
        return seen(self._seer().mesh, camera, pose, self._first_faces(camera.rays().reshape(-1, 3), pose))

    def close(self) -> None:
        """Free the acceleration structure; may be called twice."""
        MeshCaster.close(self)
        SeesByRays.close(self)


def _joined(meshes: Sequence[Mesh]) -> Mesh:
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float64, copy=False),
        faces=np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts)]).astype(np.int32, copy=False),
        surface=np.concatenate([mesh.surface for mesh in meshes]),
        vertex_normals=np.concatenate([mesh.vertex_normals for mesh in meshes]).astype(np.float32, copy=False),
    )
