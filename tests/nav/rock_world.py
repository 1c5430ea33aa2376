"""A flat plain with rocks and trenches, seen by exact ray casting; independent of everything that is tested."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.base.camera import NATECAM, StereoRig

SMALL_RIG = NATECAM.resized(192, 192)


@dataclass
class RockWorld:
    """domes: (k, 4) x, y, radius, height of half ellipsoids; boxes: (k, 5) x, y, half-width x, half-width y, height;
    trenches: (k, 5) x, y, half-width x, half-width y, depth, their walls upright; slope: (2,) of the plain along x and
    y. The plain is flat when there are rocks or trenches."""

    domes: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    boxes: np.ndarray = field(default_factory=lambda: np.zeros((0, 5)))
    slope: tuple[float, float] = (0.0, 0.0)
    trenches: np.ndarray = field(default_factory=lambda: np.zeros((0, 5)))

    def depth(self, rig: StereoRig, camera_pose: np.ndarray) -> np.ndarray:
        """(H, W) float32 depth along the optical axis, inf for sky."""
        o = camera_pose[:3, 3]
        d = rig.camera.rays() @ camera_pose[:3, :3].T
        sx, sy = self.slope
        with np.errstate(divide="ignore", invalid="ignore"):
            out = (sx * o[0] + sy * o[1] - o[2]) / (d[..., 2] - sx * d[..., 0] - sy * d[..., 1])
            out = np.where(out > 0, out, np.inf)
            x, y = (o[i] + out * d[..., i] for i in (0, 1))
            for cx, cy, hx, hy, depth in self.trenches:
                low, high = np.array([cx - hx, cy - hy, -depth]), np.array([cx + hx, cy + hy, 1e3])
                leave = np.maximum((low - o) / d, (high - o) / d).min(-1)
                out = np.where((np.abs(x - cx) < hx) & (np.abs(y - cy) < hy), leave, out)
            for x, y, radius, height in self.domes:
                if np.hypot(x - o[0], y - o[1]) > 14:
                    continue  # beyond what the map takes in
                scale = np.array([1 / radius, 1 / radius, 1 / height])
                p, q = (o - [x, y, 0]) * scale, d * scale
                a, b, c = (q * q).sum(-1), q @ p, p @ p - 1
                root = b * b - a * c
                hit = (-b - np.sqrt(np.where(root > 0, root, np.nan))) / a
                out = np.where((hit > 0) & (hit < out), hit, out)
            for x, y, hx, hy, height in self.boxes:
                low, high = np.array([x - hx, y - hy, -1.0]), np.array([x + hx, y + hy, height])
                t0, t1 = (low - o) / d, (high - o) / d
                enter, leave = np.minimum(t0, t1).max(-1), np.maximum(t0, t1).min(-1)
                out = np.where((enter <= leave) & (enter > 0) & (enter < out), enter, out)
        return out.astype(np.float32)

    def touches(self, x: float, y: float, yaw: float, length: float, width: float, obstacle: float = 0.3) -> bool:
        """Whether a footprint rectangle overlaps a trench or a rock of at least the given height (domes: any part)."""
        c, s = np.cos(yaw), np.sin(yaw)
        u, v = (a.ravel() for a in np.meshgrid(*(np.linspace(-size / 2, size / 2, 9) for size in (length, width))))
        for cx, cy, hx, hy, _ in self.trenches:
            if ((np.abs(x + c * u - s * v - cx) < hx) & (np.abs(y + s * u + c * v - cy) < hy)).any():
                return True
        for px, py, radius, height in self.domes:
            if height < obstacle:
                continue
            u, v = c * (px - x) + s * (py - y), -s * (px - x) + c * (py - y)
            if np.hypot(max(abs(u) - length / 2, 0), max(abs(v) - width / 2, 0)) < radius:
                return True
        return False


def body_pose(x: float, y: float, yaw: float) -> np.ndarray:
    """(4, 4) body to world on level ground at height 0."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])
