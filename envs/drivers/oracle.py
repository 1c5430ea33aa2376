"""The navigator with a true map of the whole course, which shows what drives lose by what is out of sight."""

from __future__ import annotations

import numpy as np

from envs.drivers.builtin import NavigatorDriver
from envs.mars_nav import MarsNavEnv
from marssim.base.camera import PinholeCamera
from marssim.render.renderers.renderer import Renderer
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.navigator import Navigator

ABOVE = 150.0  # [m] height above the ground from which it is measured, so that rocks hide none of it
TILE = 200  # cells along a side of one of the views from there
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
    """Return the heights of ground and rocks of a scene, as seen vertically from above.

    Args:
        renderer: Renderer of the scene.
        half: Half the side of the square that the map covers, around the origin [m].
    """
    cell = ElevationConfig().cell
    tiles = int(np.ceil(2 * half / (TILE * cell)))
    out = ElevationMap(ElevationConfig(size=tiles * TILE * cell))
    pixels = TILE * ACROSS
    # pixels are centred in their parts of a cell at the height of the origin, which is near that of the ground
    camera = PinholeCamera.centred(pixels, pixels, ABOVE * ACROSS / cell)
    for row in range(tiles):
        for column in range(tiles):
            x, y = out.origin + TILE * cell * (np.array([column, row]) + 0.5)
            pose = np.array([[1, 0, 0, x], [0, -1, 0, y], [0, 0, -1, ABOVE], [0, 0, 0, 1.0]])
            depth = renderer.render(camera, pose, sunlit=False).depth
            heights = (ABOVE - depth)[::-1].reshape(TILE, ACROSS, TILE, ACROSS)  # rows run north
            at = np.s_[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
            out.top[at], out.low[at] = heights.max(axis=(1, 3)), heights.min(axis=(1, 3))
    seen = np.isfinite(out.top) & np.isfinite(out.low)
    out.top[~seen] = out.low[~seen] = np.nan
    out.weight[seen] = CERTAIN
    return out
