"""Choice of the next motion: arcs near the rover that descend the distance field to the goal.

The arcs are checked with the rover's oriented footprint (free_length.py) and may enter only ground that has been seen.
As in ENav on Perseverance, the far path (distance_field.py) is cheap and optimistic, the near one exact and cautious.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.angle import wrapped
from marssim.base.rover_spec import RoverSpec
from nav.controller import tightest_radius
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability
from nav.path.candidates import COST_PARTS, Candidates
from nav.path.distance_field import DistanceField
from nav.path.footprint import arc_poses, footprint_distance, turn_poses
from nav.path.free_length import free_length, room_needed
from nav.path.planner_config import PlannerConfig
from nav.path.stance import StanceModel

HEADING_FREE = 1.0  # [m] from the goal, within which the heading does not matter
PROBE = 0.5  # [m] to either side, where the slope of the field is taken
CURVE_RESERVE = 0.02  # [m] by which the turning centre stays farther away than the steering needs
DISC_EXCESS = 0.1  # [m] by which the discs of footprint_discs may reach beyond the footprint


@dataclass(frozen=True)
class Motion:
    """A motion that the planner chose or considered."""

    curvature: float
    """Curvature [1/m], positive to the left."""
    turn: float
    """Heading change in place before the drive [rad], positive to the left; 0 for an arc."""
    length: float
    """Free length [m]."""
    cost: float
    """Cost to reach the goal over this motion [m]."""
    poses: np.ndarray
    """(k, 3) x, y [m], yaw [rad] in the world."""


class Planner:
    """Chooses the next motion on a map.

    Attributes:
        field: The cost to go to the goal.
        considered: The Candidates of the last plan, the chosen one among them; None before it.
    """

    def __init__(self, spec: RoverSpec, config: PlannerConfig, elevation: ElevationMap) -> None:
        self.spec, self.config = spec, config
        self.field = DistanceField(elevation, config.coarse, config.inflated_cost)
        self.margin = config.margin
        self.considered: Candidates | None = None
        self._stance: StanceModel | None = None
        self.previous_curvature = 0.0
        self.previous_turn = 0.0
        self._turned_back = 0  # turns back since the rover drove: each heading sees the other's way as the better one
        sharpest = min(1 / (tightest_radius(spec) + CURVE_RESERVE), spec.max_yaw_rate / spec.max_speed)
        grid = np.linspace(-1, 1, config.arcs)
        self._curvatures = sharpest * np.sign(grid) * np.abs(grid) ** 1.5
        self._distance = np.arange(0, config.arc_length + 1e-6, config.spacing)

    def reset(self) -> None:
        """Forget the previous motion."""
        self.previous_curvature = 0.0
        self.previous_turn = 0.0
        self._turned_back = 0

    def update(self, elevation: ElevationMap, ground: Traversability, goal: np.ndarray) -> None:
        """Take in a new map: compute the field to the goal, and the surface on which arcs are checked.

        Args:
            elevation: The map.
            ground: The judged ground.
            goal: (2,) goal in the world [m].
        """
        self.field.update(elevation, ground, goal)
        self._stance = StanceModel(elevation, self.spec)

    def free_length(self, poses: np.ndarray, elevation: ElevationMap, ground: Traversability) -> np.ndarray:
        """Return how far motions can be driven: (a,) [m].

        Args:
            poses: (a, k, 3) poses x, y [m], yaw [rad] of a motions, config.spacing apart.
            elevation: The map.
            ground: The judged ground.
        """
        return free_length(
            poses, self.config.spacing, elevation, ground, self.spec, self.config, self._stance, self.margin
        )

    def plan(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, goal: np.ndarray
    ) -> Motion | None:
        """Return the best motion from a pose, or None if no motion is free. Call `update` with the map first.

        Args:
            elevation: The map.
            ground: The judged ground.
            pose: (3,) x, y [m], yaw [rad].
            goal: (2,) goal in the world [m].
        """
        groups = [self._arcs(elevation, ground, pose, goal), self._turns(elevation, ground, pose, goal)]
        self.considered = Candidates.joined([candidates for candidates, _ in groups])
        motions = [motion for motion in (self._cheapest(*group) for group in groups) if motion]
        if not motions:
            return None
        best = min(motions, key=lambda motion: motion.cost)
        if best.turn * self.previous_turn < 0:
            self._turned_back += 1
        elif not best.turn:
            self._turned_back = 0
        self.previous_curvature, self.previous_turn = best.curvature, best.turn
        return best

    def _onward(self, poses: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the cost from each pose to the goal: the field there, and the turn into its downhill direction."""
        xy = poses[..., :2]
        value = self.field.at(xy)
        east, north = np.array([PROBE, 0.0]), np.array([0.0, PROBE])
        slope_x = self.field.at(xy + east) - self.field.at(xy - east)
        slope_y = self.field.at(xy + north) - self.field.at(xy - north)
        with np.errstate(invalid="ignore"):
            wanted = np.arctan2(-slope_y, -slope_x)
            error = np.abs(wrapped(wanted - poses[..., 2]))
        near_goal = np.hypot(*np.moveaxis(xy - goal[:2], -1, 0)) < HEADING_FREE
        return value, np.where(near_goal | ~np.isfinite(error), 0.0, self.config.heading_cost * error)

    def _rate(
        self, poses: np.ndarray, free: np.ndarray, elevation: ElevationMap, ground: Traversability, goal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return the cost of each motion (a,) when it is left at its best point, that point (a,) [m], and parts of the
        cost by name.

        Args:
            poses: (a, k, 3) poses of the motions.
            free: (a,) free lengths [m].
            elevation: The map.
            ground: The judged ground.
            goal: (2,) goal in the world [m].
        """
        c = self.config
        cell = np.clip(elevation.cell_of(poses[..., :2]), 0, elevation.n - 1)
        price = 1.0 + ground.cost[cell[..., 1], cell[..., 0]]
        driven = np.cumsum(price, axis=1) * c.spacing - price[:, :1] * c.spacing
        onward, heading = self._onward(poses, goal)
        total = driven + (onward + heading)
        s = self._distance[None, : poses.shape[1]]
        usable = (s <= np.minimum(free, c.lookahead)[:, None] + 1e-6) & (
            s >= np.minimum(c.commit, free)[:, None] - 1e-6
        )
        total = np.where(usable & (free >= c.commit - 1e-6)[:, None], total, np.inf)
        at = total.argmin(axis=1)
        best = np.arange(len(at)), at
        end = self._distance[at]
        parts = {"way": end, "ground": driven[best] - end, "onward": onward[best], "heading": heading[best]}
        return total[best], end, parts

    def _arcs(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, goal: np.ndarray
    ) -> tuple[Candidates, np.ndarray]:
        """Return the arcs, and their poses (a, k, 3)."""
        c = self.config
        curvature = self._curvatures
        poses = arc_poses(np.broadcast_to(pose, (curvature.size, 3)), curvature, self._distance)
        free = self.free_length(poses, elevation, ground)
        free = np.minimum(free, np.deg2rad(c.max_turn_deg) / np.maximum(np.abs(curvature), 1e-6))
        cost, end, parts = self._rate(poses, free, elevation, ground, goal)
        parts["bend"] = c.bend_cost * np.abs(curvature) * end
        parts["change"] = c.change_cost * np.abs(curvature - self.previous_curvature)
        cost += parts["bend"]
        cost += parts["change"]
        return _candidates(curvature, np.zeros_like(curvature), free, end, cost, parts), poses

    def _turns(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, goal: np.ndarray
    ) -> tuple[Candidates, np.ndarray]:
        """Return the turns in place that touch nothing, and the poses (a, k, 3) of the drive after each."""
        c = self.config
        turn = self.free_turns(elevation, ground, pose)
        poses = arc_poses(turn_poses(pose, turn), np.zeros(turn.size), self._distance)
        if turn.size == 0:
            none = np.zeros(0)
            return _candidates(none, none, none, none, none, {}), poses
        free = self.free_length(poses, elevation, ground)
        cost, end, parts = self._rate(poses, free, elevation, ground, goal)
        same_way = np.sign(turn) * np.sign(self.previous_turn)
        parts["turn"] = c.turn_cost * np.abs(turn) + np.choose(
            same_way.astype(int) + 1,
            [c.turn_start_cost + c.turn_back_cost * 2**self._turned_back, c.turn_start_cost, 0.0],
        )
        parts["unseen"] = c.turn_dark_cost * self._into_the_dark(elevation, ground, pose, turn)
        cost += parts["turn"]
        cost += parts["unseen"]
        return _candidates(np.zeros_like(turn), turn, free, end, cost, parts), poses

    def _cheapest(self, candidates: Candidates, poses: np.ndarray) -> Motion | None:
        """Return the candidate of least cost, None if none is free; poses: (a, k, 3) of all."""
        c = candidates
        if not np.isfinite(c.cost).any():
            return None
        i = int(c.cost.argmin())
        stop = round(c.free[i] / self.config.spacing) + 1
        return Motion(float(c.curvature[i]), float(c.turn[i]), float(c.free[i]), float(c.cost[i]), poses[i, :stop])

    def _into_the_dark(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, turns: np.ndarray
    ) -> np.ndarray:
        """Return whether turns in place (t,) [rad] lay the footprint on unseen ground that the rover does not stand on:
        (t,) bool.

        The mast cannot show the ground beside the wheels: a rock there is only known if it was seen before.
        """
        step = 2 * np.pi / self.config.turns
        swept = turns[:, None] * np.linspace(0, 1, max(2, round(float(np.abs(turns).max()) / step) + 1))
        dark_room = footprint_distance(ground.dark_distance, elevation, turn_poses(pose, swept), self.spec)
        return np.asarray(dark_room.min(axis=1) < np.minimum(dark_room[:, 0], 0.0) - DISC_EXCESS)

    def free_turns(self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray) -> np.ndarray:
        """Return the heading changes in place [rad] during which the footprint touches nothing, without 0.

        Unseen obstacles are assumed not to exist: the rover has driven past the ground beside it.

        Args:
            elevation: The map.
            ground: The judged ground.
            pose: (3,) x, y [m], yaw [rad].
        """
        c = self.config
        step = 2 * np.pi / c.turns
        out = []
        for side in (1, -1):
            angle = side * step * np.arange(c.turns // 2 + 1)
            # Between two checked headings a corner moves by 0.14 m at most, which margin and discs cover.
            room = footprint_distance(ground.clearance, elevation, turn_poses(pose, angle), self.spec)
            ok = room >= room_needed(room[0], self.margin, elevation.config.cell)
            ok[0] = True
            out.append(angle[: np.cumprod(ok).sum()][1:])
        return np.concatenate(out)


def _candidates(
    curvature: np.ndarray,
    turn: np.ndarray,
    free: np.ndarray,
    end: np.ndarray,
    cost: np.ndarray,
    parts: dict[str, np.ndarray],
) -> Candidates:
    """Return candidates; parts that are not given cost nothing."""
    nothing = np.zeros_like(cost)
    return Candidates(curvature, turn, free, end, cost, {name: parts.get(name, nothing) for name in COST_PARTS})
