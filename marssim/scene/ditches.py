"""Ditches in the ground: narrow troughs with steep walls, as gullies, graben and wide cracks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from marssim.scene.relief import ReliefConfig

SPACING = 0.05  # [m] between two points of a ditch's middle line
WIDTHS_PER_MEANDER = 11.0  # length of a meander along the channel, in channel widths (Leopold and Wolman 1960)
UNEVEN = 0.15  # share by which the width varies along a ditch
FLOOR = 0.2  # least share of the width that the floor takes
ROUND = 0.2  # [m] over which brink and foot of a wall are rounded
# A ditch across a way: so wide and deep that a rover cannot drive through, and so short that it can drive round.
ACROSS: dict[str, Any] = {
    "ditch_width": (1.4, 2.5), "ditch_depth": (0.6, 1.2), "ditch_length": (8.0, 14.0), "ditch_meander_deg": (0.0, 20.0),
}  # fmt: skip
ACROSS_MIDDLE = (0.35, 0.65)  # share of the way after which it crosses
ACROSS_OFF = np.pi / 6  # [rad] largest angle between it and the right angle to the way


@dataclass(frozen=True)
class Ditch:
    """A trough along a line, with a level floor, straight walls, rounded brinks and round ends.

    Attributes:
        line: (N, 2) points of the middle line [m], SPACING apart.
        half: (N,) half the width from brink to brink at these points [m].
        depth: Depth of the floor below the ground beside the ditch [m].
        wall: Tangent of the walls' slope.
    """

    line: np.ndarray
    half: np.ndarray
    depth: float
    wall: float

    def cut(self, inward: np.ndarray) -> np.ndarray:
        """Return the depth below the ground beside the ditch [m] at distances inward from the brink (...) [m]."""
        return self.wall * (_ramp(inward) - _ramp(inward - self.depth / self.wall))

    def reaches(self, x: float, y: float, radius: float) -> bool:
        """Return whether the brink's rounding comes within a radius [m] of a point x, y [m]."""
        gap = np.hypot(*(self.line - (x, y)).T) - self.half - ROUND / 2
        return bool((gap < radius).any())


@dataclass(frozen=True)
class Ditches:
    """Ditches of a scene. Where two cross, the deeper one counts."""

    ditches: tuple[Ditch, ...]

    def add_to(self, heights: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """Cut the ditches into heights, in place. Ditches of less than 3 cells are left out.

        Args:
            heights: (ny, nx) [m].
            x: (nx,) ascending coordinates [m].
            y: (ny,) ascending coordinates [m].
        """
        cut = np.zeros_like(heights)
        for ditch in self.ditches:
            if 2 * ditch.half.mean() >= 3 * (x[1] - x[0]):
                rows, columns, inward = _inward(ditch, x, y)
                part = cut[rows, columns]
                np.maximum(part, ditch.cut(inward), out=part)
        heights -= cut


def draw_ditches(
    config: ReliefConfig, far: float, clear: tuple[tuple[float, float, float], ...], rng: np.random.Generator
) -> Ditches:
    """Draw the ditches of a scene.

    The middle lines are sine-generated curves, the shape of meanders (Langbein and Leopold 1966).

    Args:
        config: Density, sizes and walls of the ditches; sizes are uniform in the logarithm, angles uniform.
        far: Half the side of the square in which the middles of the ditches lie [m].
        clear: Discs (x, y, radius) [m]; a ditch that would reach into one is left out.
        rng: Random generator.
    """
    drawn = [_draw_ditch(config, far, rng) for _ in range(rng.poisson(config.ditch_density * (2 * far) ** 2))]
    return Ditches(tuple(ditch for ditch in drawn if not any(ditch.reaches(*disc) for disc in clear)))


def draw_ditch_across(config: ReliefConfig, way: tuple[float, float, float, float], rng: np.random.Generator) -> Ditch:
    """Draw a ditch that cuts through the middle of a straight path, and that a rover has to drive round.

    Args:
        config: Walls of the ditch; its sizes are drawn from ACROSS.
        way: x, y of the way's start and x, y of its end [m].
        rng: Random generator.
    """
    start, end = np.array(way[:2]), np.array(way[2:])
    ditch = _draw_ditch(replace(config, **ACROSS), 0.0, rng)
    towards = np.arctan2(*(end - start)[::-1]) + np.pi / 2 + rng.uniform(-ACROSS_OFF, ACROSS_OFF)
    chord = ditch.line[-1] - ditch.line[0]
    turn = towards - np.arctan2(chord[1], chord[0])
    c, s = np.cos(turn), np.sin(turn)
    # its middle point lies on the way, so that no bend leads past
    line = (ditch.line - ditch.line[len(ditch.line) // 2]) @ np.array([[c, s], [-s, c]])
    return replace(ditch, line=line + start + rng.uniform(*ACROSS_MIDDLE) * (end - start))


def _draw_ditch(config: ReliefConfig, far: float, rng: np.random.Generator) -> Ditch:
    width, depth, length = (
        float(np.exp(rng.uniform(*np.log(size))))
        for size in (config.ditch_width, config.ditch_depth, config.ditch_length)
    )
    wall = float(np.tan(np.deg2rad(rng.uniform(*config.ditch_wall_deg))))
    swing = np.deg2rad(rng.uniform(*config.ditch_meander_deg))
    middle, towards = rng.uniform(-far, far, 2), rng.uniform(0, 2 * np.pi)
    bend_phase, width_phase = rng.uniform(0, 2 * np.pi, 2)
    along = np.arange(0, max(length - width, SPACING), SPACING)  # the round ends add the width
    turn = 2 * np.pi * along / (WIDTHS_PER_MEANDER * width)
    heading = towards + swing * np.sin(turn + bend_phase)
    line = SPACING * np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    half = width / 2 * (1 + UNEVEN * np.sin(np.e * turn + width_phase))  # out of step with the meanders
    return Ditch(line - line.mean(axis=0) + middle, half, min(depth, (1 - FLOOR) / 2 * width * wall), wall)


def _inward(ditch: Ditch, x: np.ndarray, y: np.ndarray) -> tuple[slice, slice, np.ndarray]:
    """Return the rows and columns of a grid that a ditch touches, and their distances inward from its brink [m].

    The ditch is the union of discs about the points of its line. Nodes outside have -ROUND or less.
    """
    reach = ditch.half[:, None] + ROUND
    low, high = (ditch.line - reach).min(axis=0), (ditch.line + reach).max(axis=0)
    (i0, i1), (j0, j1) = np.searchsorted(x, (low[0], high[0])), np.searchsorted(y, (low[1], high[1]))
    x, y = x[i0:i1], y[j0:j1]
    out = np.full((len(y), len(x)), -ROUND)
    for (cx, cy), half, r in zip(ditch.line, ditch.half, reach[:, 0]):
        i, j = slice(*np.searchsorted(x, (cx - r, cx + r))), slice(*np.searchsorted(y, (cy - r, cy + r)))
        part = out[j, i]
        np.maximum(part, half - np.hypot(x[i] - cx, y[j, None] - cy), out=part)
    return slice(j0, j1), slice(i0, i1), out


def _ramp(u: np.ndarray) -> np.ndarray:
    """Return max(u, 0) with its corner rounded over ROUND [m]."""
    inside = np.clip(u + ROUND / 2, 0, ROUND)
    return np.where(u < ROUND / 2, inside**2 / (2 * ROUND), u)
