"""The Embree renderer: one ray through each pixel centre."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.pose import rotate
from marssim.engines.embree import TriangleRays
from marssim.render.geometry.gbuffer import Footprint, GBuffer, Hits
from marssim.render.geometry.hits import intersect_faces
from marssim.render.geometry.mesh import Mesh
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
        face = self._rays.meet(pose[None, :3, 3], world_directions(rays, pose))[0]
        return intersect_faces(self._mesh, pose, rays, face)

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


class EmbreeRenderer(RayQueries):
    """Renders a Scene with Embree's ray casting. Fulfils `Renderer` and needs no PyBullet.

    Raises:
        ImportError: embreex is not installed, or its Embree does not work here.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._cap = TriangleRays(self._surface.cap.vertices, self._surface.cap.faces)
        bodies = self._surface.bodies
        self._bodies = TriangleRays(bodies.vertices, bodies.faces) if len(bodies.faces) else None

    def render(
        self, camera: PinholeCamera, pose: np.ndarray, footprint: Footprint | None = None, sunlit: bool = True
    ) -> GBuffer:
        """Return the G-buffer of one view; see `Renderer.render`."""
        surface = self._open_surface()
        rays = camera.rays().reshape(-1, 3)
        cap, body = self._cap_faces(rays, pose), self._body_faces(rays, pose)
        return surface.view(camera, pose, cap, body, footprint, sunlit)

    def close(self) -> None:
        """Free the acceleration structures; a second call does nothing."""
        self._cap.close()
        if self._bodies is not None:
            self._bodies.close()
        super().close()

    def _cap_faces(self, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
        return self._cap.meet(pose[None, :3, 3], world_directions(rays, pose))[0]

    def _body_faces(self, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
        if self._bodies is None:
            return np.full(len(rays), -1, dtype=np.int32)
        return self._bodies.meet(pose[None, :3, 3], world_directions(rays, pose))[0]


def world_directions(rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return camera-frame rays (N, 3) in the world frame of pose (4, 4), float32, as Embree takes them.

    Embree only names the triangle; the point on it is computed in float64.
    """
    return rotate(rays.astype(np.float32), pose[:3, :3].astype(np.float32))


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
