"""Measure the image shift of a renderer on tilted planes, whose depth has a closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.inspection.agreement import ShiftFit, raw_depth
from marssim.render.renderers.renderer import Renderer
from marssim.scene.look import LookConfig
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

TILT_DEG = 15.0  # tilt of each plane
AZIMUTHS_DEG = (0.0, 90.0, 180.0, 270.0)  # in which the planes rise: away from the camera, to its sides, towards it
# no fine relief and no stones
BARE = LookConfig(
    texture_strength=(0, 0), pebbles=(0, 0), wind_ripples=(0, 0), bedrock=(0, 0), gravel=(0, 0), drifts=(0, 0)
)  # fmt: skip
PITCH_DEG = 35.0  # pitch of the camera
FARTHEST = 6.0  # farthest ground that counts [m], since depth hardly determines the shift beyond


def plane_shift(
    make_renderer: Callable[[Scene], Renderer], camera: PinholeCamera, azimuths_deg: tuple[float, ...] = AZIMUTHS_DEG
) -> np.ndarray:
    """Fit the shift of a renderer's image of 1 / Z over all planes.

    On a plane through p with normal n, 1 / Z = n . r / (n . p - n . eye) is linear in u and v.

    Args:
        make_renderer: Makes the renderer of a scene.
        camera: The camera.
        azimuths_deg: Directions in which the planes rise [deg], counter-clockwise from east.

    Returns:
        (2,) shift in u and v [px]; NaN in both if the planes do not determine one of them.
    """
    fit = ShiftFit()
    for azimuth in np.deg2rad(azimuths_deg):
        tilt = np.tan(np.deg2rad(TILT_DEG)) * np.array([np.cos(azimuth), np.sin(azimuth)])
        pose = look_pose(np.array([0.0, 0.0, 1.2]), 0.0, np.deg2rad(PITCH_DEG))
        up = np.array([-tilt[0], -tilt[1], 1.0])
        inverse = (camera.rays() @ pose[:3, :3].T @ up) / -(pose[:3, 3] @ up)
        slope_u, slope_v = (pose[:3, :2].T @ up) / -(pose[:3, 3] @ up) / (camera.fx, camera.fy)
        renderer = make_renderer(plane(tilt))
        try:
            depth, surface = raw_depth(renderer, renderer.render(camera, pose), camera, pose)
        finally:
            renderer.close()
        where = (surface == GROUND) & (inverse > 1 / FARTHEST)
        fit.add(1 / np.where(where, depth, 1), partial(_beside, inverse, slope_u, slope_v), where)
    return fit.shift


def _beside(inverse: np.ndarray, slope_u: float, slope_v: float, du: float, dv: float) -> np.ndarray:
    """Return 1 / Z (H, W) of a plane (du, dv) [px] beside the pixel centres."""
    return inverse + du * slope_u + dv * slope_v


def plane(tilt: np.ndarray) -> Scene:
    """Return a scene without rocks, stones and fine relief whose ground is z = tilt (2,) . (x, y)."""
    config = SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.0), look=BARE)
    scene = build_scene(config, np.random.default_rng(0))
    for grid in (scene.terrain.fine, scene.terrain.coarse):
        ny, nx = grid.heights.shape
        x, y = grid.x0 + np.arange(nx) * grid.cell, grid.y0 + np.arange(ny) * grid.cell
        grid.heights[:] = tilt[0] * x[None, :] + tilt[1] * y[:, None]
    return scene
