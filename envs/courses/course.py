"""A course: a scene with a start, a goal, and the true ground between them.

Whether ground is passable is judged on the true rocks and the true ground, with a fixed footprint, and independently of
any planner.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any

import cv2
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from marssim.base.images.distance_transform import euclidean_distance
from marssim.base.rover_spec import RoverSpec
from marssim.scene.rocks.population import MAX_ROCKS, most_rocks
from marssim.scene.scene import Scene, SceneConfig, build_scene
from marssim.scene.steep_ground import steep_ground

CLEAR_RADIUS = 2.5  # [m] around start and goal within which there are no rocks and no ditches
CLEAR_OF_STEEP_GROUND = 1.2  # [m] likewise for steep ground that is no ditch: the rover turns there, and has some room
MARGIN = 7.0  # [m] from start and goal to the edge of the driving ground
EDGE = 1.5  # [m] least distance of the rover's middle from the edge
CELL = 0.1  # [m] grid of the clearance
STRIDE = 2  # cells of the clearance along one cell of the search for the shortest path
SCENE_CELL = 0.1  # [m] grid of the scenes' relief
OFF_COURSE = np.pi / 4  # [rad] largest angle between the rover's heading at the start and the goal's direction
LEAST_WITH_DITCH = 12.0  # [m] from start to goal, so that a ditch between them leaves both clear
REDRAWS = 50  # most draws of one course
SIXTEEN_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))  # and their opposites
BESIDE = 1.5  # cells within which a place or the goal is joined to a cell by a straight line
# cells searched around a place: enough to reach the ground from beyond its edge
LOOK_ROUND = max(6, round(1.5 * EDGE / (CELL * STRIDE)))

# least and largest value of each property of a course, and its unit
LIMITS = {
    "goal_distance": (3, 100, " m"),
    "k": (0, 0.4, ""),
    "slope_deg": (0, 25, " deg"),
    "sun_elevation_deg": (1, 90, " deg"),
}


@dataclass(frozen=True)
class CourseConfig:
    """The properties of a course that reset may change. Lengths [m], angles [deg]."""

    goal_distance: float = 20.0
    """Distance from start to goal [m]."""
    k: float | None = None
    """Rock abundance, Golombek's k; None for the scene's own."""
    slope_deg: float | None = None
    """Regional slope [deg], its direction drawn; None for the scene's own."""
    sun_elevation_deg: float | None = None
    """Height of the sun [deg]; None for the scene's own."""
    into_sun: bool = False
    """Whether the sun stands over the goal, as seen from the start; else its direction is drawn."""
    ditch: bool = False
    """Whether a ditch cuts the straight path to the goal, which the rover has to drive round."""
    scene_seed: int | None = None
    """Seed of the course; None draws it from the environment's seed."""

    def __post_init__(self) -> None:
        for name, (low, high, unit) in LIMITS.items():
            value = getattr(self, name)
            if value is None and name != "goal_distance":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not low <= float(value) <= high:
                raise ValueError(f"{name} must lie in [{low}, {high}]{unit}, got {value!r}")
        for name in ("into_sun", "ditch"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} must be True or False, got {getattr(self, name)!r}")
        if self.ditch and self.goal_distance < LEAST_WITH_DITCH:
            raise ValueError(
                f"ditch needs a `goal_distance` of {LEAST_WITH_DITCH:g} m or more, got {self.goal_distance}"
            )
        seed = self.scene_seed
        if seed is not None and (isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0):
            raise ValueError(f"scene_seed must be a whole number and not negative, got {seed!r}")

    def with_options(self, options: dict[str, Any]) -> CourseConfig:
        """Return the properties of one episode's course; options: as MarsNavEnv.reset takes them.

        Raises:
            ValueError: An option is unknown or out of its range; the message names it.
        """
        if not isinstance(options, dict):
            raise ValueError(f"options must be a dict, got {options!r}")
        if unknown := options.keys() - vars(self).keys():
            choices = ", ".join(vars(self))
            raise ValueError(f"reset option {', '.join(sorted(map(str, unknown)))} is unknown; choose from {choices}")
        return replace(self, **options)


class TrueGround:
    """Clearance from obstacles and the shortest path to the goal, on the true rocks and the true ground of a scene.

    An obstacle is a rock or a block of a ledge of spec.obstacle_height or more, taken as the disc of its outline, and
    steep_ground. The rover is a disc of half its width: it may pass where the clearance is at least that.

    Attributes:
        steep: (n, n) bool, the steep ground on the grid of the clearance.
    """

    def __init__(self, scene: Scene, spec: RoverSpec, goal: np.ndarray) -> None:
        self.half = scene.half
        self.radius = spec.width / 2
        self.steep = steep_ground(scene.terrain, spec, self.half, CELL)
        n = len(self.steep)
        free = np.where(self.steep, np.uint8(0), np.uint8(255))
        rocks = scene.bodies
        reaches = np.abs(rocks.centre[:, :2]).max(axis=1) - rocks.diameter / 2 < self.half
        for i in np.flatnonzero((rocks.height >= spec.obstacle_height) & reaches):
            x, y = rocks.centre[i, :2]
            centre = (round((x + self.half) / CELL), round((y + self.half) / CELL))
            cv2.circle(free, centre, max(1, round(rocks.diameter[i] / 2 / CELL)), 0, -1)
        if free.all():
            self._clearance: np.ndarray = np.full((n, n), np.float32(2 * self.half))
        else:
            self._clearance = euclidean_distance(free) * CELL
        coarse = self._clearance[::STRIDE, ::STRIDE]
        self._cell = CELL * STRIDE
        inside = np.abs(np.arange(len(coarse)) * self._cell - self.half) <= self.half - EDGE
        self._passable = (coarse >= self.radius) & inside[:, None] & inside[None, :]
        self._goal = np.asarray(goal, float)
        self._field, self._next = self._distances()

    def towards(self, goal: np.ndarray) -> TrueGround:
        """Return the same ground with the ways to another goal; goal: (2,) [m]."""
        other = copy.copy(self)
        other._goal = np.asarray(goal, float)
        other._field, other._next = other._distances()
        return other

    def clear_places(self, radius: float, margin: float) -> np.ndarray:
        """Return the middles of the cells of 0.1 m around which there are no obstacles.

        Args:
            radius: Least distance from obstacles [m].
            margin: Least distance from the edge of the finely gridded square [m].

        Returns:
            (N, 2) x, y [m].
        """
        axis = np.arange(len(self._clearance)) * CELL - self.half
        inside = np.abs(axis) <= self.half - margin
        j, i = np.nonzero((self._clearance >= radius) & inside[:, None] & inside[None, :])
        return np.column_stack([axis[i], axis[j]])

    def clearance(self, x: float, y: float) -> float:
        """Return the distance from a point to the nearest obstacle [m]; 0 inside it.

        It is taken on a grid of 0.1 m, and a disc is not the rock's outline: where the rover's side passes, it is 0.04
        m too large on average, with a standard deviation of 0.08 m (k = .15).

        Args:
            x: World position [m].
            y: World position [m].
        """
        j, i = self._index(y, CELL, len(self._clearance)), self._index(x, CELL, len(self._clearance))
        return float(self._clearance[j, i])

    def distance_to_goal(self, x: float, y: float) -> float:
        """Return the length of the shortest passable path from a point to the goal [m]; inf if there is none.

        A point that is not passable itself (the rover touches a rock) counts from the nearest passable cell.

        Args:
            x: World position [m].
            y: World position [m].
        """
        return self._entry(x, y)[0]

    def way_to_goal(self, x: float, y: float) -> np.ndarray:
        """Return the corners of the shortest path from a point to the goal, whose length distance_to_goal returns.

        Args:
            x: World position [m].
            y: World position [m].

        Returns:
            (N, 2) [m]; (0, 2) if there is no way.
        """
        length, cell = self._entry(x, y)
        if not np.isfinite(length):
            return np.zeros((0, 2))
        n = len(self._field)
        cells = []
        while cell != n * n:
            cells.append(cell)
            cell = self._next[cell]
        j, i = np.divmod(np.array(cells), n)
        middle = np.column_stack([i, j]) * self._cell - self.half
        way = np.vstack([[x, y], middle, self._goal])
        step = np.diff(way, axis=0)
        heading = step / np.maximum(np.hypot(*step.T), 1e-12)[:, None]
        turns = np.abs(np.diff(heading, axis=0)).max(axis=1) > 1e-9
        return way[np.concatenate([[True], turns, [True]])]

    def _entry(self, x: float, y: float) -> tuple[float, int]:
        """Return the length of the shortest path from a point [m], and the number of the cell in which it starts."""
        n = len(self._field)
        j, i = self._index(y, self._cell, n), self._index(x, self._cell, n)
        rows, columns = (slice(max(0, at - LOOK_ROUND), min(n, at + LOOK_ROUND + 1)) for at in (j, i))
        window = (rows, columns)
        field = self._field[window]
        jj, ii = np.mgrid[window]
        gap = np.hypot(ii * self._cell - self.half - x, jj * self._cell - self.half - y)
        near = gap <= max(BESIDE * self._cell, float(np.where(np.isfinite(field), gap, np.inf).min()) + 1e-9)
        length = np.where(near, field + gap, np.inf)
        best = np.unravel_index(length.argmin(), length.shape)
        return float(length[best]), int(jj[best] * n + ii[best])

    def _index(self, value: float, cell: float, n: int) -> int:
        return int(np.clip(round((value + self.half) / cell), 0, n - 1))

    def _distances(self) -> tuple[np.ndarray, np.ndarray]:
        """Find the shortest path from each cell to the goal over 16 neighbours, at most 2.7 % longer than the true one.

        Returns:
            The lengths (n, n) [m], inf where there is no way, and (n n,) the next cell of each way, n n for the goal
            itself.
        """
        n = len(self._passable)
        index = np.arange(n * n).reshape(n, n)
        # The goal is a node of its own, between cells: snapped to a cell, it would make ways too short.
        y, x = np.meshgrid(*[np.arange(n) * self._cell - self.half] * 2, indexing="ij")
        gap = np.hypot(x - self._goal[0], y - self._goal[1])
        near = (gap <= BESIDE * self._cell) & self._passable
        rows, columns, lengths = [np.full(int(near.sum()), n * n)], [index[near]], [np.maximum(gap[near], 1e-9)]
        for dj, di in SIXTEEN_NEIGHBOURS:
            a = np.s_[: n - dj, max(0, -di) : n - max(0, di)]
            b = np.s_[dj:, max(0, di) : n - max(0, -di)]
            open_ = self._passable[a] & self._passable[b]
            rows.append(index[a][open_])
            columns.append(index[b][open_])
            lengths.append(np.full(int(open_.sum()), np.hypot(dj, di) * self._cell))
        edges = (np.concatenate(rows), np.concatenate(columns))
        graph = csr_matrix((np.concatenate(lengths), edges), shape=(n * n + 1, n * n + 1))
        length, onward = dijkstra(graph, directed=False, indices=n * n, return_predecessors=True)
        return length[:-1].reshape(n, n), onward[:-1]


class NoWayError(ValueError):
    """No way leads to a goal in many draws of a course; the message says what is too much for the rover."""


@dataclass(frozen=True)
class Course:
    """A scene with a start and a goal."""

    scene: Scene
    """The scene."""
    ground: TrueGround
    """The true clearance and shortest path."""
    start: np.ndarray
    """x, y [m] and yaw [rad] of the start."""
    goal: np.ndarray
    """(2,) goal [m]."""
    shortest: float
    """Length of the shortest passable path [m]."""
    redraws: int
    """Number of courses that were rejected before: no way led to their goal, or an end was too near to steep ground."""

    @property
    def area(self) -> tuple[float, float, float, float]:
        """(x0, y0, x1, y1) within which the rover's middle must stay [m]."""
        reach = self.scene.half - EDGE
        return -reach, -reach, reach, reach


def series_seed(seed: int, number: int) -> int:
    """Return the seed of a course; it depends on the seed of a series of courses and its number in it alone."""
    return int(np.random.SeedSequence((seed, number)).generate_state(1)[0])


def check_rocks(base: SceneConfig, config: CourseConfig) -> None:
    """Check that the scene of a course holds its rocks.

    Args:
        base: The scene's settings.
        config: The course's settings.

    Raises:
        ValueError: There may be too many; the message names both settings that their number depends on.
    """
    rocks = base.rocks if config.k is None else replace(base.rocks, k=config.k)
    number = most_rocks(rocks, config.goal_distance / 2 + MARGIN, base.horizon)
    if number > MAX_ROCKS:
        raise ValueError(
            f"`k` {rocks.k:g} with a `goal_distance` of {config.goal_distance:g} m: the scene may have {number:.0f} "
            f"rocks, and can hold {MAX_ROCKS}; choose a smaller k or goal distance"
        )


def draw_course(base: SceneConfig, config: CourseConfig, spec: RoverSpec, rng: np.random.Generator) -> Course:
    """Draw scene, start and goal; draw again while no way leads to the goal or the ground at an end is too steep.

    The scene is as wide as the course needs, on a grid of 0.1 m; base.size and base.cell have no effect.

    Args:
        base: The scene's settings.
        config: The course's settings.
        spec: The rover.
        rng: Source of the random draws, unless config.scene_seed is given.

    Raises:
        NoWayError: If 50 draws in a row have no way: k or the slope is too high for the rover.
        ValueError: As check_rocks.
    """
    check_rocks(base, config)
    if config.scene_seed is not None:
        rng = np.random.default_rng(config.scene_seed)
    relief, rocks, look = base.relief, base.rocks, base.look
    if config.k is not None:
        rocks = replace(rocks, k=config.k)
    if config.sun_elevation_deg is not None:
        look = replace(look, sun_elevation_deg=(config.sun_elevation_deg, config.sun_elevation_deg))
    size = config.goal_distance + 2 * MARGIN
    for redraw in range(REDRAWS):
        if config.slope_deg is not None:
            relief = replace(
                base.relief, regional_slope_deg=config.slope_deg, regional_azimuth_deg=float(rng.uniform(0, 360))
            )
        scene_config = replace(base, relief=relief, rocks=rocks, look=look, size=size, cell=SCENE_CELL)
        bearing = rng.uniform(0, 2 * np.pi)
        if config.into_sun:
            light = replace(look, sun_azimuth_deg=(float(np.rad2deg(bearing)),) * 2)
            scene_config = replace(scene_config, look=light)
        forward = np.array([np.cos(bearing), np.sin(bearing)])
        middle = rng.uniform(-1, 1, 2)
        start, goal = middle - forward * config.goal_distance / 2, middle + forward * config.goal_distance / 2
        yaw = bearing + rng.uniform(-OFF_COURSE, OFF_COURSE)
        clear = tuple((float(x), float(y), CLEAR_RADIUS) for x, y in (start, goal))
        across = (float(start[0]), float(start[1]), float(goal[0]), float(goal[1])) if config.ditch else None
        scene = build_scene(scene_config, rng, clear, across)
        ground = TrueGround(scene, spec, goal)
        shortest = ground.distance_to_goal(*start)
        room = min(ground.clearance(*start), ground.clearance(*goal))
        if np.isfinite(shortest) and room >= CLEAR_OF_STEEP_GROUND:
            return Course(scene, ground, np.array([*start, yaw]), goal, shortest, redraw)
    causes = f"k={rocks.k} and a slope of {relief.regional_slope_deg:g} deg"
    if relief.ditch_density:
        causes += f" with a ditch_density of {relief.ditch_density:g}"
    raise NoWayError(f"no goal can be reached in {REDRAWS} draws: {causes} leave no way; choose smaller values")
