"""Where to go next: arcs near the rover that descend the distance field to the goal.

The arcs are checked with the rover's oriented footprint and may only enter what has been seen. As ENav does on
Perseverance, the far path (distance_field.py) is cheap and optimistic, the near one is exact and cautious.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability
from nav.path.distance_field import DistanceField
from nav.path.footprint import arc_poses, footprint_distance
from nav.path.stance import Standing

REPLANNED = 0.01  # [m] by which a rover within a margin may come nearer, from one plan to the next
REPLANNED_TILT = 0.02  # [rad] likewise
HALF_CELL = 0.05  # [m] of the map, by which it may err
HEADING_FREE = 1.0  # [m] from the goal the heading does not matter
PROBE = 0.5  # [m] to either side at which the field's slope is taken


@dataclass(frozen=True)
class PlannerConfig:
    """Candidate motions, and how they are compared. Costs are in metres of easy ground."""

    arcs: int = 31  # curvatures tried
    arc_length: float = 4.0  # [m]
    max_turn_deg: float = 100.0  # an arc ends after this much turning
    turns: int = 24  # headings tried by turning in place, then straight
    spacing: float = 0.2  # between poses checked on a motion [m]
    commit: float = 0.8  # a motion must be free at least this far [m]: one drive step and room to stop
    lookahead: float = 2.5  # motions are compared where they have come this far [m], or where they end
    margin: float = 0.08  # covered footprint (footprint_discs) to obstacle [m]
    dark_margin: float = 0.0  # footprint to unseen ground [m]
    tilt_limit_deg: float = 25.0  # of the chassis on its wheels; RoverSpec.max_tilt less a margin
    belly_margin: float = 0.05  # chassis to whatever is below it [m]
    turn_cost: float = 0.5  # a radian turned in place [m]
    turn_start_cost: float = 0.5  # stopping in order to turn [m]; not again while a turn goes on
    turn_back_cost: float = 1.0  # turning back at once [m]; twice as much each further time, until the rover drives
    turn_dark_cost: float = 4.0  # turning in place over ground that was not seen [m]: only where nothing else leads on
    bend_cost: float = 0.15  # a radian turned while driving [m]
    change_cost: float = 0.3  # departing from the previous curvature by 1 / m [m]
    heading_cost: float = 0.6  # a radian between the motion's end and the way onwards [m]
    coarse: int = 2  # map cells per cell of the distance field
    inflated_cost: float = 30.0  # per metre too near to an obstacle: a way out of it must exist, but never through


@dataclass(frozen=True)
class Motion:
    """One motion, chosen or considered.

    curvature [1/m], positive to the left; turn: heading change in place that comes first [rad], 0 for an arc; length:
    how far it is free [m]; cost: to the goal over this motion [m]; poses: (k, 3) x, y, yaw in the world.
    """

    curvature: float
    turn: float
    length: float
    cost: float
    poses: np.ndarray


def room_needed(room: np.ndarray, margin: float) -> np.ndarray:
    """How near to an obstacle a motion may come [m], of a rover that now has so much room: (...) [m] both.

    To the margin; a rover that stands within it comes at most REPLANNED nearer, lest it be stuck. That adds up over the
    plans, but ends where footprint and obstacle overlap by HALF_CELL.
    """
    return np.minimum(margin, np.maximum(room - REPLANNED, np.minimum(room, -HALF_CELL)))


def free_length(
    poses: np.ndarray,
    spacing: float,
    elevation: ElevationMap,
    ground: Traversability,
    spec: RoverSpec,
    config: PlannerConfig,
    standing: Standing | None = None,
    margin: float | None = None,
) -> np.ndarray:
    """How far motions are free of obstacles and of unseen ground, level enough and with room under the belly [m].

    poses: (a, k, 3), the first one where the rover stands. A rover that already stands within a margin may move as
    long as it comes no nearer. standing: the map's surface under wheels and belly; None asks neither. margin: in
    place of config's. Returns (a,) [m].
    """
    room = footprint_distance(ground.clearance, elevation, poses, spec)
    light = footprint_distance(ground.dark_distance, elevation, poses, spec)
    ok = room >= room_needed(room[:, :1], config.margin if margin is None else margin)
    ok &= light >= np.minimum(config.dark_margin, light[:, :1] - REPLANNED)
    if standing is not None:
        place = standing.at(poses)
        ok &= place.tilt <= np.maximum(np.deg2rad(config.tilt_limit_deg), place.tilt[:, :1] + REPLANNED_TILT)
        ok &= place.clearance >= np.minimum(config.belly_margin, place.clearance[:, :1] - REPLANNED)
    ok[:, 0] = True
    return (np.cumprod(ok, axis=1).sum(axis=1) - 1) * spacing


class Planner:
    """Chooses the next motion on a map."""

    def __init__(self, spec: RoverSpec, config: PlannerConfig, elevation: ElevationMap) -> None:
        self.spec, self.config = spec, config
        self.field = DistanceField(elevation, config.coarse, config.inflated_cost)
        self.margin = config.margin
        self._standing: Standing | None = None
        self.previous_curvature = 0.0
        self.previous_turn = 0.0
        self._turned_back = 0  # times since the rover drove: headings that see each other's way as the better one
        # The tightest curve that the wheels can steer.
        sharpest = 1 / (spec.track / 2 + abs(spec.wheel_x[0]) / np.tan(spec.max_steer) + 0.02)
        sharpest = min(sharpest, spec.max_yaw_rate / spec.max_speed)
        grid = np.linspace(-1, 1, config.arcs)
        self._curvatures = sharpest * np.sign(grid) * np.abs(grid) ** 1.5
        self._distance = np.arange(0, config.arc_length + 1e-6, config.spacing)

    def reset(self) -> None:
        """Forget the previous motion."""
        self.previous_curvature = 0.0
        self.previous_turn = 0.0
        self._turned_back = 0

    def update(self, elevation: ElevationMap, ground: Traversability, goal: np.ndarray) -> None:
        """Take in a new map: the field to the goal (2,) [m], and the surface that arcs are checked on."""
        self.field.update(elevation, ground, goal)
        self._standing = Standing(elevation, self.spec)

    def free_length(self, poses: np.ndarray, elevation: ElevationMap, ground: Traversability) -> np.ndarray:
        """How far motions (a, k, 3), poses `spacing` apart, can be driven [m]. Returns (a,)."""
        return free_length(
            poses, self.config.spacing, elevation, ground, self.spec, self.config, self._standing, self.margin
        )

    def plan(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, goal: np.ndarray
    ) -> Motion | None:
        """The best motion from a pose, or None if no motion is free.

        pose: (3,) x, y, yaw; goal: (2,) world [m]. update() must have seen the map.
        """
        motions = [
            m
            for m in (self._best_arc(elevation, ground, pose, goal), self._best_turn(elevation, ground, pose, goal))
            if m
        ]
        if not motions:
            return None
        best = min(motions, key=lambda motion: motion.cost)
        if best.turn * self.previous_turn < 0:
            self._turned_back += 1
        elif not best.turn:
            self._turned_back = 0
        self.previous_curvature, self.previous_turn = best.curvature, best.turn
        return best

    def _onward(self, poses: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Cost from each pose to the goal: the field's value there, and the turn into its downhill direction."""
        xy = poses[..., :2]
        value = self.field.at(xy)
        east, north = np.array([PROBE, 0.0]), np.array([0.0, PROBE])
        slope_x = self.field.at(xy + east) - self.field.at(xy - east)
        slope_y = self.field.at(xy + north) - self.field.at(xy - north)
        with np.errstate(invalid="ignore"):
            wanted = np.arctan2(-slope_y, -slope_x)
            error = np.abs((wanted - poses[..., 2] + np.pi) % (2 * np.pi) - np.pi)
        near_goal = np.hypot(*np.moveaxis(xy - goal[:2], -1, 0)) < HEADING_FREE
        return value + np.where(near_goal | ~np.isfinite(error), 0.0, self.config.heading_cost * error)

    def _rate(
        self, poses: np.ndarray, free: np.ndarray, elevation: ElevationMap, ground: Traversability, goal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Cost of each motion with the best point to leave it, and the index of that point. (a, k, 3), (a,) -> (a,)."""
        c = self.config
        cell = np.clip(elevation.cell_of(poses[..., :2]), 0, elevation.n - 1)
        price = 1.0 + ground.cost[cell[..., 1], cell[..., 0]]
        driven = np.cumsum(price, axis=1) * c.spacing - price[:, :1] * c.spacing
        total = driven + self._onward(poses, goal)
        s = self._distance[None, : poses.shape[1]]
        usable = (s <= np.minimum(free, c.lookahead)[:, None] + 1e-6) & (
            s >= np.minimum(c.commit, free)[:, None] - 1e-6
        )
        total = np.where(usable & (free >= c.commit - 1e-6)[:, None], total, np.inf)
        at = total.argmin(axis=1)
        return total[np.arange(len(at)), at], at

    def _best_arc(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, goal: np.ndarray
    ) -> Motion | None:
        c = self.config
        curvature = self._curvatures
        poses = arc_poses(np.broadcast_to(pose, (curvature.size, 3)), curvature, self._distance)
        free = self.free_length(poses, elevation, ground)
        free = np.minimum(free, np.deg2rad(c.max_turn_deg) / np.maximum(np.abs(curvature), 1e-6))
        cost, at = self._rate(poses, free, elevation, ground, goal)
        cost += c.bend_cost * np.abs(curvature) * self._distance[at]
        cost += c.change_cost * np.abs(curvature - self.previous_curvature)
        i = int(cost.argmin())
        if not np.isfinite(cost[i]):
            return None
        stop = round(free[i] / c.spacing) + 1
        return Motion(float(curvature[i]), 0.0, float(free[i]), float(cost[i]), poses[i, :stop])

    def _best_turn(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, goal: np.ndarray
    ) -> Motion | None:
        c = self.config
        turn = self.free_turns(elevation, ground, pose)
        if turn.size == 0:
            return None
        start = np.stack([np.full(turn.size, pose[0]), np.full(turn.size, pose[1]), pose[2] + turn], axis=1)
        poses = arc_poses(start, np.zeros(turn.size), self._distance)
        free = self.free_length(poses, elevation, ground)
        cost, _ = self._rate(poses, free, elevation, ground, goal)
        same_way = np.sign(turn) * np.sign(self.previous_turn)
        cost += c.turn_cost * np.abs(turn) + np.choose(
            same_way.astype(int) + 1,
            [c.turn_start_cost + c.turn_back_cost * 2**self._turned_back, c.turn_start_cost, 0.0],
        )
        cost += c.turn_dark_cost * self._into_the_dark(elevation, ground, pose, turn)
        i = int(cost.argmin())
        if not np.isfinite(cost[i]):
            return None
        stop = round(free[i] / c.spacing) + 1
        return Motion(0.0, float(turn[i]), float(free[i]), float(cost[i]), poses[i, :stop])

    def _into_the_dark(
        self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray, turns: np.ndarray
    ) -> np.ndarray:
        """Whether turns in place (t,) [rad] lay the footprint on unseen ground that it does not stand on. (t,) bool.

        The mast cannot show what is beside the wheels: a rock there has to have been seen before, or not be there."""
        step = 2 * np.pi / self.config.turns
        swept = turns[:, None] * np.linspace(0, 1, max(2, round(float(np.abs(turns).max()) / step) + 1))
        poses = np.stack([np.full(swept.shape, pose[0]), np.full(swept.shape, pose[1]), pose[2] + swept], axis=-1)
        light = footprint_distance(ground.dark_distance, elevation, poses, self.spec)
        # The cover of discs is some centimetres larger than the footprint.
        return np.asarray(light.min(axis=1) < np.minimum(light[:, 0], 0.0) - 0.1)

    def free_turns(self, elevation: ElevationMap, ground: Traversability, pose: np.ndarray) -> np.ndarray:
        """Heading changes in place [rad] during which the footprint touches nothing, 0 left out. Obstacles that were
        not seen are taken not to exist: the rover has driven past what lies beside it."""
        c = self.config
        step = 2 * np.pi / c.turns
        out = []
        for side in (1, -1):
            angle = side * step * np.arange(c.turns // 2 + 1)
            poses = np.stack([np.full(angle.size, pose[0]), np.full(angle.size, pose[1]), pose[2] + angle], axis=1)
            # Between two headings a corner is within 0.14 m of one that is checked: margin and discs cover that.
            room = footprint_distance(ground.clearance, elevation, poses, self.spec)
            ok = room >= room_needed(room[0], self.margin)
            ok[0] = True
            out.append(angle[: np.cumprod(ok).sum()][1:])
        return np.concatenate(out)
