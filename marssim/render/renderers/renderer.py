"""The protocol that every renderer of a scene fulfils."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.render.geometry.gbuffer import GBuffer, Hits


class Renderer(Protocol):
    """Renders one Scene. `close` frees what the renderer holds and may be called twice."""

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """Return the G-buffer of one view.

        Args:
            camera: The camera; one ray passes through the centre of each pixel.
            pose: (4, 4) camera to world.
        """

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which surface points the centre of the sun reaches.

        Args:
            points: (N, 3) surface points [m], world frame.
            normals: (N, 3) unit normals of their faces, world frame. Rays start a little off the face along them.

        Returns:
            (N,) bool.
        """

    def visible_from(self, points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """Return which surface points have a free straight line to the eye.

        Args:
            points: (N, 3) surface points [m], world frame.
            normals: (N, 3) unit normals of their faces, world frame.
            eye: (3,) position [m], world frame.

        Returns:
            (N,) bool.
        """

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> Hits:
        """Return what rays of a camera hit; they need not pass through pixel centres.

        Args:
            rays: (N, 3) directions, camera frame, scaled to z = 1.
            pose: (4, 4) camera to world.
        """

    def close(self) -> None:
        """Free what the renderer holds."""
