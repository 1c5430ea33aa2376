"""Measure how much of the ground the visible rocks cover, on the ground truth of stereo pairs.

A rock's diameter is its width across the line of sight, and its area is that of a disc of this diameter. The ground is
the area that an image covers on a map up to a distance: of the plane through the visible ground, also where rocks hide
it. Images show rocks from the side, partly hidden by others and cut by the border. These errors nearly cancel: on
1000 m2 each of utopia, gale and jezero (72 views), rocks of 0.1 m and more gave 1.09, 1.02 and 0.99 times their true
area. The rocks on a piece of ground vary by chance; golombek.sampling_spread gives the standard deviation. It is larger
where rocks lie in clusters, and where views show the same ground, as those of a drive do, which counts in each of them.
marssim.abundance measures whole scenes from above.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from marssim.base.angle import wrapped
from marssim.base.dataset.sample import StereoSample
from marssim.base.pose import rotate
from marssim.scene.rocks.golombek import covered_area, sampling_spread

REACH = 6.0  # [m] farthest ground that counts: a rock of 0.1 m is 10 px wide there
DIAMETERS = (0.1, 0.2, 0.3, 0.5)  # [m] least diameters of the rocks that are reported


@dataclass
class RockCover:
    """Sums over samples: the ground, and the part of it that rocks cover.

    Attributes:
        ground: Ground that the samples show [m2].
        covered: (D,) ground under rocks of each of DIAMETERS and more [m2].
        asked: (D,) the same by the law for k that each scene was asked for [m2].
        variance: (D,) variance of `covered` that chance gives it [m4].
    """

    ground: float = 0.0
    covered: np.ndarray = field(default_factory=lambda: np.zeros(len(DIAMETERS)))
    asked: np.ndarray = field(default_factory=lambda: np.zeros(len(DIAMETERS)))
    variance: np.ndarray = field(default_factory=lambda: np.zeros(len(DIAMETERS)))

    def add(self, sample: StereoSample, k: float) -> None:
        """Add a sample.

        Args:
            sample: The sample.
            k: Rock abundance that its scene was asked for.
        """
        _, diameter, ground = visible_rocks(sample)
        area = np.pi / 4 * diameter**2
        self.ground += ground
        self.covered += [area[diameter >= d].sum() for d in DIAMETERS]
        self.asked += covered_area(np.array(DIAMETERS), k) * ground
        if ground:
            self.variance += (sampling_spread(np.array(DIAMETERS), k, ground) * ground) ** 2

    def report(self) -> dict[str, Any]:
        """Return shares of the ground as plain numbers, for JSON.

        "seen" and "asked" are those under rocks of each diameter and more, and "spread" is the standard deviation that
        chance gives them. Empty if there is no ground.
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
        """Return the report as lines of text."""
        report = self.report()
        if not report:
            return ""
        lines = [
            f"share of the ground under rocks of diameter D and more, on {self.ground:.0f} m2 up to {REACH:g} m away; "
            f"spread: standard deviation by chance, which is larger where views show the same ground"
        ]
        for d, measured, asked, spread in zip(DIAMETERS, report["seen"], report["asked"], report["spread"]):
            lines.append(f"  D {d:.1f} m: seen {measured:.2%}, asked {asked:.2%}, spread {spread:.2%}")
        return "\n".join(lines)


def visible_rocks(sample: StereoSample, reach: float = REACH) -> tuple[np.ndarray, np.ndarray, float]:
    """Measure the rocks and the ground that a sample shows.

    Args:
        sample: The sample.
        reach: Farthest rocks and ground, along the ground [m].

    Returns:
        The rocks' numbers (N,) and diameters (N,) [m], and the map area of the ground, with the rocks' own [m2].

    Raises:
        KeyError: The sample records no pose.
    """
    pose, camera = np.array(sample.meta["pose"], dtype=float), sample.rig.camera
    hit = np.isfinite(sample.depth)
    rays = rotate(camera.rays(), pose[:3, :3])
    offset = rays * np.where(hit, sample.depth, 0)[..., None]  # from the camera, world axes
    distance = np.hypot(offset[..., 0], offset[..., 1])
    open_view = rays[sample.rock >= 0]  # the ground behind the rover itself does not count
    area = _map_area(open_view, offset[hit & (sample.rock == 0) & (distance <= reach)], reach) / (camera.fx * camera.fy)

    rock = hit & (sample.rock > 0) & (sample.rock <= _last_rock(sample)) & (distance <= 2 * reach)
    if not rock.any():
        return np.zeros(0, dtype=int), np.zeros(0), area
    forward = np.arctan2(pose[1, 2], pose[0, 2])
    heading = wrapped(np.arctan2(offset[rock][:, 1], offset[rock][:, 0]) - forward)
    order = np.argsort(sample.rock[rock], kind="stable")
    number, start, count = np.unique(sample.rock[rock][order], return_index=True, return_counts=True)
    away = np.add.reduceat(distance[rock][order], start) / count
    depth = np.add.reduceat(sample.depth[rock][order].astype(float), start) / count
    extent = np.maximum.reduceat(heading[order], start) - np.minimum.reduceat(heading[order], start)
    diameter = extent * away + depth / camera.fx  # between pixel centres, and a pixel
    near = away + diameter / 2 <= reach  # the visible front is half a diameter nearer than the middle
    return number[near], diameter[near], area


def _last_rock(sample: StereoSample) -> float:
    """Return the number of the last rock. Greater numbers are slabs, ledges and fragments, which the law leaves out."""
    ids = sample.meta.get("surface_ids")
    return np.inf if ids is None else max(ids["rocks"], default=0)


def _map_area(rays: np.ndarray, ground: np.ndarray, reach: float) -> float:
    """Return the map area of the ground up to `reach` [m], times fx fy, on the plane through the ground points.

    Args:
        rays: (..., 3) rays of the pixels with camera z = 1, world axes.
        ground: (N, 3) visible points of the ground, world axes, from the camera [m].
        reach: Farthest ground [m].
    """
    if len(ground) < 3:
        return 0.0
    weight = np.einsum("ij,ij->i", ground, ground)  # pixels lie denser on near ground
    system = np.column_stack([ground[:, :2], np.ones(len(ground))]) * weight[:, None]
    slope_x, slope_y, height = np.linalg.lstsq(system, ground[:, 2] * weight, rcond=None)[0]
    fall = rays[..., 2] - slope_x * rays[..., 0] - slope_y * rays[..., 1]
    with np.errstate(divide="ignore"):
        depth = np.where(height / fall > 0, height / fall, np.inf)
    near = depth * np.hypot(rays[..., 0], rays[..., 1]) <= reach
    return float((depth[near] ** 2 / np.abs(fall[near])).sum())
