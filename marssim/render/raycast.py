"""The G-buffer by ray casting with Embree (embreex): one ray through each pixel centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from marssim.camera import PinholeCamera, rotate
from marssim.render.gbuffer import GROUND, ROCK_SMOOTHNESS, SKY, GBuffer, shading_normals
from marssim.scene.scene import Scene

SELF_GAP = 2e-3  # [m] secondary rays start this far off the surface, against hitting the face they leave


@dataclass(frozen=True)
class MeshPart:
    """vertices: (V, 3) float64, world [m]; faces: (F, 3); surface: (F,) int32 id of each face; vertex_normals: (V, 3),
    shorter than 1 where facets shall stay visible, 0 for flat shading."""

    vertices: np.ndarray
    faces: np.ndarray
    surface: np.ndarray
    vertex_normals: np.ndarray


class MeshCaster:
    """Rays against triangle meshes."""

    def __init__(self, parts: Sequence[MeshPart]) -> None:
        parts = [part for part in parts if len(part.faces)]
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        self._vertices = np.concatenate([part.vertices for part in parts])
        self._faces = np.concatenate([part.faces + start for part, start in zip(parts, starts)])
        self._surface = np.concatenate([part.surface for part in parts])
        self._vertex_normals = np.concatenate([part.vertex_normals for part in parts]).astype(np.float32)
        a, b, c = (self._vertices[self._faces[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        self._face_normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        self._face_offset = np.einsum("ij,ij->i", self._face_normal, a)  # of the triangle's plane from the origin
        self._embree: EmbreeScene | None = EmbreeScene()
        TriangleMesh(self._embree, self._vertices.astype(np.float32), self._faces.astype(np.int32))

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Depth, normal, shading normal and surface id along any rays of a camera.

        rays: (N, 3) camera frame, scaled to z = 1. pose: (4, 4) camera to world.
        Returns (N,), (N, 3), (N, 3), (N,) as GBuffer defines them.
        """
        rotation, eye = pose[:3, :3], pose[:3, 3]
        world_rays = rotate(rays, rotation)
        n = len(rays)
        origins = np.broadcast_to(eye.astype(np.float32), (n, 3))
        found = self._scene().run(np.ascontiguousarray(origins), world_rays.astype(np.float32), output=True)
        face = found["primID"]
        hit = np.flatnonzero(face >= 0)
        face = face[hit]
        face_normal = self._face_normal[face]
        # Embree works in float32; the plane of the triangle that it found gives the depth exactly
        slant = np.einsum("ij,ij->i", face_normal, world_rays[hit])
        flip = np.where(slant > 0, -1.0, 1.0)[:, None]
        grazing = np.abs(slant) < 1e-9
        z = (self._face_offset[face] - np.einsum("ij,j->i", face_normal, eye)) / np.where(grazing, 1, slant)
        z = np.where(grazing | ~(z > 0), found["tfar"][hit], z)

        depth = np.full(n, np.inf, dtype=np.float32)
        depth[hit] = z
        normal = np.zeros((n, 3), dtype=np.float32)
        normal[hit] = rotate(face_normal * flip, rotation.T)
        surface = np.full(n, SKY, dtype=np.int32)
        surface[hit] = self._surface[face]
        u, v = found["u"][hit, None], found["v"][hit, None]
        index = self._faces[face]
        face_normal = face_normal.astype(np.float32) * flip.astype(np.float32)
        smooth = self._vertex_normals
        blend = (1 - u - v) * smooth[index[:, 0]] + u * smooth[index[:, 1]] + v * smooth[index[:, 2]]
        shading = np.zeros((n, 3), dtype=np.float32)
        shading[hit] = shading_normals(blend, face_normal)
        return depth, normal, shading, surface

    def free(
        self, points: np.ndarray, normals: np.ndarray, directions: np.ndarray, reach: np.ndarray | None
    ) -> np.ndarray:
        """(N,) bool: nothing stands on the way from surface points.

        points, normals, directions: (N, 3), world; directions of unit length; reach: (N,) [m], None for any distance.
        """
        if len(points) == 0:
            return np.zeros(0, dtype=bool)
        origins = np.ascontiguousarray(points + SELF_GAP * normals, dtype=np.float32)
        limit = np.full(len(points), 1e9, np.float32) if reach is None else reach.astype(np.float32)
        found = self._scene().run(origins, np.ascontiguousarray(directions, dtype=np.float32), limit, query="OCCLUDED")
        return np.asarray(found) < 0

    def close(self) -> None:
        """Free the acceleration structure; may be called twice."""
        self._embree = None

    def _scene(self) -> EmbreeScene:
        if self._embree is None:
            raise RuntimeError("this Raycaster is closed")
        return self._embree


class Raycaster(MeshCaster):
    """Renders a Scene with Embree. Implements RayTracer; needs no PyBullet."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        (fine_v, fine_f), (coarse_v, coarse_f) = scene.terrain.meshes()
        ground = np.full(max(len(fine_f), len(coarse_f)), GROUND, dtype=np.int32)
        rocks = scene.rocks
        super().__init__(
            [
                MeshPart(fine_v, fine_f, ground[: len(fine_f)], scene.terrain.fine.vertex_normals()),
                MeshPart(coarse_v, coarse_f, ground[: len(coarse_f)], scene.terrain.coarse.vertex_normals()),
                MeshPart(rocks.vertices, rocks.faces, rocks.face_rock + 1, ROCK_SMOOTHNESS * rocks.vertex_normals),
            ]
        )

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees; see GBuffer. pose: (4, 4) camera to world."""
        shape = (camera.height, camera.width)
        depth, normal, shading, surface = self.trace(camera.rays().reshape(-1, 3), pose)
        return GBuffer(
            depth=depth.reshape(shape), normal=normal.reshape(*shape, 3), shading_normal=shading.reshape(*shape, 3),
            surface=surface.reshape(shape),
        )  # fmt: skip

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N,) bool: the sun's centre reaches these surface points; see GBufferMaker."""
        sun = np.broadcast_to(self.scene.look.sun, points.shape)
        facing = np.einsum("ij,j->i", normals, self.scene.look.sun) > 0
        out = np.zeros(len(points), dtype=bool)
        out[facing] = self.free(points[facing], normals[facing], sun[facing], None)
        return out

    def seen_from(self, points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(N,) bool: nothing stands between these surface points and the eye; see GBufferMaker."""
        towards = np.asarray(eye) - points
        distance = np.sqrt(np.einsum("ij,ij->i", towards, towards))
        facing = np.einsum("ij,ij->i", normals, towards) > 0
        out = np.zeros(len(points), dtype=bool)
        direction = towards[facing] / distance[facing, None]
        out[facing] = self.free(points[facing], normals[facing], direction, distance[facing])
        return out
