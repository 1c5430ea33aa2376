"""From heights to where the rover can stand: step height, slope and roughness over its footprint.

Grid convention as in nav.ground.elevation: [iy, ix], world-aligned.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.base.images.distance_transform import euclidean_distance
from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap

SEEN_SHARE = 0.2  # of a window, less than which tells nothing of its ground
ROUGHNESS_FREE = 0.03  # [m] below this the footprint's plane counts as even


@dataclass(frozen=True)
class TraversabilityConfig:
    """What the rover may drive over, and how much it dislikes the rest."""

    step_free: float = 0.08  # exposed heights below this [m] cost nothing
    step_blocked: float = 0.23  # from this on [m] they are obstacles; RoverSpec.obstacle_height less a margin
    slope_free_deg: float = 6.0  # slopes below this cost nothing
    slope_blocked_deg: float = 22.0  # and from this on they are obstacles
    roughness_blocked: float = 0.15  # RMS departure from the footprint's plane [m]
    step_cost: float = 4.0  # cost per metre driven at the blocking threshold
    slope_cost: float = 4.0  # likewise
    roughness_cost: float = 3.0  # likewise
    unknown_cost: float = 0.8  # cost per metre driven over what was not seen
    near_cost: float = 4.0  # cost beside an obstacle; fades to zero at comfort
    margin: float = 0.14  # between footprint and obstacle [m]: map and localisation errors
    comfort: float = 1.35  # obstacle distance [m] from which the path costs nothing extra
    ground_window: float = 1.7  # rocks narrower than this [m] stand out of the ground entirely
    footprint_window: float = 1.1  # planes are fitted over this [m]
    hidden_depth: float = 0.25  # unseen ground this near to an obstacle's seen face [m] belongs to it
    hiding_width: float = 0.5  # narrower unseen patches [m] hide no obstacle: rocks are twice as wide as high


@dataclass(frozen=True)
class Traversability:
    """All (n, n), [iy, ix].

    cost: float32, extra cost per metre at the rover's centre, >= 0, obstacles' surroundings and the unknown included;
    blocked: bool, obstacles themselves, not inflated; known: bool; dark: bool, unknown patches wide enough to hide
    an obstacle; clearance, dark_distance: float32 [m] to the nearest obstacle or dark cell; step [m], slope [rad] and
    roughness [m]: float32, NaN where unknown; inflated: bool, the rover's centre must not be here at any heading.
    """

    cost: np.ndarray
    blocked: np.ndarray
    known: np.ndarray
    dark: np.ndarray
    clearance: np.ndarray
    dark_distance: np.ndarray
    step: np.ndarray
    slope: np.ndarray
    roughness: np.ndarray
    inflated: np.ndarray


def distance_to(mask: np.ndarray, cell: float) -> np.ndarray:
    """Distance from each cell's centre to the nearest edge of a marked cell [m], negative inside; inf if none is.

    mask: (n, n) bool. Returns (n, n) float32, within half a cell.
    """
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    return euclidean_distance(~mask) * cell - cell / 2


def ground_surface(low: np.ndarray, known: np.ndarray, window: int) -> np.ndarray:
    """The ground without the rocks: a grey opening of the low heights, which leaves any plane as it is.

    low: (n, n) float32, anything where not known; window: odd [cells]. A window counts only where at least a fifth
    of it was seen; otherwise the top of a rock, with nothing but its own shadow around, would pass for ground.
    Returns (n, n) float32, NaN where not known.
    """
    kernel = _square(window)
    far = np.float32(1e6)
    floor = cv2.erode(np.where(known, low, far), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=1e6)
    seen = cv2.boxFilter(known.astype(np.float32), -1, (window, window), borderType=cv2.BORDER_CONSTANT)
    supported = np.where((seen >= SEEN_SHARE) & (floor < far), floor, -far)
    opened = cv2.dilate(supported, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=-1e6)
    return np.where(known, np.where(opened > -far, opened, floor), np.nan).astype(np.float32)


def fit_planes(height: np.ndarray, known: np.ndarray, window: int, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Slope [rad] and RMS residual [m] of the least-squares plane through the known cells of each window.

    height: (n, n); known: (n, n) bool; window: odd [cells]; cell [m]. Exact for planes with any gaps, by moments.
    Returns two (n, n) float32; NaN where fewer than a fifth of the window is known or its cells lie on a line.
    """
    rows, columns = height.shape
    box = (window, window)

    def total(values: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(values, cv2.CV_64F, box, normalize=False, borderType=cv2.BORDER_CONSTANT)

    m = known.astype(np.float64)
    offset = float(np.mean(height[known])) if known.any() else 0.0
    z = np.where(known, height - offset, 0.0).astype(np.float64)
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
    good = (s >= SEEN_SHARE * window * window) & (det > 1e-2 * (cell * window) ** 4 / 144)
    det = np.where(good, det, 1.0)
    a, b = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
    rms = np.sqrt(np.maximum(zz - a * xz - b * yz, 0))
    slope = np.arctan(np.hypot(a, b))
    return np.where(good, slope, np.nan).astype(np.float32), np.where(good, rms, np.nan).astype(np.float32)


def _footprint_planes(
    ground: np.ndarray, known: np.ndarray, window: float, cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """fit_planes on cells of twice the size: the ground without its rocks is smooth, and a quarter of the work."""
    rows, columns = ground.shape[0] // 2 * 2, ground.shape[1] // 2 * 2
    height = np.where(known, ground, 0)[:rows, :columns]
    corners = [np.s_[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    seen = known[:rows, :columns]
    number = sum(seen[at].astype(np.float32) for at in corners)
    mean = sum(height[at] for at in corners) / np.maximum(number, 1)
    planes = fit_planes(mean, np.asarray(number > 0), _odd(window, 2 * cell), 2 * cell)
    out = []
    for plane in planes:
        full = np.full(ground.shape, np.nan, np.float32)
        full[:rows, :columns] = plane.repeat(2, axis=0).repeat(2, axis=1)
        out.append(np.where(known, full, np.nan))
    return out[0], out[1]


def _odd(length: float, cell: float) -> int:
    return 2 * round(length / cell / 2) + 1


def assess(
    elevation: ElevationMap,
    spec: RoverSpec,
    config: TraversabilityConfig,
    extra_blocked: np.ndarray | None = None,
    carried: np.ndarray | None = None,
) -> Traversability:
    """Judge every cell of a map for a rover.

    extra_blocked: (n, n) bool, obstacles that the map does not show (bumped into), or None. carried: (n, n) bool, cells
    that the rover stands on, which are passable whatever the map says, or None.
    """
    cell = elevation.config.cell
    # Assumed ground is a guess, wrong by decimetres on rough terrain: measured ground beside it would be a step.
    seen = elevation.measured
    # Single unseen cells between two image rows far away are sampling, not shadow.
    filled = cv2.morphologyEx(elevation.known.astype(np.uint8), cv2.MORPH_CLOSE, _square(3)) > 0

    ground = ground_surface(elevation.low, seen, _odd(config.ground_window, cell))
    step = _steps(elevation, ground, seen, config)
    slope, roughness = _footprint_planes(ground, seen, config.footprint_window, cell)
    blocked = _blocked(step, slope, roughness, seen, cell, config)
    if extra_blocked is not None:
        blocked |= extra_blocked
    if carried is not None:
        blocked &= ~carried
    hiding = cv2.morphologyEx((~filled).astype(np.uint8), cv2.MORPH_OPEN, _square(_odd(config.hiding_width, cell)))
    dark = (hiding > 0) & ~filled
    clearance = distance_to(blocked, cell)

    cost = _own_cost(step, slope, roughness, spec, cell, config)
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


def _steps(elevation: ElevationMap, ground: np.ndarray, seen: np.ndarray, config: TraversabilityConfig) -> np.ndarray:
    """(n, n) float32, how far each cell stands out [m]: of the ground (n, n) or of its neighbours; NaN where unseen."""
    cell, top = elevation.config.cell, np.where(seen, elevation.top, np.nan)
    # The face of a rock wider than the window: the height difference between neighbours, which no passable slope has.
    rise = top - cv2.erode(np.where(seen, elevation.low, np.float32(1e6)), _square(3))
    steepest = np.tan(np.deg2rad(config.slope_blocked_deg)) * cell * np.sqrt(2)
    return np.fmax(top - ground, rise - steepest).astype(np.float32)


def _blocked(
    step: np.ndarray, slope: np.ndarray, roughness: np.ndarray, seen: np.ndarray, cell: float, c: TraversabilityConfig
) -> np.ndarray:
    """(n, n) bool, obstacles: too high, steep or rough, and what they hide. step [m], slope [rad], roughness [m]."""
    with np.errstate(invalid="ignore"):
        blocked = seen & (step >= c.step_blocked)
        blocked |= seen & ((slope >= np.deg2rad(c.slope_blocked_deg)) | (roughness >= c.roughness_blocked))
    # Of a rock only the near side is seen; what was not measured behind its face is taken for the rest of it.
    hidden = cv2.dilate(blocked.astype(np.uint8), _square(_odd(2 * c.hidden_depth, cell))) > 0
    return np.asarray(blocked | (hidden & ~seen))


def _own_cost(
    step: np.ndarray, slope: np.ndarray, roughness: np.ndarray, spec: RoverSpec, cell: float, c: TraversabilityConfig
) -> np.ndarray:
    """(n, n), extra cost per metre of the ground itself. step [m], slope [rad] and roughness [m], NaN where unknown."""
    own: np.ndarray = c.step_cost * _ramp(step, c.step_free, c.step_blocked)
    own = own + c.slope_cost * _ramp(slope, np.deg2rad(c.slope_free_deg), np.deg2rad(c.slope_blocked_deg))
    own = own + c.roughness_cost * _ramp(roughness, ROUGHNESS_FREE, c.roughness_blocked)
    # What lies under any wheel counts: a wheel feels its surroundings, and the centre the mean over the footprint.
    reach = _odd(spec.width, cell)
    return np.asarray(cv2.blur(cv2.dilate(own, _square(_odd(2 * spec.wheel_radius, cell))), (reach, reach)))


def _ramp(value: np.ndarray, free: float, full: float) -> np.ndarray:
    """float32, 0 up to `free`, 1 from `full` on, and 0 where the value is NaN: the unknown has a cost of its own."""
    # fmax and fmin drop NaN
    return np.fmin(np.fmax((value - np.float32(free)) * np.float32(1 / (full - free)), 0), 1).astype(np.float32)


def _square(cells: int) -> np.ndarray:
    """A structuring element of so many cells a side."""
    return np.ones((cells, cells), np.uint8)
