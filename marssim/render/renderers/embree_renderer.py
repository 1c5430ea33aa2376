"""The Embree renderer: one ray through each pixel centre."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.pose import rotate
from marssim.engines.embree import TriangleRays
from marssim.render.geometry.gbuffer import GBuffer, Hits
from marssim.render.geometry.hits import gbuffer_of_faces, intersect_faces
from marssim.render.geometry.mesh import Mesh, scene_mesh
from marssim.render.geometry.visibility import SELF_GAP, RayQueries
from marssim.scene.scene import Scene


class MeshTracer:
    """Traces rays through triangle meshes with Embree. Meshes without faces are ignored."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self._mesh = _joined([mesh for mesh in meshes if len(mesh.faces)])
        self._rays = TriangleRays(self._mesh.vertices, self._mesh.faces)

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> Hits:
        """Return what rays of a camera hit; see `Renderer.trace`.

        Args:
            rays: (N, 3) directions, camera frame, scaled to z = 1.
            pose: (4, 4) camera to world.
        """
        return intersect_faces(self._mesh, pose, rays, self._first_faces(rays, pose))

    def free(
        self, points: np.ndarray, normals: np.ndarray, directions: np.ndarray, reach: np.ndarray | None
    ) -> np.ndarray:
        """Return which rays from surface points hit nothing.

        Args:
            points: (N, 3) surface points [m], world frame.
            normals: (N, 3) unit normals of their faces, world frame.
            directions: (N, 3) unit vectors, world frame.
            reach: (N,) length of each ray [m]; None for no limit.

        Returns:
            (N,) bool.
        """
        if len(points) == 0:
            return np.zeros(0, dtype=bool)
        return self._rays.meet(points + SELF_GAP * normals, directions, reach)[0] < 0

    def close(self) -> None:
        """Free the acceleration structure; a second call does nothing."""
        self._rays.close()

    def _first_faces(self, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return (N,) int32: the face that each ray hits first, negative for none. The arguments are those of trace."""
        world_rays = rotate(rays.astype(np.float32), pose[:3, :3].astype(np.float32))
        # Embree works in float32 and only names the triangle; the point on it is computed in float64
        return self._rays.meet(pose[None, :3, 3], world_rays)[0]


class EmbreeRenderer(MeshTracer, RayQueries):
    """Renders a Scene with Embree's ray casting. Fulfils `Renderer` and needs no PyBullet.

    Raises:
        ImportError: embreex is not installed, or its Embree does not work here.
    """

    def __init__(self, scene: Scene) -> None:
        mesh = scene_mesh(scene)
        MeshTracer.__init__(self, [mesh])
        RayQueries.__init__(self, mesh, scene.look.sun)
        self.scene = scene

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """Return the G-buffer of one view. pose: (4, 4) camera to world."""
        faces = self._first_faces(camera.rays().reshape(-1, 3), pose)
        return gbuffer_of_faces(self._open_visibility().mesh, camera, pose, faces)

    def close(self) -> None:
        """Free the acceleration structure; a second call does nothing."""
        MeshTracer.close(self)
        RayQueries.close(self)


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
