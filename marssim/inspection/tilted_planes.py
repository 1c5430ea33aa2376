"""The image shift of a G-buffer maker on planes tilted in each axis, whose depth is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from marssim.base.camera import PinholeCamera, look_pose
from marssim.base.dataset.frame import GROUND
from marssim.inspection.agreement import ShiftFit, raw_depth
from marssim.render.renderers.renderer import Renderer
from marssim.scene.rocks import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

TILT_DEG = 15.0
AZIMUTHS_DEG = (0.0, 90.0, 180.0, 270.0)  # in which they rise: away from the camera, to its sides, towards it
PITCH_DEG = 35.0
FARTHEST = 6.0  # [m]; beyond, a pixel's depth says less of where it is


def plane_shift(
    make: Callable[[Scene], Renderer], camera: PinholeCamera, azimuths_deg: tuple[float, ...] = AZIMUTHS_DEG
) -> np.ndarray:
    """(2,) best-fit shift in u and v [px] of 1 / Z over all planes, NaN in both if they do not tell one of them.

    1 / Z = n . r / (n . p - n . eye) of a plane through p with normal n is linear in u and v.
    """
    fit = ShiftFit()
    for azimuth in np.deg2rad(azimuths_deg):
        tilt = np.tan(np.deg2rad(TILT_DEG)) * np.array([np.cos(azimuth), np.sin(azimuth)])
        pose = look_pose(np.array([0.0, 0.0, 1.2]), 0.0, np.deg2rad(PITCH_DEG))
        up = np.array([-tilt[0], -tilt[1], 1.0])
        inverse = (camera.rays() @ pose[:3, :3].T @ up) / -(pose[:3, 3] @ up)
        slope_u, slope_v = (pose[:3, :2].T @ up) / -(pose[:3, 3] @ up) / (camera.fx, camera.fy)
        maker = make(plane(tilt))
        try:
            depth, surface = raw_depth(maker, maker.render(camera, pose), camera, pose)
        finally:
            maker.close()
        where = (surface == GROUND) & (inverse > 1 / FARTHEST)
        fit.add(1 / np.where(where, depth, 1), partial(_beside, inverse, slope_u, slope_v), where)
    return fit.shift


def _beside(inverse: np.ndarray, slope_u: float, slope_v: float, du: float, dv: float) -> np.ndarray:
    return inverse + du * slope_u + dv * slope_v


def plane(tilt: np.ndarray) -> Scene:
    """A scene without rocks, z = tilt (2,) . (x, y)."""
    config = SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.0))
    scene = build_scene(config, np.random.default_rng(0))
    for grid in (scene.terrain.fine, scene.terrain.coarse):
        ny, nx = grid.heights.shape
        x, y = grid.x0 + np.arange(nx) * grid.cell, grid.y0 + np.arange(ny) * grid.cell
        grid.heights[:] = tilt[0] * x[None, :] + tilt[1] * y[:, None]
    return scene
