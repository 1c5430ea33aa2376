"""The map around the rover as an observation: the navigator's knowledge, for a policy without memory."""

from __future__ import annotations

import numpy as np

from envs.courses.course import CLEAR_RADIUS
from envs.world.perception import Sight
from marssim.base.pose import planar_pose
from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.traversability import TraversabilityConfig, assess

PIXELS, CELL = 64, 0.2  # pixels along a side of the observed map, and their edge [m]: it is 12.8 m wide
REACH = PIXELS * CELL / np.sqrt(2)  # [m] from the rover to the map's corners
HEIGHT_LIMIT = 2.0  # [m] above or below the rover at which heights are clipped
COST_LIMIT = 8.0  # extra metres for a metre of ground at which the cost is clipped


class MapView:
    """Fuses looks as the navigator does, and cuts out a square around the rover with its heading up."""

    def __init__(self, spec: RoverSpec) -> None:
        self.spec = spec
        self.map = ElevationMap(ElevationConfig(size=24.0, recentre_at=REACH))  # so that the corners lie on it
        axis = (np.arange(PIXELS) + 0.5 - PIXELS / 2) * CELL
        left, ahead = np.meshgrid(-axis, -axis)
        self._ahead, self._left = ahead, left  # row 0 is the farthest ahead, column 0 the farthest to the left

    def start(self, pose: np.ndarray) -> None:
        """Forget everything; the start is clear all around. pose: (4, 4) believed pose, body to world."""
        self.map.clear(pose[:2, 3])
        self.map.assume_flat(pose, CLEAR_RADIUS)

    def update(self, sight: Sight | None, pose: np.ndarray) -> np.ndarray:
        """Take in a look from the believed pose and return the map.

        Args:
            sight: The look; None between two looks, where the map shows what is known.
            pose: (4, 4) believed pose, body to world.

        Returns:
            (3, 64, 64) float32. Channel 0: height above the rover / 2 m in [-1, 1], 0 where unknown. Channel 1: cost of
            driving in [0, 1], the largest of the map's cells in a pixel; 1 at obstacles. Channel 2: 1 where the ground
            was seen or is assumed to be flat (about the start, and under the rover), else 0.
        """
        self.map.recentre(pose[:2, 3])
        self.map.assume_under(pose, self.spec.length, self.spec.width)
        if sight is not None:
            eye = pose @ self.spec.mount.left_eye(sight.rig.baseline, sight.pan)
            self.map.integrate(sight.depth, sight.confidence, sight.rig, eye, self.spec.mount.height)
        ground = assess(self.map, self.spec, TraversabilityConfig())
        yaw = planar_pose(pose)[2]
        c, s = np.cos(yaw), np.sin(yaw)
        xy = np.stack(
            [pose[0, 3] + c * self._ahead - s * self._left, pose[1, 3] + s * self._ahead + c * self._left], -1
        )
        x, y = np.moveaxis(self.map.cell_of(xy), -1, 0)
        top = self.map.top[y, x]
        measured = np.isfinite(top)
        height = np.clip((np.where(measured, top, pose[2, 3]) - pose[2, 3]) / HEIGHT_LIMIT, -1, 1)
        cost = np.where(ground.blocked, 1.0, np.clip(ground.cost / COST_LIMIT, 0, 1))
        return np.stack([height, self._largest(cost, pose), measured]).astype(np.float32)

    def _largest(self, cost: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the largest value (64, 64) of the map's cells (n, n) whose middles lie in each pixel."""
        x, y = np.meshgrid(*(middle - at for middle, at in zip(self.map.centres(), pose[:2, 3], strict=True)))
        c, s = pose[:2, 0] / np.hypot(*pose[:2, 0])
        ahead, left = c * x + s * y, c * y - s * x
        row, column = (np.floor(PIXELS / 2 - along / CELL).astype(int) for along in (ahead, left))
        inside = (row >= 0) & (row < PIXELS) & (column >= 0) & (column < PIXELS)
        out = np.zeros((PIXELS, PIXELS))  # a pixel of 0.2 m holds the middle of a cell of 0.1 m, however it is turned
        np.maximum.at(out, (row[inside], column[inside]), cost[inside])
        return out
