"""From heights to the places where the rover can stand: step height, slope and roughness over its footprint.

Grid convention as in nav.ground.elevation: [iy, ix], world-aligned.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.base.command.limits import check_least, check_range
from marssim.base.images.distance_transform import euclidean_distance
from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap

MEASURED_SHARE = 0.2  # share of a window that must be measured to judge its ground
ROUGHNESS_FREE = 0.03  # [m] below which the footprint's plane counts as even


@dataclass(frozen=True)
class TraversabilityConfig:
    """What the rover may drive over, and the costs of the rest."""

    step_free: float = 0.08
    """Exposed heights below this cost nothing [m]."""
    step_blocked: float = 0.23
    """Exposed heights from this on are obstacles [m]: RoverSpec.obstacle_height less a margin."""
    slope_free_deg: float = 6.0
    """Slopes below this cost nothing [deg]."""
    slope_blocked_deg: float = 22.0
    """Slopes from this on are obstacles [deg]."""
    roughness_blocked: float = 0.15
    """RMS departure from the footprint's plane from which ground is an obstacle [m]."""
    step_cost: float = 4.0
    """Extra cost of a metre driven at step_blocked [m]."""
    slope_cost: float = 4.0
    """Extra cost of a metre driven at slope_blocked_deg [m]."""
    roughness_cost: float = 3.0
    """Extra cost of a metre driven at roughness_blocked [m]."""
    unknown_cost: float = 0.8
    """Extra cost of a metre driven over unseen ground [m]."""
    near_cost: float = 4.0
    """Extra cost of a metre beside an obstacle [m]; it fades to zero at `comfort`."""
    margin: float = 0.14
    """Distance between footprint and obstacle for errors of map and localisation [m]."""
    comfort: float = 1.35
    """Distance to an obstacle from which the path costs nothing extra [m]."""
    ground_window: float = 1.7
    """Rocks narrower than this stand out of the ground entirely [m]."""
    footprint_window: float = 1.1
    """Side of the square over which planes are fitted [m]. It becomes an odd number of double cells: 1.4 m with cells
    of 0.1 m. Double cells begin at the map's corner, so planes change a little where the map moves by one cell."""
    hidden_depth: float = 0.25
    """Within this distance of an obstacle's face [m], ground that is unseen or stands out by half of step_blocked
    belongs to the obstacle: its hidden side and its flanks."""
    hiding_width: float = 0.5
    """Unseen patches narrower than this hide no obstacle [m]: rocks are twice as wide as high."""

    def __post_init__(self) -> None:
        check_range(
            self, step_free=(0, 100), slope_free_deg=(0, 180), slope_blocked_deg=(0, 180), margin=(0, 100),
            comfort=(0, 1000), ground_window=(0.01, 1000), footprint_window=(0.01, 1000), hidden_depth=(0, 100),
            hiding_width=(0, 100),
        )  # fmt: skip
        check_least(self, step_cost=0, slope_cost=0, roughness_cost=0, unknown_cost=0, near_cost=0)
        blocked = (
            ("step_blocked", self.step_free), ("slope_blocked_deg", self.slope_free_deg), ("roughness_blocked", 0.0),
        )  # fmt: skip
        for name, free in blocked:
            if not getattr(self, name) > free:
                raise ValueError(
                    f"{name} must be more than {free:g}, up to which it costs nothing, got {getattr(self, name)}"
                )


@dataclass(frozen=True)
class Traversability:
    """The judged ground, all maps (n, n), [iy, ix]."""

    cost: np.ndarray
    """float32 extra cost per metre at the rover's centre, >= 0, with the surroundings of obstacles and unknown ground
    included."""
    blocked: np.ndarray
    """bool, the obstacles themselves, not inflated: what was seen of them, and possible drops."""
    known: np.ndarray
    """bool, seen or assumed."""
    dark: np.ndarray
    """bool, unknown patches wide enough to hide an obstacle."""
    clearance: np.ndarray
    """float32 distance to the nearest obstacle [m]."""
    dark_distance: np.ndarray
    """float32 distance to the nearest dark cell [m]."""
    step: np.ndarray
    """float32 height that stands out of the ground [m]; NaN where unknown."""
    slope: np.ndarray
    """float32 slope [rad]; NaN where unknown."""
    roughness: np.ndarray
    """float32 RMS departure from the footprint's plane [m]; NaN where unknown."""
    inflated: np.ndarray
    """bool, cells in which the rover's centre must not be at any heading."""


def distance_to(mask: np.ndarray, cell: float) -> np.ndarray:
    """Return the distance from each cell's centre to the nearest edge of a marked cell, within half a cell.

    Args:
        mask: (n, n) bool, the marked cells.
        cell: Edge of a cell [m].

    Returns:
        (n, n) float32 distance [m], negative inside; inf if no cell is marked.
    """
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    return euclidean_distance(~mask) * cell - cell / 2


def ground_surface(low: np.ndarray, measured: np.ndarray, window: int) -> np.ndarray:
    """Return the ground without the rocks: a grey opening of the low heights, which leaves any plane as it is.

    A window counts only if at least a fifth of it is measured; otherwise the top of a rock, surrounded by nothing but
    its own shadow, would pass for ground.

    Args:
        low: (n, n) float32 heights [m], any value where not measured.
        measured: (n, n) bool, the cells that were really seen.
        window: Side of the window [cells], odd.

    Returns:
        (n, n) float32 heights [m]; NaN where not measured.
    """
    kernel = _square(window)
    far = np.float32(1e6)
    floor = cv2.erode(np.where(measured, low, far), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=1e6)
    share = cv2.boxFilter(measured.astype(np.float32), -1, (window, window), borderType=cv2.BORDER_CONSTANT)
    supported = np.where((share >= MEASURED_SHARE) & (floor < far), floor, -far)
    opened = cv2.dilate(supported, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=-1e6)
    return np.where(measured, np.where(opened > -far, opened, floor), np.nan).astype(np.float32)


def fit_planes(height: np.ndarray, measured: np.ndarray, window: int, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Return slope and RMS residual of the least-squares plane through the measured cells of each window.

    Exact for planes with any gaps, by moments.

    Args:
        height: (n, n) heights [m].
        measured: (n, n) bool, the cells that were really seen.
        window: Side of the window [cells], odd.
        cell: Edge of a cell [m].

    Returns:
        Slope [rad] and residual [m], both (n, n) float32; NaN where less than a fifth of the window is measured or its
        measured cells lie on a line.
    """
    rows, columns = height.shape
    box = (window, window)

    def total(values: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(values, cv2.CV_64F, box, normalize=False, borderType=cv2.BORDER_CONSTANT)

    m = measured.astype(np.float64)
    offset = float(np.mean(height[measured])) if measured.any() else 0.0
    z = np.where(measured, height - offset, 0.0).astype(np.float64)
    x, y = (np.arange(columns) * cell)[None, :], (np.arange(rows) * cell)[:, None]
    s, sx, sy, sz = total(m), total(m * x), total(m * y), total(z)
    count = np.maximum(s, 1)
    mx, my, mz = sx / count, sy / count, sz / count
    xx, yy, xy = (
        total(m * x * x) / count - mx * mx,
        total(m * y * y) / count - my * my,
        total(m * x * y) / count - mx * my,
    )
    xz, yz = total(z * x) / count - mx * mz, total(z * y) / count - my * mz
    zz = total(z * z) / count - mz * mz
    det = xx * yy - xy * xy
    good = (s >= MEASURED_SHARE * window * window) & (det > 1e-2 * (cell * window) ** 4 / 144)
    det = np.where(good, det, 1.0)
    a, b = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
    rms = np.sqrt(np.maximum(zz - a * xz - b * yz, 0))
    slope = np.arctan(np.hypot(a, b))
    return np.where(good, slope, np.nan).astype(np.float32), np.where(good, rms, np.nan).astype(np.float32)


def _footprint_planes(
    ground: np.ndarray, measured: np.ndarray, window: float, cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return fit_planes on cells of twice the size: bare ground is smooth, and it is a quarter of the work."""
    rows, columns = ground.shape[0] // 2 * 2, ground.shape[1] // 2 * 2
    height = np.where(measured, ground, 0)[:rows, :columns]
    corners = [np.s_[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    valid = measured[:rows, :columns]
    number = sum(valid[at].astype(np.float32) for at in corners)
    mean = sum(height[at] for at in corners) / np.maximum(number, 1)
    planes = fit_planes(mean, np.asarray(number > 0), _odd(window, 2 * cell), 2 * cell)
    out = []
    for plane in planes:
        full = np.full(ground.shape, np.nan, np.float32)
        full[:rows, :columns] = plane.repeat(2, axis=0).repeat(2, axis=1)
        out.append(np.where(measured, full, np.nan))
    return out[0], out[1]


def _odd(length: float, cell: float) -> int:
    return 2 * round(length / cell / 2) + 1


def assess(
    elevation: ElevationMap,
    spec: RoverSpec,
    config: TraversabilityConfig,
    extra_blocked: np.ndarray | None = None,
    passable: np.ndarray | None = None,
) -> Traversability:
    """Judge every cell of a map for a rover.

    Args:
        elevation: The map.
        spec: The rover.
        config: The rules.
        extra_blocked: (n, n) bool, obstacles that the map does not show (the rover bumped into them), or None.
        passable: (n, n) bool, cells that are no obstacle whatever the map shows, as the rover stands on them, or None.
    """
    cell = elevation.config.cell
    # Assumed ground may be wrong by decimetres on rough terrain: measured ground beside it would look like a step.
    measured = elevation.measured
    # Far away, single unseen cells between two image rows are gaps of sampling, not shadows.
    filled = cv2.morphologyEx(elevation.known.astype(np.uint8), cv2.MORPH_CLOSE, _square(3)) > 0

    ground = ground_surface(elevation.low, measured, _odd(config.ground_window, cell))
    step = _steps(elevation, ground, measured, config)
    slope, roughness = _footprint_planes(ground, measured, config.footprint_window, cell)
    blocked = _blocked(step, slope, roughness, measured, cell, config) | elevation.possible_drop
    if extra_blocked is not None:
        blocked |= extra_blocked
    if passable is not None:
        blocked &= ~passable
    hiding = cv2.morphologyEx((~filled).astype(np.uint8), cv2.MORPH_OPEN, _square(_odd(config.hiding_width, cell)))
    dark = (hiding > 0) & ~filled
    clearance = distance_to(blocked, cell)

    cost = _ground_cost(step, slope, roughness, spec, cell, config)
    cost = cost + config.unknown_cost * (~filled)
    half = spec.width / 2 + config.margin
    cost = cost + config.near_cost * (1 - _ramp(clearance, half, max(config.comfort, half + cell)))
    return Traversability(
        cost=cost.astype(np.float32),
        blocked=blocked,
        known=filled,
        dark=dark,
        clearance=clearance,
        dark_distance=distance_to(dark, cell),
        step=step,
        slope=slope,
        roughness=roughness,
        inflated=clearance < half,
    )


def _steps(
    elevation: ElevationMap, ground: np.ndarray, measured: np.ndarray, config: TraversabilityConfig
) -> np.ndarray:
    """Return the height by which each cell stands out of the ground (n, n) or of its neighbours [m]: (n, n) float32."""
    cell, top = elevation.config.cell, np.where(measured, elevation.top, np.nan)
    # Rocks wider than the window show by their face: a height difference between neighbours that no passable slope has.
    rise = top - cv2.erode(np.where(measured, elevation.low, np.float32(1e6)), _square(3))
    steepest = np.tan(np.deg2rad(config.slope_blocked_deg)) * cell * np.sqrt(2)
    return np.fmax(top - ground, rise - steepest).astype(np.float32)


def _blocked(
    step: np.ndarray,
    slope: np.ndarray,
    roughness: np.ndarray,
    measured: np.ndarray,
    cell: float,
    c: TraversabilityConfig,
) -> np.ndarray:
    """Return the obstacles (n, n) bool: ground that is too high [m], steep [rad] or rough [m], and the rest of it."""
    with np.errstate(invalid="ignore"):
        blocked = measured & (step >= c.step_blocked)
        blocked |= measured & ((slope >= np.deg2rad(c.slope_blocked_deg)) | (roughness >= c.roughness_blocked))
        flank = step >= c.step_blocked / 2
    # A rock is wider than its high part, and only its near side is seen; unmeasured cells behind its face are taken for
    # the rest of it.
    beside = cv2.dilate(blocked.astype(np.uint8), _square(_odd(2 * c.hidden_depth, cell))) > 0
    return np.asarray(blocked | (beside & (flank | ~measured)))


def _ground_cost(
    step: np.ndarray, slope: np.ndarray, roughness: np.ndarray, spec: RoverSpec, cell: float, c: TraversabilityConfig
) -> np.ndarray:
    """Return the extra cost per metre of the ground itself (n, n), from step [m], slope [rad] and roughness [m]."""
    cost: np.ndarray = c.step_cost * _ramp(step, c.step_free, c.step_blocked)
    cost = cost + c.slope_cost * _ramp(slope, np.deg2rad(c.slope_free_deg), np.deg2rad(c.slope_blocked_deg))
    free = ROUGHNESS_FREE * min(1.0, c.roughness_blocked / TraversabilityConfig.roughness_blocked)
    cost = cost + c.roughness_cost * _ramp(roughness, free, c.roughness_blocked)
    # The ground under any wheel counts: a wheel feels its surroundings, the centre the mean over the footprint.
    reach = _odd(spec.width, cell)
    return np.asarray(cv2.blur(cv2.dilate(cost, _square(_odd(2 * spec.wheel_radius, cell))), (reach, reach)))


def _ramp(value: np.ndarray, free: float, full: float) -> np.ndarray:
    """Return float32 that rises from 0 at `free` to 1 at `full`, and is 0 where the value is NaN: unknown has its own
    cost.
    """
    # fmax and fmin drop NaN
    return np.fmin(np.fmax((value - np.float32(free)) * np.float32(1 / (full - free)), 0), 1).astype(np.float32)


def _square(cells: int) -> np.ndarray:
    """Return a square structuring element with sides of this many cells."""
    return np.ones((cells, cells), np.uint8)
