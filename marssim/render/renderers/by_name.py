"""The renderers by name. What each needs is imported when it is asked for, so that either can be missing."""

from __future__ import annotations

from typing import Literal, get_args

from marssim.render.geometry.gbuffer import GBufferMaker
from marssim.scene.scene import Scene

Renderer = Literal["pybullet", "embree", "scan"]
RENDERERS: tuple[Renderer, ...] = get_args(Renderer)


def known_renderer(name: str) -> Renderer:
    """The name, if it is one of RENDERERS. Raises ValueError that lists them if not."""
    for renderer in RENDERERS:
        if name == renderer:
            return renderer
    raise ValueError(f"renderer {name!r} is unknown; choose from {', '.join(RENDERERS)}")


def make_renderer(name: str, scene: Scene, egl: bool = False) -> GBufferMaker:
    """The G-buffer maker of a scene, by its name in RENDERERS. egl: let PyBullet draw with EGL, see Rasterizer.

    Raises ValueError for another name, ImportError, in a line, if what it needs is not installed, and OSError if EGL
    does not work.
    """
    known_renderer(name)
    if name == "embree":
        from marssim.render.renderers.embree_renderer import Raycaster

        return Raycaster(scene)
    if name == "scan":
        from marssim.render.renderers.scan_renderer import Scanner

        return Scanner(scene)
    from marssim.render.renderers.pybullet_renderer import Rasterizer

    return Rasterizer(scene, egl)
