"""The renderers by name.

A renderer's library is imported when that renderer is built, so that PyBullet or Embree may be missing.
"""

from __future__ import annotations

from typing import Literal, get_args

from marssim.engines.bullet import pybullet_is_installed
from marssim.render.renderers.renderer import Renderer
from marssim.scene.scene import Scene

RendererName = Literal["pybullet", "embree", "scan"]
RENDERERS: tuple[RendererName, ...] = get_args(RendererName)
FALLBACK_NOTE = "PyBullet is not installed here, so the renderer is scan"  # what a command prints when it falls back


def checked_renderer_name(name: str) -> RendererName:
    """Return the name unchanged if it is one of RENDERERS.

    Raises:
        ValueError: There is no renderer of that name. The message lists those that there are.
    """
    for renderer in RENDERERS:
        if name == renderer:
            return renderer
    raise ValueError(f"renderer {name!r} is unknown; choose from {', '.join(RENDERERS)}")


def default_renderer() -> RendererName:
    """Return the default renderer: "pybullet" where PyBullet is installed, else "scan".

    Scan conversion needs no library and shows what PyBullet shows, except for a few pixels on silhouettes. A command
    that falls back prints FALLBACK_NOTE.
    """
    return "pybullet" if pybullet_is_installed() else "scan"


def make_renderer(name: str, scene: Scene, egl: bool = False) -> Renderer:
    """Return the renderer of that name for a scene.

    Args:
        name: One of RENDERERS.
        scene: The scene to render. Its sun is fixed: another sun needs another renderer.
        egl: Let PyBullet draw with EGL, see PyBulletRenderer. The other renderers ignore it.

    Raises:
        ValueError: There is no renderer of that name.
        ImportError: The renderer's library is not installed. The message is one line.
        OSError: EGL does not work here.
    """
    checked_renderer_name(name)
    if name == "embree":
        from marssim.render.renderers.embree_renderer import EmbreeRenderer

        return EmbreeRenderer(scene)
    if name == "scan":
        from marssim.render.renderers.scan_renderer import ScanRenderer

        return ScanRenderer(scene)
    from marssim.render.renderers.pybullet_renderer import PyBulletRenderer

    return PyBulletRenderer(scene, egl)
