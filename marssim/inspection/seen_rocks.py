"""How much of the ground rocks cover, measured on the ground truth of stereo pairs.

A rock's diameter is its width across the line of sight; the area that goes with it is that of a disc. The ground looked
at is what the image covers on a map, up to a distance: the plane through the ground that is seen, also where rocks
hide it. Rocks are seen from the side, partly hidden by others and cut by the image's border; all in all, on 1000 m2
each of utopia, gale and jezero (72 views), rocks of 0.1 m and more gave 1.09, 1.02 and 0.99 times the area of those
that stood there. What stands there is by chance, as the views are; golombek.sampling_spread says how much on so much
ground. It is more where rocks lie in clusters, and where views share ground, as those of a drive: it is counted for
each. marssim.abundance measures whole scenes from above.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from marssim.base.camera import rotate
from marssim.base.dataset.sample import StereoSample
from marssim.scene.golombek import covered_area, sampling_spread

REACH = 6.0  # [m] of ground that is looked at: 0.1 m are 10 px there
DIAMETERS = (0.1, 0.2, 0.3, 0.5)  # [m]


@dataclass
class RockCover:
    """Rocks and ground of some samples; they add up. asked: (D,) sum of k's law times ground [m2].

    variance: (D,) of what is covered [m4], by the chance that puts rocks on the ground of each sample.
    """

    ground: float = 0.0
    covered: np.ndarray = field(default_factory=lambda: np.zeros(len(DIAMETERS)))
    asked: np.ndarray = field(default_factory=lambda: np.zeros(len(DIAMETERS)))
    variance: np.ndarray = field(default_factory=lambda: np.zeros(len(DIAMETERS)))

    def add(self, sample: StereoSample, k: float) -> None:
        """Count the rocks of one more sample, whose scene was asked for a share k."""
        _, diameter, ground = seen_rocks(sample)
        area = np.pi / 4 * diameter**2
        self.ground += ground
        self.covered += [area[diameter >= d].sum() for d in DIAMETERS]
        self.asked += covered_area(np.array(DIAMETERS), k) * ground
        if ground:
            self.variance += (sampling_spread(np.array(DIAMETERS), k, ground) * ground) ** 2

    def report(self) -> dict[str, Any]:
        """Plain numbers, for JSON: share of the ground under rocks of each diameter and more, seen and asked for.

        spread: standard deviation of the share by chance.
        """
        if not self.ground:
            return {}
        return {
            "ground_m2": self.ground,
            "diameters_m": list(DIAMETERS),
            "seen": (self.covered / self.ground).tolist(),
            "asked": (self.asked / self.ground).tolist(),
            "spread": (np.sqrt(self.variance) / self.ground).tolist(),
        }

    def table(self) -> str:
        """In lines for people."""
        report = self.report()
        if not report:
            return ""
        lines = [
            f"ground under rocks of diameter D and more, on {self.ground:.0f} m2 up to {REACH:g} m away; "
            f"spread: standard deviation by chance, more where views share ground"
        ]
        for d, seen, asked, spread in zip(DIAMETERS, report["seen"], report["asked"], report["spread"]):
            lines.append(f"  D {d:.1f} m: seen {seen:.2%}, asked {asked:.2%}, spread {spread:.2%}")
        return "\n".join(lines)


def seen_rocks(sample: StereoSample, reach: float = REACH) -> tuple[np.ndarray, np.ndarray, float]:
    """Rocks and ground no farther than `reach` [m] along the ground.

    Returns the rocks' numbers (N,) and diameters (N,) [m], and the map area of the ground, rocks' included [m2]. Raises
    KeyError if the sample records no pose.
    """
    pose, camera = np.array(sample.meta["pose"], dtype=float), sample.rig.camera
    hit = np.isfinite(sample.depth)
    rays = rotate(camera.rays(), pose[:3, :3])
    offset = rays * np.where(hit, sample.depth, 0)[..., None]  # from the camera, world axes
    distance = np.hypot(offset[..., 0], offset[..., 1])
    area = _map_area(rays, offset[hit & (sample.rock == 0) & (distance <= reach)], reach) / (camera.fx * camera.fy)

    rock = hit & (sample.rock > 0) & (distance <= 2 * reach)
    if not rock.any():
        return np.zeros(0, dtype=int), np.zeros(0), area
    forward = np.arctan2(pose[1, 2], pose[0, 2])
    heading = np.arctan2(offset[rock][:, 1], offset[rock][:, 0]) - forward
    heading = (heading + np.pi) % (2 * np.pi) - np.pi
    order = np.argsort(sample.rock[rock], kind="stable")
    number, start, count = np.unique(sample.rock[rock][order], return_index=True, return_counts=True)
    away = np.add.reduceat(distance[rock][order], start) / count
    depth = np.add.reduceat(sample.depth[rock][order].astype(float), start) / count
    extent = np.maximum.reduceat(heading[order], start) - np.minimum.reduceat(heading[order], start)
    diameter = extent * away + depth / camera.fx  # between pixel centres, and a pixel
    near = away + diameter / 2 <= reach  # what is seen is the front
    return number[near], diameter[near], area


def _map_area(rays: np.ndarray, ground: np.ndarray, reach: float) -> float:
    """Map area of the image's ground up to `reach`, times fx fy, on the plane through the ground points.

    rays: (H, W, 3) of camera z = 1, ground: (N, 3), both world axes from the camera.
    """
    if len(ground) < 3:
        return 0.0
    weight = np.einsum("ij,ij->i", ground, ground)  # pixels are the denser the nearer they are
    system = np.column_stack([ground[:, :2], np.ones(len(ground))]) * weight[:, None]
    slope_x, slope_y, height = np.linalg.lstsq(system, ground[:, 2] * weight, rcond=None)[0]
    fall = rays[..., 2] - slope_x * rays[..., 0] - slope_y * rays[..., 1]
    with np.errstate(divide="ignore"):
        depth = np.where(height / fall > 0, height / fall, np.inf)
    near = depth * np.hypot(rays[..., 0], rays[..., 1]) <= reach
    return float((depth[near] ** 2 / np.abs(fall[near])).sum())
