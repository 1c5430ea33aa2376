"""The protocol that every renderer of a scene fulfils."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.render.geometry.gbuffer import Footprint, GBuffer, Hits


class Renderer(Protocol):
    """Renders one Scene. `close` frees what the renderer holds and may be called twice."""

    def render(
        self, camera: PinholeCamera, pose: np.ndarray, footprint: Footprint | None = None, sunlit: bool = True
    ) -> GBuffer:
        """Return the G-buffer of one view.

        Args:
            camera: The camera; one ray passes through the centre of each pixel.
            pose: (4, 4) camera to world.
            footprint: The camera that the ground's relief is filtered for; None for this one.
            sunlit: Find the share of sunlight that the relief lets through, which shading needs.
        """

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which surface points the centre of the sun reaches.

        Args:
            points: (N, 3) surface points [m], world frame.
            normals: (N, 3) unit normals of their faces, world frame. Rays start a little off the face along them.

        Returns:
            (N,) bool.
        """

    def shadow_distance(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return how far away what hides the sun's centre is from surface points.

        Args:
            points: (N, 3) surface points [m], as of `lit`.
            normals: (N, 3) unit normals of their faces, as of `lit`.

        Returns:
            (N,) float32 [m]; inf where nothing hides it, 0 where the face is turned away from the sun.
        """

    def sun_share(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the share of the sun's disc that hills and rocks leave free over surface points.

        Args:
            points: (N, 3) surface points [m], as of `lit`.
            normals: (N, 3) unit normals of their faces, as of `lit`.

        Returns:
            (N,) float32, 0 to 1; 0 where the face is turned away from the sun.
        """

    def trace(
        self, rays: np.ndarray, pose: np.ndarray, footprint: Footprint, sunlit: bool = True,
        begin: np.ndarray | None = None,
    ) -> Hits:  # fmt: skip
        """Return what rays of a camera hit; they need not pass through pixel centres.

        Args:
            rays: (N, 3) directions, camera frame, scaled to z = 1.
            pose: (4, 4) camera to world.
            footprint: The camera that the ground's relief is filtered for.
            sunlit: As in `render`.
            begin: (N,) depths [m] before which the rays are known to meet no ground, which makes them faster; 0 where
                that is not known. None for no such knowledge.
        """

    def trace_ground(
        self, rays: np.ndarray, pose: np.ndarray, begin: np.ndarray, footprint: Footprint, sunlit: bool = True
    ) -> Hits:
        """Return where rays that are known to meet the ground do so, which is faster than `trace`.

        Args:
            rays: (N, 3) directions, camera frame, scaled to z = 1.
            pose: (4, 4) camera to world.
            begin: (N,) depths before which they meet nothing [m].
            footprint: The camera that the ground's relief is filtered for.
            sunlit: As in `render`.
        """

    def close(self) -> None:
        """Free what the renderer holds."""
