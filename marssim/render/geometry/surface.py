"""The surface of a scene as rays see it: bodies, which are meshes, and the ground, which has relief down to pebbles.

Renderers find the faces that rays hit first, each in its own way; what a ray then sees is the same for all of them.
"""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled, read_only
from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.body_relief import body_relief, raise_hits
from marssim.render.geometry.cap import ground_cap
from marssim.render.geometry.gbuffer import Footprint, GBuffer, Hits
from marssim.render.geometry.hits import depths_of_faces, intersect_faces
from marssim.render.geometry.mesh import body_mesh
from marssim.render.relief.crossing import crossings
from marssim.render.relief.ground import ground_relief
from marssim.scene.scene import Scene

DARK = np.zeros(3)  # in place of the sun where no light is asked for


class SceneSurface:
    """The surface of a scene.

    Attributes:
        cap: Mesh above the ground's relief; a ray that hits none of it does not meet the ground.
        bodies: Mesh of what stands on the ground.
        ground: The ground's relief.
    """

    def __init__(self, scene: Scene) -> None:
        self.ground = ground_relief(scene)
        self.cap = ground_cap(scene, self.ground)
        self.bodies = body_mesh(scene)
        self._body_relief = body_relief(scene)
        self._sun = np.array(scene.look.sun, dtype=float)

    def hits(
        self, pose: np.ndarray, rays: np.ndarray, cap: np.ndarray, body: np.ndarray, footprint: Footprint, sunlit: bool,
        width: int = 0,
    ) -> Hits:  # fmt: skip
        """Return what rays of a camera see.

        Args:
            pose: (4, 4) camera to world.
            rays: (N, 3) directions, camera frame, z = 1.
            cap: (N,) face of the cap that each ray hits first, negative for none.
            body: (N,) face of the bodies that each ray hits first, negative for none.
            footprint: The camera that the relief is filtered for.
            sunlit: Find the share of sunlight that relief lets through; else it is 1.
            width: Pixels in a row if the rays are all those of an image, row by row, which is faster; 0 if not.
        """
        return self.hits_from(pose, rays, self.begins(pose, rays, cap), body, footprint, sunlit, width)

    def begins(self, pose: np.ndarray, rays: np.ndarray, cap: np.ndarray) -> np.ndarray:
        """Return the depths (N,) [m] before which rays meet no ground, given the faces (N,) of the cap as in `hits`."""
        return depths_of_faces(self.cap, pose, rays, cap)

    def hits_from(
        self, pose: np.ndarray, rays: np.ndarray, begin: np.ndarray, body: np.ndarray, footprint: Footprint,
        sunlit: bool, width: int = 0,
    ) -> Hits:  # fmt: skip
        """Return what rays see that do not meet the ground before depths `begin` (N,) [m]; else as `hits`."""
        hits = intersect_faces(self.bodies, pose, rays, body)
        if (body >= 0).any():
            raise_hits(
                self._body_relief, read_only(footprint.eye), footprint.focal, read_only(pose), read_only(rays), *hits
            )
        depth, normal, detail = crossings(
            self.ground[:4], read_only(footprint.eye), footprint.focal, read_only(pose), read_only(rays), begin,
            hits.depth, read_only(self._sun if sunlit else DARK), width,
        )  # fmt: skip
        _lay_over(*hits, depth, normal, detail, read_only(pose))
        return hits

    def view(
        self, camera: PinholeCamera, pose: np.ndarray, cap: np.ndarray, body: np.ndarray,
        footprint: Footprint | None, sunlit: bool,
    ) -> GBuffer:  # fmt: skip
        """Return the G-buffer of a view; cap, body: (H * W,) faces of its pixels, else as `hits`."""
        footprint = footprint or Footprint.from_camera(camera, pose)
        hits = self.hits(pose, camera.rays().reshape(-1, 3), cap, body, footprint, sunlit, camera.width)
        return GBuffer.of_hits(hits, (camera.height, camera.width))


@compiled
def _lay_over(depth, normal, shading, surface, detail, ground_depth, ground_normal, ground_detail, pose):
    """Write the ground's hits over those of the bodies where they are nearer."""
    for k in range(len(depth)):
        if not ground_depth[k] < depth[k]:
            continue
        depth[k], surface[k] = ground_depth[k], GROUND
        x, y, z = ground_normal[k, 0], ground_normal[k, 1], ground_normal[k, 2]
        shading[k, 0], shading[k, 1], shading[k, 2] = x, y, z
        for axis in range(3):
            normal[k, axis] = pose[0, axis] * x + pose[1, axis] * y + pose[2, axis] * z
        for n in range(4):
            detail[k, n] = ground_detail[k, n]
