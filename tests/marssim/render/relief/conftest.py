"""Ground with a closed form: a plane with a sinusoidal ripple and hemispherical pebbles on it."""

from dataclasses import dataclass

import numpy as np
import pytest

from marssim.inspection.tilted_planes import plane
from marssim.render.relief.ground import Ground, ground_relief
from marssim.render.relief.stones.bodies import (
    AX,
    BARE,
    BY,
    CELLS,
    EAST,
    FIELDS,
    MIDDLE,
    NORTH,
    PER_SIDE,
    PLANES,
    REACH,
    RISE,
    SAND_STONES,
    SIDE,
    SIZE,
    TOP,
    Stones,
    X,
    Y,
    _cells,
    placed_stones,
)
from marssim.render.relief.tiles import Tile, tile_levels
from marssim.scene.scene import Scene

CELL, PITCH = 0.08, 0.16  # [m] cells of the pebbles, and distance between pebbles
NODES, PER_WAVE = 256, 32  # nodes along a side of the ripples' tile, and nodes a wave


@pytest.fixture
def laid() -> type:
    """The class Laid."""
    return Laid


@dataclass(frozen=True)
class Laid:
    """A plane z = tilt . (x, y) with ripples and pebbles. All in metres; radius 0: no pebbles; layer: of Relief."""

    tilt: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.035
    corner: tuple[float, float] = (0.03, 0.05)
    height: float = 0.006
    wavelength: float = 0.16
    turn: float = 0.7
    layer: str = "fractal"

    @property
    def top(self) -> float:
        """The greatest height over the plane."""
        return self.radius + self.height

    def scene(self) -> Scene:
        return plane(np.array(self.tilt))

    def ground(self) -> Ground:
        """Return this ground as kernels take it."""
        ground = ground_relief(self.scene())
        wave = self.height * np.sin(2 * np.pi * np.arange(NODES) / PER_WAVE)
        field, spacing = np.broadcast_to(wave, (NODES, NODES)), self.wavelength / PER_WAVE
        levels = 4 if self.layer == "fractal" else 1
        tile = Tile(
            np.int32(len(ground.data)), np.int32(NODES), np.int32(levels), np.float32(spacing),
            np.float32(np.cos(self.turn)), np.float32(np.sin(self.turn)), np.float32(3.0),
        )  # fmt: skip
        data = np.concatenate([ground.data, tile_levels(field, spacing, levels)])
        relief = ground.relief
        sand = relief.cover.share + 3 * np.arange(relief.cover.nodes**2)
        data[sand] = self.layer == "ripples"
        if self.layer == "fractal":
            relief = relief._replace(
                fractal=tile, strength=np.float32(1), grain=relief.grain._replace(levels=np.int32(0))
            )
        else:
            relief = relief._replace(
                ripples=tile, ripple_height=np.float32(1), ripple_length=np.float32(self.wavelength),
                strength=np.float32(0),
            )  # fmt: skip
        steepest = np.float32(2.5 * np.pi * self.height / self.wavelength + 0.05)
        return ground._replace(data=data, relief=relief, stones=self.pebbles(), steepest=steepest)

    def pebbles(self) -> Stones:
        side = CELLS // 2
        j, i = np.indices((side, side)).reshape(2, -1)
        stone = np.zeros((side * side, FIELDS))
        radius = self.radius or 0.01
        stone[:, X], stone[:, Y] = (i + 0.5) * PITCH, (j + 0.5) * PITCH
        stone[:, [AX, BY, RISE]] = 1 / radius
        stone[:, MIDDLE], stone[:, REACH], stone[:, SIZE] = 0, radius, 2 * radius
        start, member, entry = _cells(stone, CELL)
        planes = np.zeros((1, PLANES, 4), dtype=np.float32)
        planes[..., 2], planes[..., 3] = 1, 2
        octave = np.zeros((1, 7), dtype=np.float32)
        octave[0, [SIDE, PER_SIDE, TOP, EAST, NORTH]] = CELL, 1 / CELL, radius, *self.corner
        octave[0, BARE] = 1 / (1 - SAND_STONES) if self.radius else 0  # as many on sand as there may be
        stones = Stones(
            start.astype(np.int32), member.astype(np.int32), entry.astype(np.float32), stone.astype(np.float32),
            np.zeros(len(start), dtype=np.uint8), planes, octave,
        )  # fmt: skip
        return placed_stones(stones, octave)

    def surface(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the height (...) [m], its slopes, and whether it is that of a pebble, at x, y (...) [m]."""
        phase, dx, dy, square = self._place(x, y)
        steep = self.height * 2 * np.pi / self.wavelength * np.cos(phase)
        east, north = self.tilt[0] + steep * np.cos(self.turn), self.tilt[1] - steep * np.sin(self.turn)
        pebble = square > 0
        rise = np.sqrt(np.maximum(square, 1e-12))
        return (
            self.height_at(x, y), east - np.where(pebble, dx / rise, 0), north - np.where(pebble, dy / rise, 0), pebble
        )  # fmt: skip

    def height_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height (...) [m] at x, y (...) [m]."""
        phase, _, _, square = self._place(x, y)
        height = self.tilt[0] * x + self.tilt[1] * y + self.height * np.sin(phase)
        return height + np.sqrt(np.maximum(square, 0))

    def _place(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the phase of the ripples, the way from the nearest pebble's middle, and r^2 - d^2, at x, y (...)."""
        k, cosine, sine = 2 * np.pi / self.wavelength, np.cos(self.turn), np.sin(self.turn)
        phase = k * (cosine * x - sine * y) + 2 * np.pi * 3.0 / PER_WAVE
        dx, dy = (
            at - corner - PITCH / 2 - PITCH * np.round((at - corner - PITCH / 2) / PITCH)
            for at, corner in ((x, self.corner[0]), (y, self.corner[1]))
        )
        return phase, dx, dy, self.radius**2 - dx * dx - dy * dy

    def met_by(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where rays (N, 3) from origin (3,) meet the ground first.

        Returns:
            (N,) lengths over the directions', inf for rays that rise from the plane; (N, 3) unit normals; and (N,)
            bool, whether a pebble is met.
        """
        up = np.array([-self.tilt[0], -self.tilt[1], 1.0])
        falling = -(rays @ up)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = ((origin @ up + over) / falling for over in (-self.top - 1e-3, self.height + 1e-3))
        at = np.flatnonzero((falling > 0.02) & (last < 20))
        out, normal, pebble = np.full(len(rays), np.inf), np.zeros((len(rays), 3)), np.zeros(len(rays), dtype=bool)

        def over(t: np.ndarray, rows: np.ndarray) -> np.ndarray:
            x, y, z = (origin[axis] + t * rays[rows, axis] for axis in range(3))
            return z - self.height_at(x, y)

        steps = 300
        step = (last - first)[at] / steps
        entered = np.zeros(len(at))  # the step in which each ray enters the ground
        left = np.arange(len(at))
        for n in range(1, steps + 1):
            above = over(first[at[left]] + n * step[left], at[left]) >= 0
            entered[left[~above]] = n
            left = left[above]
        assert len(left) == 0
        below, high = first[at] + (entered - 1) * step, first[at] + entered * step
        for _ in range(25):  # to 1e-10 m
            middle = (below + high) / 2
            outside = over(middle, at) > 0
            below, high = np.where(outside, middle, below), np.where(outside, high, middle)
        out[at] = high
        x, y = (origin[axis] + high * rays[at, axis] for axis in range(2))
        _, east, north, pebble[at] = self.surface(x, y)
        normal[at] = np.stack([-east, -north, np.ones_like(east)], axis=1)
        normal[at] /= np.linalg.norm(normal[at], axis=1, keepdims=True)
        return out, normal, pebble
