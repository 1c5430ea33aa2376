"""A renderer of a scene with the rover that carries the cameras."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.pose import rotate
from marssim.render.geometry.gbuffer import Footprint, GBuffer, Hits
from marssim.render.geometry.hits import intersect_faces
from marssim.render.geometry.raster import first_faces
from marssim.render.geometry.scan import first_faces_of_rays
from marssim.render.geometry.visibility import Visibility
from marssim.render.own_rover.body import RoverBody
from marssim.render.own_rover.materials import albedo
from marssim.render.renderers.renderer import Renderer


class WithRover:
    """Adds the rover to what another renderer shows of the scene, and to its shadows. Fulfils `Renderer`.

    The rover's hits are those of its triangles, by the same scan conversion for all renderers. Closing it does not
    close the other renderer.

    Args:
        renderer: Renderer of the scene.
        body: The rover.
        sun: (3,) unit vector towards the sun.
    """

    def __init__(self, renderer: Renderer, body: RoverBody, sun: np.ndarray) -> None:
        self._scene = renderer
        self._body = body
        self._shadow = Visibility(body.mesh, sun)

    def render(
        self, camera: PinholeCamera, pose: np.ndarray, footprint: Footprint | None = None, sunlit: bool = True
    ) -> GBuffer:
        """Return the G-buffer of one view; see `Renderer.render`."""
        view = self._scene.render(camera, pose, footprint, sunlit)
        face = first_faces(self._body.mesh, camera, pose)
        hits = self._laid_over(view.pixels, camera.rays().reshape(-1, 3), pose, face, float(camera.fx))
        return GBuffer.of_hits(hits, view.depth.shape)

    def trace(
        self, rays: np.ndarray, pose: np.ndarray, footprint: Footprint, sunlit: bool = True,
        begin: np.ndarray | None = None,
    ) -> Hits:  # fmt: skip
        """Return what rays (N, 3) of z = 1 hit; see `Renderer.trace`."""
        hits = self._scene.trace(rays, pose, footprint, sunlit, begin)
        face = first_faces_of_rays(self._body.mesh, rays, pose)
        return self._laid_over(hits, rays, pose, face, footprint.focal)

    def trace_ground(
        self, rays: np.ndarray, pose: np.ndarray, begin: np.ndarray, footprint: Footprint, sunlit: bool = True
    ) -> Hits:
        """Return where rays that are known to meet the ground do so; see `Renderer.trace_ground`."""
        return self._scene.trace_ground(rays, pose, begin, footprint, sunlit)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which surface points the sun's centre reaches; see `Renderer.lit`."""
        return self._scene.lit(points, normals) & self._shadow.lit(points, normals)

    def shadow_distance(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return how far what hides the sun's centre is from surface points; see `Renderer.shadow_distance`."""
        return np.minimum(
            self._scene.shadow_distance(points, normals), self._shadow.shadow_distance(points, normals)
        )  # fmt: skip

    def sun_share(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the share of the sun's disc that surface points see; see `Renderer.sun_share`.

        Where both the scene and the rover hide a part of the disc, the parts count as independent.
        """
        return self._scene.sun_share(points, normals) * self._shadow.sun_share(points, normals)

    def close(self) -> None:
        """Do nothing: the renderer of the scene belongs to someone else."""

    def _laid_over(self, hits: Hits, rays: np.ndarray, pose: np.ndarray, face: np.ndarray, focal: float) -> Hits:
        """Return hits with those on faces of the rover (N,), negative for none, where they are nearer."""
        at = np.flatnonzero(face >= 0)
        rover = intersect_faces(self._body.mesh, pose, rays[at], face[at])
        near = rover.depth < hits.depth[at]
        at, rover = at[near], Hits(*(each[near] for each in rover))
        if len(at) == 0:
            return hits
        out = Hits(*(each.copy() for each in hits))
        points = pose[:3, 3] + rotate(rays[at], pose[:3, :3]) * rover.depth[:, None].astype(float)
        turn = np.ascontiguousarray(self._body.pose[:3, :3].T)
        rover.detail[:, :3] = albedo(
            self._body.material[face[at]], rotate(points - self._body.pose[:3, 3], turn),
            rotate(rover.shading_normal.astype(float), turn), rover.depth / focal,
        )  # fmt: skip
        for whole, part in zip(out, rover):
            whole[at] = part
        return out
