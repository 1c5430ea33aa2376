"""Measure how much of the ground rocks cover in scenes, and compare it with Golombek's law.

    python -m marssim.abundance --scene gale --scenes 8 --seed 1
    python -m marssim.abundance --rocks.k 0.1 --rocks.cluster 1

The command traces rays straight down onto scenes, on a grid of --cell, and counts which rock each of them hits. A rock
has the diameter D of a disc with its visible area. F_k(D) is the area of all rocks of D and more over the area of the
ground. It does not use the list of rocks of a scene, so that burial, overlap and relief act as in a picture from orbit.
Scenes make up for burial: each rock is widened until the part above ground has the outline of the diameter that was
drawn for it. The sand of `look.drifts` is left out: seen from above, it hides about a thirtieth of the rocks' area in
jezero at 0.6, and a seventeenth at 1. A rock counts with its whole area if the middle of its visible part lies in the
finely gridded square, a margin inside its border, so that the border cuts none.

The number of rocks is random. "spread" is the standard deviation of the share of the ground that follows, and "allowed"
is 10 % of the share or three times the spread, whichever is larger. Where only few rocks are expected, a single rock
can exceed it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import tyro

from marssim.base.command.flags import parse
from marssim.base.command.limits import check_least
from marssim.base.command.run import exit_code
from marssim.base.command.wording import counted
from marssim.engines.embree import TriangleRays
from marssim.generation.config import named_scene
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS
from marssim.scene.rocks.golombek import MAX_DIAMETER, REPORTED, covered_area, number_density, sampling_spread
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, build_scene

BAND = 2.0  # width of the strip of ground that is traced at a time [m]
LEAST_TOLERANCE = 0.10  # relative, of the share that was asked for
SPREADS = 3.0  # allowed deviation, in standard deviations


@dataclass(frozen=True, kw_only=True)
class AbundanceConfig:
    """Measure the rock abundance of scenes from straight above."""

    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place that the scenes are drawn from: a preset, or a JSON file of your own place. `--scene NAME --help` shows its
    values as the defaults of --rocks."""
    rocks: RockConfig
    scenes: int = 8
    """Number of scenes, 1 or more, that are measured together."""
    seed: int = 1
    """Seed of the scenes, 0 or more."""
    cell: float = 0.01
    """Distance between the rays [m], 0.002 to 0.05."""

    def __post_init__(self) -> None:
        check_least(self, scenes=1, seed=0)
        if not 0.002 <= self.cell <= 0.05:
            raise ValueError(f"cell must lie in [0.002, 0.05] m, got {self.cell}")


@dataclass(frozen=True)
class Abundance:
    """Share of the ground under rocks of each diameter and more, as asked for and as measured.

    Attributes:
        diameter: (D,) diameters [m].
        rocks: (D,) number of rocks of each diameter and more.
        expected: (D,) number of rocks by the law.
        asked: (D,) share of the ground by the law.
        achieved: (D,) measured share of the ground.
        spread: (D,) standard deviation of the share by chance.
        area: Ground that was measured [m2].
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
        """(D,) largest difference of achieved and asked that is allowed: 10 % or three times the spread."""
        return np.maximum(LEAST_TOLERANCE * self.asked, SPREADS * self.spread)

    @property
    def within(self) -> np.ndarray:
        """(D,) bool, whether the difference is allowed."""
        return np.abs(self.achieved - self.asked) <= self.tolerance

    def table(self) -> str:
        """Return the shares as text in percent of the ground, a line for each diameter."""
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
    """Measure the visible part of each rock from straight above, in the finely gridded square.

    Args:
        scene: The scene.
        cell: Distance between the rays [m].

    Returns:
        The visible area (N,) of each rock [m2], and the middle (N, 2) of its visible part [m], NaN if it has none.
    """
    bodies, half = scene.bodies, scene.half  # rocks may lie on slabs or under a ledge, which come after the rocks
    vertices, faces = scene.terrain.fine.mesh()
    ground = len(faces)
    faces = np.concatenate([faces, bodies.faces + len(vertices)])
    vertices = np.concatenate([vertices, bodies.vertices])
    triangles = TriangleRays(vertices, faces)
    above = np.float32(vertices[:, 2].max() + 1.0)

    steps = round(2 * half / cell)
    at = ((np.arange(steps) + 0.5) / steps * 2 - 1) * half
    rows = max(1, round(BAND / cell))
    count, moment = np.zeros(len(bodies)), np.zeros((len(bodies), 2))
    for start in range(0, steps, rows):
        band = at[start : start + rows]
        origins = np.empty((len(band) * steps, 3), dtype=np.float32)
        origins[:, 0], origins[:, 1], origins[:, 2] = np.tile(at, len(band)), np.repeat(band, steps), above
        down = np.zeros_like(origins)
        down[:, 2] = -1
        face = triangles.meet(origins, down)[0]
        spot = np.flatnonzero(face >= ground)
        rock = bodies.face_rock[face[spot] - ground]
        count += np.bincount(rock, minlength=len(bodies))
        for axis in range(2):
            moment[:, axis] += np.bincount(rock, origins[spot, axis], minlength=len(bodies))
    with np.errstate(invalid="ignore"):
        areas, middles = count * (2 * half / steps) ** 2, moment / count[:, None]
    return areas[: len(scene.rocks)], middles[: len(scene.rocks)]


def measure(scenes: Iterable[Scene], k: float, cell: float = 0.01) -> Abundance:
    """Measure F_k(D) over scenes, for D = 0.1 m to 0.5 m.

    Args:
        scenes: The scenes.
        k: Rock abundance that they were asked for.
        cell: Distance between the rays [m].

    Raises:
        ValueError: A scene has no ground whose rocks its border cannot cut.
    """
    diameter = np.array(REPORTED)
    covered, rocks, area = np.zeros(len(diameter)), np.zeros(len(diameter), dtype=int), 0.0
    for scene in scenes:
        inside = scene.half - MAX_DIAMETER / 2
        if not inside > 0:
            raise ValueError(
                f"size must be above {MAX_DIAMETER:g} m, the diameter of the largest rocks, got {2 * scene.half:g}"
            )
        outline, middle = visible_areas(scene, cell)
        counts = (np.abs(middle) <= inside).all(axis=1)  # false for NaN, the middle of hidden rocks
        size = np.sqrt(4 / np.pi * outline)
        for row, d in enumerate(diameter):
            large = counts & (size >= d)
            covered[row] += outline[large].sum()
            rocks[row] += large.sum()
        area += (2 * inside) ** 2
    return Abundance(
        diameter=diameter, rocks=rocks, expected=number_density(diameter, k) * area,
        asked=covered_area(diameter, k), achieved=covered / area, spread=sampling_spread(diameter, k, area), area=area,
    )  # fmt: skip


def abundance(config: AbundanceConfig) -> Abundance:
    """Build the scenes of a config and measure them."""
    scene = replace(load_place(config.scene), rocks=config.rocks)
    drawn = (build_scene(scene, np.random.default_rng((config.seed, n))) for n in range(config.scenes))
    return measure(drawn, config.rocks.k, config.cell)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return exit_code(lambda: _work(_parse(sys.argv[1:] if args is None else args)), "nothing was written")


def _parse(args: Sequence[str]) -> AbundanceConfig:
    scene = named_scene(args)
    default = AbundanceConfig(scene=scene, rocks=load_place(scene).rocks)
    return parse(AbundanceConfig, "python -m marssim.abundance", __doc__, args, default)


def _work(config: AbundanceConfig) -> None:
    result = abundance(config)
    scenes = f"{counted(config.scenes, 'scene')} of {config.scene}"
    print(f"{scenes}, k {config.rocks.k:g}, {result.area:.0f} m2 of ground")
    print(result.table())


if __name__ == "__main__":
    sys.exit(main())
