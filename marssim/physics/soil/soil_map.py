"""Which soil lies where in a scene: shares of sand, crust and bedrock, from the cover that the renderer draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from marssim.physics.soil.soils import SOIL_NAMES
from marssim.physics.support import SupportMap
from marssim.scene.ground.cover import CELL, ground_cover
from marssim.scene.scene import Scene

GroundName = Literal["scene", "sand", "crust", "bedrock"]
GROUND_NAMES: tuple[GroundName, ...] = get_args(GroundName)
EXPOSED = 0.12  # how swept the ground is from which on plates of bedrock stand out fully; they begin to at 0
SWEPT = (0.0, 0.15, 0.25, 0.45, 0.85, 1.05, 1.25, 1.45)  # how swept the ground is
PLATES = (0.08, 0.125, 0.173, 0.305, 0.663, 0.815, 0.912, 0.945)  # share of it that plates then cover, as drawn
ON_ROCK = 0.01  # [m] height of the surface over the ground from which on a wheel stands on a rock


@dataclass(frozen=True, eq=False)
class SoilMap:
    """Shares of the soils on a square grid; row j lies at y = start + j CELL, column i at x likewise.

    Sand is what the scene shows as rippled sand and drifts. Bedrock is what it shows as plates. The rest, gravel
    included, is crust.
    """

    shares: np.ndarray
    """(N, N, 3) shares of the soils in the order of SOIL_NAMES, which sum to 1."""
    start: float
    """x and y of the first node [m]."""

    @classmethod
    def from_scene(cls, scene: Scene, ground: GroundName = "scene") -> SoilMap:
        """Return the soils of a scene.

        Args:
            scene: The scene.
            ground: "scene" for the scene's own soils, or the soil that lies everywhere instead.

        Raises:
            ValueError: If there is no such ground.
        """
        check_ground(ground)
        if ground != "scene":
            only = np.array([float(name == ground) for name in SOIL_NAMES])
            return cls(np.broadcast_to(only, (2, 2, len(only))), 0.0)
        cover = ground_cover(scene)
        bedrock = np.zeros_like(cover.sand)
        if scene.look.bedrock > 0:
            ramp = np.clip(cover.swept / EXPOSED, 0, 1)
            bare = np.interp(cover.swept, SWEPT, PLATES)
            bedrock = np.minimum(ramp * ramp * (3 - 2 * ramp) * bare, 1 - cover.drift)
        sand = cover.sand * (1 - bedrock)
        return cls(np.stack([sand, 1 - sand - bedrock, bedrock], axis=-1), cover.start)

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the shares (N, 3) at places x, y (N,) [m], bilinearly; outside, those of the nearest edge."""
        last = len(self.shares) - 1.000001
        u, v = np.clip((x - self.start) / CELL, 0, last), np.clip((y - self.start) / CELL, 0, last)
        i, j = u.astype(int), v.astype(int)
        s, t = (u - i)[:, None], (v - j)[:, None]
        low = self.shares[j, i] * (1 - s) + self.shares[j, i + 1] * s
        high = self.shares[j + 1, i] * (1 - s) + self.shares[j + 1, i + 1] * s
        return low * (1 - t) + high * t


def check_ground(ground: str) -> None:
    """Raise ValueError if there is no ground of this name."""
    if ground not in GROUND_NAMES:
        raise ValueError(f"ground {ground!r} is unknown; choose from {', '.join(GROUND_NAMES)}")


def on_rock(support: SupportMap, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return which of the places x, y (N,) [m] lie on a rock or slab that the rover can drive over, (N,) bool."""
    return support.sample(support.drive, x, y) - support.sample(support.ground, x, y) > ON_ROCK
