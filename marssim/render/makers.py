"""The renderers by name. What each needs is imported when it is asked for, so that either can be missing."""

from __future__ import annotations

from marssim.render.gbuffer import GBufferMaker
from marssim.scene.scene import Scene


def make_renderer(name: str, scene: Scene) -> GBufferMaker:
    """The G-buffer maker "pybullet" or "embree" of a scene. Raises ImportError, in a line, if it is not installed."""
    if name == "embree":
        from marssim.render.raycast import Raycaster

        return Raycaster(scene)
    from marssim.render.rasterize import Rasterizer

    return Rasterizer(scene)
