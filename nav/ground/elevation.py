"""A 2.5D elevation map that follows the rover and remembers what it has seen.

Grid convention: square, axes along world x (east) and y (north), indexed [iy, ix]; cell (0, 0) has its lower left
corner at `origin`. Heights are world z [m]; NaN means that a cell was never seen. Each cell keeps two heights: `top`,
the highest of the points in it (of four or more, the highest but one), so that a rock is never averaged into the ground
beside it, and `low`, a low percentile, which is the ground. Cells that were never seen may be marked as possible drops
(nav.ground.hidden_drops).

The left edge of the image, wider for near ground, is seen by the left eye only. Estimators extend the ground there,
also over rocks. Unless they are confident, such points may show what stands out, but they never make ground known as
free.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.command.limits import check_least, check_range, check_whole
from marssim.base.images.depth_edges import JUMP, depth_edges
from marssim.base.masked import filled
from marssim.base.pose import planar_pose, rigid_pose
from marssim.base.rover_spec import ZHURONG
from nav.ground.hidden_drops import HiddenDropConfig, hidden_drops

FEWEST_CELLS = 10  # of a side of the map
DROP_COLUMNS = 128  # number of image columns in which drops are looked for, roughly
# of a map, and their values where unknown
LAYERS = {"top": np.nan, "low": np.nan, "weight": 0, "hidden_drop": False, "from_prior": False}
SLOPING_JUMP = 4.0  # change of disparity on sloping ground, over baseline / camera height; on level ground it is 2
DROP_RAYS = 2  # number of image columns that must show the drop of a cell


@dataclass(frozen=True)
class ElevationConfig:
    """How depth maps become heights."""

    cell: float = 0.10
    """Edge of a cell [m]."""
    size: float = 40.0
    """Edge of the map [m]."""
    max_range: float = 12.0
    """Depth beyond which points are left out [m]."""
    min_range: float = 0.5
    """Depth below which points are left out [m]."""
    min_confidence: float = 0.5
    """Confidence below which a pixel is unknown."""
    sure_alone: float = 0.7
    """Confidence below which a point that only the left eye sees shows no ground, only what stands out."""
    stands_out: float = 0.10
    """Height above the lowest point within ground_reach from which a cell stands out [m]."""
    ground_reach: float = 0.8
    """Distance within which the lowest point is taken for the ground [m]."""
    few: int = 2
    """A cell with this many points or fewer stands out only if a cell beside it reaches as high."""
    disparity_sigma: float = 0.25
    """Standard deviation of the stereo matching error [px]."""
    edge_jump: float = JUMP
    """Least change of disparity within 3 x 3 px from which a pixel hangs between two surfaces [px]. Cameras for which
    the disparity of level ground changes faster than for NaTeCam have a larger one."""
    columns: int = 256
    """Number of image columns that are used, roughly."""
    recentre_at: float = 7.0
    """Distance of the rover from the map's edge at which the map moves [m]."""
    drops: HiddenDropConfig = field(default_factory=HiddenDropConfig)
    """Which hidden ground is a possible drop."""

    def __post_init__(self) -> None:
        check_whole(self, few=0, columns=1)
        check_range(self, size=(0, 1e5), min_confidence=(0, 1), min_range=(0, 1e4))
        check_least(self, max_range=self.min_range, sure_alone=0, stands_out=0, ground_reach=0)
        check_least(self, disparity_sigma=0, edge_jump=0, recentre_at=0)
        if not (self.cell > 0 and self.size >= FEWEST_CELLS * self.cell):
            raise ValueError(f"size must be at least {FEWEST_CELLS} cells, got cell={self.cell}, size={self.size}")


@lru_cache(maxsize=8)
def _ray_slopes(camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """Return the ray directions of the columns (x / z) and of the rows (y / z), float32."""
    u = (np.arange(camera.width) - camera.cx) / camera.fx
    v = (np.arange(camera.height) - camera.cy) / camera.fy
    return u.astype(np.float32), v.astype(np.float32)


class ElevationMap:
    """World-aligned scrolling height map, fused from depth maps.

    Attributes:
        config: The settings.
        n: Number of cells along one side.
        origin: (2,) world position of the lower left corner [m].
        top: (n, n) float32 [iy, ix], height of the highest points [m]; NaN where unknown.
        low: (n, n) float32 [iy, ix], height of the ground [m]; NaN where unknown.
        weight: (n, n) float32 [iy, ix], inverse squared range error of the best looks [1 / m2].
        hidden_drop: (n, n) bool [iy, ix], a look showed that ground is hidden here and may drop; see possible_drop.
        from_prior: (n, n) bool [iy, ix], the heights are those of another map (see complete), and no look that weighs
            more has shown them.
    """

    def __init__(self, config: ElevationConfig | None = None, centre: tuple[float, float] = (0.0, 0.0)) -> None:
        self.config = config or ElevationConfig()
        self.n = round(self.config.size / self.config.cell)
        self.clear(centre)

    def clear(self, centre: tuple[float, float] | np.ndarray) -> None:
        """Forget everything and centre the map on a world position (x, y) [m]."""
        shape = (self.n, self.n)
        self.top, self.low = (np.full(shape, np.nan, np.float32) for _ in range(2))
        self.weight = np.zeros(shape, np.float32)
        self.hidden_drop, self.from_prior = (np.zeros(shape, bool) for _ in range(2))
        cell = self.config.cell
        self.origin = np.round((np.asarray(centre, float)[:2] - self.config.size / 2) / cell) * cell

    @property
    def known(self) -> np.ndarray:
        """(n, n) bool: seen, or assumed at the start."""
        return np.isfinite(self.top)

    @property
    def measured(self) -> np.ndarray:
        """(n, n) bool: really seen. Only the heights of these cells can be compared with each other."""
        return self.weight > 0

    @property
    def possible_drop(self) -> np.ndarray:
        """(n, n) bool: hidden ground that may drop, and that no look has shown."""
        return self.hidden_drop & ~self.measured

    def cell_of(self, xy: np.ndarray) -> np.ndarray:
        """Return the cell indices (ix, iy) of world positions (..., 2) [m], not clipped to the map: (..., 2) int."""
        return np.floor((np.asarray(xy, float) - self.origin) / self.config.cell).astype(np.int64)

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the world x of the columns and the world y of the rows, cell centres, each (n,) [m]."""
        steps = (np.arange(self.n) + 0.5) * self.config.cell
        return self.origin[0] + steps, self.origin[1] + steps

    def recentre(self, xy: np.ndarray) -> bool:
        """Scroll by whole cells so that the rover stays off the edge, and forget what scrolls out.

        Args:
            xy: (2,) position of the rover [m].

        Returns:
            Whether the map moved.
        """
        offset = np.asarray(xy, float)[:2] - (self.origin + self.config.size / 2)
        if np.abs(offset).max() < self.config.size / 2 - self.config.recentre_at:
            return False
        dx, dy = (int(s) for s in np.round(offset / self.config.cell))
        n = self.n
        source = np.s_[max(0, dy) : min(n, n + dy), max(0, dx) : min(n, n + dx)]
        target = np.s_[max(0, -dy) : min(n, n - dy), max(0, -dx) : min(n, n - dx)]
        for name, unknown in LAYERS.items():
            old = getattr(self, name)
            new = np.full_like(old, unknown)
            if abs(dx) < n and abs(dy) < n:
                new[target] = old[source]
            setattr(self, name, new)
        self.origin = self.origin + np.array([dx, dy]) * self.config.cell
        return True

    def complete(self, other: ElevationMap) -> None:
        """Fill the cells that were never measured from the heights of another map of any size that have a weight.

        The first look at such a cell that weighs more than its heights replaces them; lighter looks are averaged with
        them.

        Raises:
            ValueError: Cells of the two maps differ in size.
        """
        cell = self.config.cell
        if other.config.cell != cell:
            raise ValueError(f"the other map must have cells of {cell:g} m, got {other.config.cell:g} m")
        dx, dy = (int(shift) for shift in np.round((self.origin - other.origin) / cell))
        target = np.s_[max(0, -dy) : max(0, other.n - dy), max(0, -dx) : max(0, other.n - dx)]
        rows, columns = self.top[target].shape
        source = np.s_[max(0, dy) : max(0, dy) + rows, max(0, dx) : max(0, dx) + columns]
        finite = np.isfinite(other.top[source]) & np.isfinite(other.low[source])
        fill = ~self.measured[target] & other.measured[source] & finite
        for name in LAYERS:
            layer = getattr(self, name)[target]
            layer[fill] = getattr(other, name)[source][fill]
        self.from_prior[target] |= fill

    def assume_flat(self, pose: np.ndarray, radius: float) -> None:
        """Fill the unknown cells around the rover with the plane that it stands on.

        The camera never sees the ground beside and under the rover; where the rover stands, it is passable. The first
        real measurement of a cell replaces the assumption.

        Args:
            pose: (4, 4) body to world.
            radius: Radius that is filled [m].
        """
        x, y = self.centres()
        dx, dy = x[None, :] - pose[0, 3], y[:, None] - pose[1, 3]
        self._assume(pose, dx, dy, dx**2 + dy**2 <= radius**2)

    def assume_under(self, pose: np.ndarray, length: float, width: float) -> None:
        """Fill the unknown cells under the rover likewise, and no others: beside it may lie the hidden half of a rock.

        Args:
            pose: (4, 4) body to world.
            length: Length of the rectangle [m].
            width: Width of the rectangle [m].
        """
        x, y = self.centres()
        dx, dy = x[None, :] - pose[0, 3], y[:, None] - pose[1, 3]
        yaw = planar_pose(pose)[2]
        ahead, left = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
        self._assume(pose, dx, dy, (np.abs(ahead) <= length / 2) & (np.abs(left) <= width / 2))

    def _assume(self, pose: np.ndarray, dx: np.ndarray, dy: np.ndarray, where: np.ndarray) -> None:
        fill = where & ~self.known
        up = pose[:3, 2]
        plane = pose[2, 3] - (up[0] * dx + up[1] * dy) / max(up[2], 0.3)
        for layer in (self.top, self.low):
            layer[fill] = plane[fill]

    def integrate(
        self, depth: np.ndarray, confidence: np.ndarray | None, rig: StereoRig, camera_pose: np.ndarray,
        camera_height: float = ZHURONG.mount.height, shift: float = 0.0,
    ) -> int:  # fmt: skip
        """Fuse one depth map.

        Args:
            depth: (H, W) depth [m] along the optical axis. inf (sky, far) and NaN (unknown), or what a masked array
                masks, leave the map as it is; they never make a cell free.
            confidence: (H, W) in [0, 1]; None means 1 everywhere.
            rig: The cameras at the size of depth.
            camera_pose: (4, 4) left camera to world.
            camera_height: Height of the cameras over level ground [m], which says how fast its disparity changes, and
                how many rows see it.
            shift: The right camera's cx minus the left one's [px]: above 0 for cameras that are toed in, whose right
                one sees more of what is near.

        Returns:
            The number of points that were measured well enough. Those beyond the map change nothing.

        Raises:
            ValueError: If the shapes of depth, confidence and rig disagree, depth is of integers, confidence exceeds 1,
                the pose is no rotation and translation, or the height is not above 0.
        """
        if np.asarray(depth).dtype.kind in "iub":
            raise ValueError(
                f"depth must be metres, as floating point, got {np.asarray(depth).dtype}: "
                "divide millimetres by 1000, and set unknown depth to NaN"
            )
        depth = filled(depth).astype(np.float32, copy=False)
        camera = rig.camera
        if depth.shape != (camera.height, camera.width):
            raise ValueError(f"depth is {depth.shape}, the rig's camera has {(camera.height, camera.width)} pixels")
        confidence = None if confidence is None else filled(confidence)
        if confidence is not None and confidence.shape != depth.shape:
            raise ValueError(f"confidence is {confidence.shape}, depth is {depth.shape}")
        if confidence is not None and (largest := np.nanmax(confidence, initial=0)) > 1 + 1e-6:
            raise ValueError(f"confidence must lie in [0, 1], its largest value is {largest:g}")
        if not camera_height > 0:
            raise ValueError(f"camera_height must be above 0 m, got {camera_height:g}")
        pose, valid = rigid_pose(camera_pose), self._valid(depth, confidence, rig, camera_height)
        points, z, trust, may_show_ground = self._points(depth, valid, confidence, rig, pose, camera_height, shift)
        if z.size:
            self._fuse(points, z, trust, may_show_ground, rig.fb)
            self._mark_drops(depth, valid, rig, pose)
        return int(z.size)

    def _valid(
        self, depth: np.ndarray, confidence: np.ndarray | None, rig: StereoRig, camera_height: float
    ) -> np.ndarray:
        """Return the pixels whose depth can be trusted, far ones and the sky included: (H, W) bool."""
        c = self.config
        with np.errstate(invalid="ignore"):
            valid = depth > c.min_range
        if confidence is not None:
            valid &= np.asarray(confidence) >= c.min_confidence
        jump = max(c.edge_jump, SLOPING_JUMP * rig.baseline / camera_height)
        return np.asarray(valid & ~depth_edges(rig.depth_to_disparity(depth), jump))

    def _points(
        self, depth: np.ndarray, valid: np.ndarray, confidence: np.ndarray | None, rig: StereoRig, pose: np.ndarray,
        camera_height: float, shift: float,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Return the points that are fused: world positions (m, 3), depth (m,), confidence (m,), and whether they may
        show ground (m,).
        """
        c = self.config
        with np.errstate(invalid="ignore"):
            use = valid & (depth < c.max_range)
            # On level ground, image rows are Z^2 / (f h) apart: near the rover every second one still hits every cell.
            use[::2] &= depth[::2] > np.sqrt(camera_height / 3 * c.cell * rig.camera.fy)
        stride = max(1, round(rig.camera.width / c.columns))
        rows, columns = np.nonzero(use[:, ::stride])
        columns *= stride
        z = depth[rows, columns]
        slope_u, slope_v = _ray_slopes(rig.camera)
        local = np.stack([slope_u[columns] * z, slope_v[rows] * z, z], axis=1)
        points = local @ pose[:3, :3].T.astype(np.float32)
        trust = np.ones_like(z) if confidence is None else np.asarray(confidence, np.float32)[rows, columns]
        in_right = columns - rig.fb / z + shift  # [px] the column at which the right eye sees the point
        may_show_ground = (trust >= c.sure_alone) | ((in_right >= 0) & (in_right < rig.camera.width))
        return points.astype(np.float64) + pose[:3, 3], z, trust, may_show_ground

    def _mark_drops(self, depth: np.ndarray, valid: np.ndarray, rig: StereoRig, pose: np.ndarray) -> None:
        """Mark the cells that one look shows to be possible drops."""
        columns = np.arange(0, rig.camera.width, max(1, round(rig.camera.width / DROP_COLUMNS)))
        xy, column = hidden_drops(depth, valid, columns, rig, pose, self.config.drops, self._ground_at)
        cell = self.cell_of(xy)
        inside = ((cell >= 0) & (cell < self.n)).all(axis=1)
        rays = np.unique((cell[inside] @ (1, self.n)) * rig.camera.width + column[inside]) // rig.camera.width
        marked, number = np.unique(rays, return_counts=True)
        self.hidden_drop.ravel()[marked[number >= DROP_RAYS]] = True

    def _ground_at(self, xy: np.ndarray) -> np.ndarray:
        """Return the measured heights of the ground (...) [m] at world positions (..., 2) [m], NaN elsewhere."""
        cell = self.cell_of(xy)
        inside = ((cell >= 0) & (cell < self.n)).all(axis=-1)
        x, y = np.moveaxis(np.clip(cell, 0, self.n - 1), -1, 0)
        return np.where(inside & (self.weight[y, x] > 0), self.low[y, x], np.nan)

    def _fuse(
        self, points: np.ndarray, z: np.ndarray, trust: np.ndarray, may_show_ground: np.ndarray, fb: float
    ) -> None:
        n = self.n
        ij = self.cell_of(points[:, :2])
        inside = ((ij >= 0) & (ij < n)).all(axis=1)
        if not inside.any():
            return
        ij, height, z, trust = ij[inside], points[inside, 2], z[inside], trust[inside]
        flat = ij[:, 1] * n + ij[:, 0]

        # One integer sort orders the points by cell, and by height [mm] inside each cell, which gives percentiles.
        base = float(height.min())
        millimetre = np.minimum((height - base) * 1000, (1 << 20) - 1).astype(np.int64)
        key = np.sort((flat << 20) | millimetre)
        cell = key >> 20
        first = np.flatnonzero(np.r_[True, cell[1:] != cell[:-1]])
        touched = cell[first]
        number = np.diff(np.r_[first, cell.size])
        ordered = (key & ((1 << 20) - 1)) * 1e-3 + base
        # Of four or more points the highest is not used: a single stray match would make a rock.
        top = ordered[first + number - 1 - (number >= 4)]
        low = ordered[first + number // 10]
        shows_ground = np.bincount(flat, may_show_ground[inside], minlength=n * n)[touched] > 0
        keep = self._credible(touched, top, low, number, shows_ground)

        sigma = z.astype(float) ** 2 / fb * self.config.disparity_sigma
        gain = np.bincount(flat, trust / sigma**2, minlength=n * n)[touched] / number * np.minimum(number, 5)
        self._blend(touched[keep], top[keep], low[keep], gain[keep])

    def _credible(
        self, touched: np.ndarray, top: np.ndarray, low: np.ndarray, number: np.ndarray, shows_ground: np.ndarray
    ) -> np.ndarray:
        """Return which cells of one look go into the map: (m,) bool.

        A cell that may not show ground has to stand out. A cell that stands out by few points needs a cell beside it
        that reaches as high: a rock as wide as a cell and as high as `stands_out` has more points, a stray match has
        not.

        Args:
            touched: (m,) flat cell indices.
            top: (m,) heights of the highest points [m].
            low: (m,) heights of the ground [m].
            number: (m,) numbers of points.
            shows_ground: (m,) bool.
        """
        c = self.config
        iy, ix = np.divmod(touched, self.n)
        iy, ix = iy - iy.min(), ix - ix.min()
        floor, highest = np.full((2, iy.max() + 1, ix.max() + 1), 1e6, np.float32)
        floor[iy, ix], highest[iy, ix] = low, -top
        window = 2 * round(c.ground_reach / c.cell) + 1
        floor = cv2.erode(floor, np.ones((window, window), np.uint8))[iy, ix]
        beside = np.ones((3, 3), np.uint8)
        beside[1, 1] = 0
        supported = -cv2.erode(highest, beside)[iy, ix] >= top - c.stands_out
        stands = top - floor >= c.stands_out
        return np.where(stands, supported | (number > c.few), shows_ground)

    def _blend(self, touched: np.ndarray, top: np.ndarray, low: np.ndarray, gain: np.ndarray) -> None:
        """Update the touched cells with one look, weighed by range error: near looks count more than far ones."""
        old = self.weight.ravel()[touched]
        k = gain / (old + gain)
        fresh = (old == 0) | (self.from_prior.ravel()[touched] & (gain > old))
        # Extremes move away from the ground quickly and come back only on better evidence: a look that shows only the
        # foot of a rock must not lower its top, but a stray point from afar disappears when the rover comes near.
        quick, slow = np.where(fresh, 1.0, np.maximum(k, 0.5)), np.where(fresh, 1.0, np.minimum(k, 0.8))
        for layer, new, sign in ((self.top, top, 1), (self.low, low, -1)):
            values = layer.ravel()
            before = np.where(fresh, 0.0, values[touched])
            values[touched] = before + np.where((new - before) * sign > 0, quick, slow) * (new - before)
        # Looks share their errors (the same matching bias), so a cell's weight saturates at four of the best looks.
        self.weight.ravel()[touched] = np.where(fresh, gain, np.maximum(old, np.minimum(old + gain, 4 * gain)))
        self.from_prior.ravel()[touched] &= gain <= old
