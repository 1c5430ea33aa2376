"""The navigator with a true map of the whole course, which shows what drives lose by what is out of sight."""

from __future__ import annotations

import numpy as np

from envs.drivers.builtin import NavigatorDriver
from envs.mars_nav import MarsNavEnv
from marssim.base.camera import PinholeCamera
from marssim.base.pose import moved
from marssim.render.renderers.renderer import Renderer
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.navigator import Navigator

ABOVE = 150.0  # [m] height above the ground from which it is measured, so that rocks hide none of it
TILE = 200  # cells along a side of one of the views from there
BESIDE = 20  # cells beside them that a view shows too, so that none is left out where the ground is high
ACROSS = 3  # pixels along a side of a cell
CERTAIN = 1e9  # weight of the measured cells [1 / m2]: a look only raises what stands out, and lowers the ground


class OracleDriver(NavigatorDriver):
    """nav.Navigator, which knows the true heights of the whole course from the start, and is fed with the environment's
    depth beside them.

    A look raises the top of a cell, or lowers its ground, where it shows a higher or a lower point, and changes nothing
    else on the map. This driver is no competitor: it shows what the navigator reaches where nothing is out of sight.
    """

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        super().reset(env, seed)
        assert env.course is not None and env.perception.renderer is not None
        prior = true_map(env.perception.renderer, env.course.scene.half)
        self.navigator = Navigator(env.rover_spec, area=env.course.area, prior=prior)


def true_map(renderer: Renderer, half: float) -> ElevationMap:
    """Return the heights of ground and rocks of a scene, seen from high above, in the cells in which they lie.

    Args:
        renderer: Renderer of the scene.
        half: Half the side of the square that the map covers, around the origin [m].
    """
    cell = ElevationConfig().cell
    tiles = int(np.ceil(2 * half / (TILE * cell)))
    out = ElevationMap(ElevationConfig(size=tiles * TILE * cell))
    top, low = np.full(out.n * out.n, -np.inf), np.full(out.n * out.n, np.inf)
    pixels = (TILE + 2 * BESIDE) * ACROSS
    camera = PinholeCamera.centred(pixels, pixels, ABOVE * ACROSS / cell)
    rays = camera.rays()
    for row in range(tiles):
        for column in range(tiles):
            x, y = out.origin + TILE * cell * (np.array([column, row]) + 0.5)
            pose = np.array([[1, 0, 0, x], [0, -1, 0, y], [0, 0, -1, ABOVE], [0, 0, 0, 1.0]])
            depth = renderer.render(camera, pose, sunlit=False).depth.astype(float)
            valid = np.isfinite(depth)
            hits = moved(rays[valid] * depth[valid][:, None], pose)
            at = out.cell_of(hits[:, :2])
            inside = ((at >= 0) & (at < out.n)).all(axis=1)
            cells, heights = at[inside, 1] * out.n + at[inside, 0], hits[inside, 2]
            np.maximum.at(top, cells, heights)
            np.minimum.at(low, cells, heights)
    measured = np.isfinite(top).reshape(out.n, out.n)
    out.top[:] = np.where(measured, top.reshape(out.n, out.n), np.nan)
    out.low[:] = np.where(measured, low.reshape(out.n, out.n), np.nan)
    out.weight[measured] = CERTAIN
    return out
