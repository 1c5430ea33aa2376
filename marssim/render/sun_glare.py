"""Veiling glare of the sun: sunlight on the lens from outside the view, a part of which is scattered into the image.

Around a source, eyes and lenses scatter light that falls with about the square of the angle (the law of Stiles and
Holladay for eyes; power laws in Talvala, Adams, Horowitz and Levoy, "Veiling glare in high dynamic range imaging", ACM
Trans. Graph. 26, 2007). So the whole image gets a veil, which is stronger on the side of the sun, and has no shadows.
It has the colour of the sunlight and grows with the light that the lens's front catches. It is zero when the sun is
behind the camera or a hill.

What this leaves out: reflections between the surfaces of the lenses (ghosts), and a hood, whose shadow on the lens
depends on its shape.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy

from marssim.base.camera import PinholeCamera
from marssim.render.renderers.renderer import Renderer
from marssim.render.surfaces.daylight import Daylight

CORE = float(np.deg2rad(1.0))  # [rad] angle from the sun within which the scattered light no longer grows


def sun_glare(renderer: Renderer, light: Daylight, camera: PinholeCamera, pose: np.ndarray, share: float) -> np.ndarray:
    """Return the radiance that the sun adds to an image by scattering in the lens.

    Args:
        renderer: Renderer of the scene, which knows what hides the sun from the camera.
        light: Light of the scene.
        camera: The camera.
        pose: (4, 4) camera to world.
        share: Share of the sunlight on the lens that is scattered, 0 to 1.

    Returns:
        (H, W, 3) float32 linear RGB in the unit of `radiance` (marssim.render.stereo).
    """
    sun: np.ndarray = pose[:3, :3].T @ light.sun
    free = float(renderer.sun_share(pose[None, :3, 3], light.sun[None])[0]) if sun[2] > 0 else 0.0
    if free == 0:
        return np.zeros((camera.height, camera.width, 3), dtype=np.float32)
    rays = camera.rays()
    towards_sun = (rays @ sun) / np.linalg.norm(rays, axis=-1)
    angle = np.arccos(np.clip(towards_sun, -1, 1))
    # light on a surface is pi times the radiance of a white one under it
    scattered = share * free * sun[2] * np.pi * per_steradian() / (angle**2 + CORE**2)
    veil: np.ndarray = scattered[..., None].astype(np.float32) * light.sunlight
    return veil


@cache
def per_steradian() -> float:
    """Return the factor with which all that is scattered over a half space adds up to 1 [1/sr]."""
    half_space, _ = scipy.integrate.quad(lambda angle: np.sin(angle) / (angle**2 + CORE**2), 0, np.pi / 2)
    return 1 / (2 * np.pi * half_space)
