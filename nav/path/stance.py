"""The rover's stance: where each wheel rests, the resulting tilt, and the clearance of the belly.

As ACE does in ENav on Perseverance (Otsu et al. 2020): the wheels' heights bound the attitude, so that no dynamics are
needed. A wheel rests on the highest point that was measured under it, whatever its heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap
from nav.path.footprint import sampled

UNSEEN = -1e6  # [m] the height of ground that was not seen, below all other


@dataclass(frozen=True)
class Stance:
    """How the rover stands at poses (...)."""

    tilt: np.ndarray
    """(...) angle between the chassis and the vertical [rad]; 0 where a wheel stands on unseen ground, of which nothing
    is known."""
    clearance: np.ndarray
    """(...) distance of the chassis' underside from the highest thing below it [m]; inf where a wheel stands on unseen
    ground."""


class StanceModel:
    """The surface of a map as six wheels and a belly meet it."""

    def __init__(self, elevation: ElevationMap, spec: RoverSpec) -> None:
        self.elevation, self.spec = elevation, spec
        cell = elevation.config.cell
        top = np.where(elevation.measured, elevation.top, np.float32(UNSEEN))
        patch = max(1, round(2 * spec.wheel_radius / cell)) // 2 * 2 + 1
        self._wheel = cv2.dilate(top, np.ones((patch, patch), np.uint8))
        self._belly = cv2.dilate(top, np.ones((3, 3), np.uint8))
        length, width, _ = spec.chassis_size
        x, y = np.meshgrid(np.linspace(-length / 2, length / 2, 5), np.linspace(-width / 2, width / 2, 4))
        self._under = np.stack([x.ravel(), y.ravel()], axis=1)

    def at(self, poses: np.ndarray) -> Stance:
        """Return the stance at poses (..., 3): x, y [m], yaw [rad]."""
        spec = self.spec
        hubs = spec.wheel_positions[:, :2]
        wheel = sampled(self._wheel, self.elevation, poses, hubs, UNSEEN)
        on_map = np.asarray((wheel > UNSEEN / 10).all(axis=-1))
        wheel = np.where(on_map[..., None], wheel, 0.0)
        side = wheel.reshape(*wheel.shape[:-1], 3, 2)  # front, middle, rear by left, right
        front, back = side[..., 0, :], (side[..., 1, :] + side[..., 2, :]) / 2
        axles = spec.wheel_x
        rise = ((front - back) / (axles[0] - (axles[1] + axles[2]) / 2)).mean(axis=-1)  # of the ground, ahead
        left = side.mean(axis=-2)
        bank = (left[..., 0] - left[..., 1]) / spec.track  # of the ground, to the left
        tilt = np.arctan(np.hypot(rise, bank))
        ahead, across = self._under[:, 0] - np.mean(axles), self._under[:, 1]  # from the middle of the six wheels
        floor = wheel.mean(axis=-1)[..., None] + rise[..., None] * ahead + bank[..., None] * across
        belly = sampled(self._belly, self.elevation, poses, self._under, UNSEEN)
        room = (floor + spec.belly_clearance - belly).min(axis=-1)
        return Stance(np.where(on_map, tilt, 0.0), np.where(on_map, room, np.inf))
