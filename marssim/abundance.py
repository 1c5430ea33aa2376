"""Measure how much of the ground rocks cover, and set it beside Golombek's law.

    python -m marssim.abundance --scene gale --scenes 8 --seed 1
    python -m marssim.abundance --rocks.k 0.1 --rocks.cluster 1

Rays are shot straight down on finished scenes, on a grid of --cell, and say which rock each spot of ground shows. The
area of a rock's visible spots is that of a disc of diameter D; the areas of all rocks of D and more, over the ground
looked at, are F_k(D). Nothing is read from the list that the scene was drawn from: burial, overlap and relief act on
what is measured as they do on a picture from orbit. Scenes correct for burial: each rock is widened until what stands
out of the ground has the outline of the diameter that was drawn for it. A rock counts, with its whole area, where the
middle of its visible part lies a margin inside the finely gridded square, so that none is cut by the border.

Rocks fall by chance: "spread" is the standard deviation that this gives to the share of the ground, and "allowed" is
10 % or three times that, whichever is larger. Where less than a few rocks are expected, one more lies outside.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import tyro

from marssim.base.command.flags import parse
from marssim.base.command.notes import counted
from marssim.base.command.run import exit_code
from marssim.engines.embree import TriangleRays
from marssim.generation.config import named_scene
from marssim.scene.golombek import MAX_DIAMETER, REPORTED, covered_area, number_density, sampling_spread
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.rocks import RockConfig
from marssim.scene.scene import PRESETS, Scene, build_scene

BAND = 2.0  # [m] of ground that is looked at in one go
LEAST_TOLERANCE = 0.10  # of the asked share
SPREADS = 3.0


@dataclass(frozen=True, kw_only=True)
class AbundanceConfig:
    """Measure the rock abundance of drawn scenes from straight above."""

    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """preset that the scenes are drawn from; `--scene NAME --help` shows its rocks as the defaults of --rocks"""
    rocks: RockConfig
    scenes: int = 8
    """number of scenes to draw and measure together"""
    seed: int = 1
    """seed of the scenes, 0 or more"""
    cell: float = 0.01
    """distance between rays [m]"""

    def __post_init__(self) -> None:
        if self.scenes < 1:
            raise ValueError(f"--scenes must be at least 1, got {self.scenes}")
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        if not 0.002 <= self.cell <= 0.05:
            raise ValueError(f"--cell must lie in [0.002, 0.05] m, got {self.cell}")


@dataclass(frozen=True)
class Abundance:
    """F_k at diameters (D,) [m]: asked, achieved by so many rocks, and the standard deviation that chance gives it.

    expected: number of rocks that the law has there. area: ground looked at [m2].
    """

    diameter: np.ndarray
    rocks: np.ndarray
    expected: np.ndarray
    asked: np.ndarray
    achieved: np.ndarray
    spread: np.ndarray
    area: float

    @property
    def tolerance(self) -> np.ndarray:
        """How far achieved may lie from asked: 10 % or three times the spread, whichever is larger."""
        return np.maximum(LEAST_TOLERANCE * self.asked, SPREADS * self.spread)

    @property
    def within(self) -> np.ndarray:
        """(D,) bool: achieved is within tolerance."""
        return np.abs(self.achieved - self.asked) <= self.tolerance

    def table(self) -> str:
        """One line a diameter, shares in percent of the ground."""
        lines = ["D [m]  asked %  achieved %  ratio   rocks  expected  spread %  allowed +- %"]
        for d, asked, achieved, rocks, expected, spread, tolerance, good in zip(
            self.diameter,
            self.asked,
            self.achieved,
            self.rocks,
            self.expected,
            self.spread,
            self.tolerance,
            self.within,
        ):
            ratio = achieved / asked if asked > 0 else float("nan")
            lines.append(
                f"{d:5.2f} {100 * asked:8.3f} {100 * achieved:11.3f} {ratio:6.3f} {rocks:7d} {expected:9.1f} "
                f"{100 * spread:9.3f} {100 * tolerance:13.3f}" + ("" if good else "  outside")
            )
        return "\n".join(lines)


def visible_areas(scene: Scene, cell: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """What of each rock is seen from straight above.

    cell: [m] between rays; looked at is the finely gridded square. Returns the area (N,) [m2] of each rock, and the
    middle (N, 2) [m] of what is seen of it, nan where nothing is.
    """
    rocks, half = scene.rocks, scene.half
    vertices, faces = scene.terrain.fine.mesh()
    ground = len(faces)
    faces = np.concatenate([faces, rocks.faces + len(vertices)])
    vertices = np.concatenate([vertices, rocks.vertices])
    triangles = TriangleRays(vertices, faces)
    above = np.float32(vertices[:, 2].max() + 1.0)

    steps = round(2 * half / cell)
    at = ((np.arange(steps) + 0.5) / steps * 2 - 1) * half
    rows = max(1, round(BAND / cell))
    count, moment = np.zeros(len(rocks)), np.zeros((len(rocks), 2))
    for start in range(0, steps, rows):
        band = at[start : start + rows]
        origins = np.empty((len(band) * steps, 3), dtype=np.float32)
        origins[:, 0], origins[:, 1], origins[:, 2] = np.tile(at, len(band)), np.repeat(band, steps), above
        down = np.zeros_like(origins)
        down[:, 2] = -1
        face = triangles.meet(origins, down)[0]
        spot = np.flatnonzero(face >= ground)
        rock = rocks.face_rock[face[spot] - ground]
        count += np.bincount(rock, minlength=len(rocks))
        for axis in range(2):
            moment[:, axis] += np.bincount(rock, origins[spot, axis], minlength=len(rocks))
    with np.errstate(invalid="ignore"):
        return count * (2 * half / steps) ** 2, moment / count[:, None]


def measure(scenes: Iterable[Scene], k: float, cell: float = 0.01) -> Abundance:
    """F_k(D) of some scenes taken together, for D = 0.1 m to 0.5 m. k: what was asked of them."""
    diameter = np.array(REPORTED)
    covered, rocks, area = np.zeros(len(diameter)), np.zeros(len(diameter), dtype=int), 0.0
    for scene in scenes:
        outline, middle = visible_areas(scene, cell)
        inside = scene.half - MAX_DIAMETER / 2
        counts = (np.abs(middle) <= inside).all(axis=1)  # nan, which is not seen, does not count
        seen = np.sqrt(4 / np.pi * outline)
        for row, d in enumerate(diameter):
            large = counts & (seen >= d)
            covered[row] += outline[large].sum()
            rocks[row] += large.sum()
        area += (2 * inside) ** 2
    return Abundance(
        diameter=diameter, rocks=rocks, expected=number_density(diameter, k) * area,
        asked=covered_area(diameter, k), achieved=covered / area, spread=sampling_spread(diameter, k, area), area=area,
    )  # fmt: skip


def abundance(config: AbundanceConfig) -> Abundance:
    """Draw the scenes and measure them."""
    scene = replace(load_place(config.scene), rocks=config.rocks)
    drawn = (build_scene(scene, np.random.default_rng((config.seed, n))) for n in range(config.scenes))
    return measure(drawn, config.rocks.k, config.cell)


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return exit_code(lambda: _work(_parse(sys.argv[1:] if args is None else args)), "nothing was written")


def _parse(args: Sequence[str]) -> AbundanceConfig:
    scene = named_scene(args)
    default = AbundanceConfig(scene=scene, rocks=load_place(scene).rocks)
    return parse(AbundanceConfig, "python -m marssim.abundance", __doc__, args, default)


def _work(config: AbundanceConfig) -> None:
    result = abundance(config)
    scenes = f"{counted(config.scenes, 'scene')} of {config.scene}"
    print(f"{scenes}, k {config.rocks.k:g}, {result.area:.0f} m2 seen from above")
    print(result.table())


if __name__ == "__main__":
    sys.exit(main())
