"""Rocker-bogie geometry: the positions of hubs and links for given joint angles.

On each side a rocker turns on the chassis. It carries the front wheel and, behind, a bogie with the middle and the rear
wheel. A differential lets the two rockers turn against the chassis by equal and opposite angles only, so the chassis
pitches by the mean of the two. The pivots lie where each wheel carries a sixth of the weight on level ground.
Joint angles are about the body's +y axis: a positive angle lowers what lies ahead of the pivot.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.base.rover_spec import RoverSpec

SIDES = ("left", "right")
AXLES = ("front", "middle", "rear")
WHEELS = tuple(f"{axle}_{side}" for axle in AXLES for side in SIDES)  # the order of RoverSpec.wheel_positions
ROCKER_HEIGHT = 0.45  # [m] height of the rocker pivots above level ground
BOGIE_HEIGHT = 0.28  # [m] height of the bogie pivots
PIVOT_GAP = 0.06  # [m] distance from the chassis' side to the plane of rocker and bogie
MAX_SWING = 0.6  # [rad] angle to either side at which rockers and bogies stop


@dataclass(frozen=True)
class Joints:
    """Angles of all joints [rad]; zero on level ground.

    Attributes:
        rocker: (2,) left and right rocker against the chassis.
        bogie: (2,) left and right bogie against the rockers.
        steering: (6,) steering angles, positive to the left.
        spin: (6,) rotation of each wheel, positive when it rolls forward.
    """

    rocker: np.ndarray = field(default_factory=lambda: np.zeros(2))
    bogie: np.ndarray = field(default_factory=lambda: np.zeros(2))
    steering: np.ndarray = field(default_factory=lambda: np.zeros(6))
    spin: np.ndarray = field(default_factory=lambda: np.zeros(6))


@dataclass(frozen=True)
class Linkage:
    """The positions of the joints on a level rover, in the body frame [m].

    Attributes:
        hubs: (6, 3) wheel centres, in the order of WHEELS.
        rocker: (2, 3) left and right rocker pivot.
        bogie: (2, 3) left and right bogie pivot.
    """

    hubs: np.ndarray
    rocker: np.ndarray
    bogie: np.ndarray

    @classmethod
    def from_spec(cls, spec: RoverSpec) -> Linkage:
        """Return the joints of a rover: bogies pivot halfway between their axles, rockers at the mean of all three."""
        front, middle, rear = spec.wheel_x
        y = spec.chassis_size[1] / 2 + PIVOT_GAP
        bogie_x, rocker_x = (middle + rear) / 2, (front + middle + rear) / 3
        return cls(
            hubs=spec.wheel_positions,
            rocker=np.array([[rocker_x, y, ROCKER_HEIGHT], [rocker_x, -y, ROCKER_HEIGHT]]),
            bogie=np.array([[bogie_x, y, BOGIE_HEIGHT], [bogie_x, -y, BOGIE_HEIGHT]]),
        )

    def carrier(self, axle: str, side: int) -> tuple[str, np.ndarray]:
        """Return name and pivot (3,) of the link that carries one of AXLES on side 0 (left) or 1: rocker or bogie."""
        kind, pivots = ("rocker", self.rocker) if axle == "front" else ("bogie", self.bogie)
        return f"{kind}_{SIDES[side]}", pivots[side]

    def hub_positions(self, rocker: np.ndarray, bogie: np.ndarray) -> np.ndarray:
        """Return the (6, 3) wheel centres in the body frame [m]; rocker, bogie: (2,) angles as in Joints [rad]."""
        out = self.hubs.copy()
        pivot = self.rocker[:, ::2]
        out[0:2, ::2] = pivot + _turn(self.hubs[0:2, ::2] - pivot, rocker)
        carried = pivot + _turn(self.bogie[:, ::2] - pivot, rocker)
        for axle in (slice(2, 4), slice(4, 6)):
            out[axle, ::2] = carried + _turn(self.hubs[axle, ::2] - self.bogie[:, ::2], rocker + bogie)
        return out

    def link_poses(self, pose: np.ndarray, joints: Joints) -> dict[str, np.ndarray]:
        """Return the pose of every link, (4, 4) link to world, by name.

        The names are "chassis", "rocker_" and "bogie_" with a side, and "steer_" and "wheel_" with one of WHEELS. The
        frame of the chassis is the body frame. Each other link has its joint as origin, and on a level rover it has the
        axes of the body.

        Args:
            pose: (4, 4) body to world.
            joints: Angles of the joints.
        """
        out = {"chassis": np.array(pose, dtype=float)}
        for s, side in enumerate(SIDES):
            rocker = out["chassis"] @ _about_y(self.rocker[s], joints.rocker[s])
            bogie = rocker @ _about_y(self.bogie[s] - self.rocker[s], joints.bogie[s])
            out[f"rocker_{side}"], out[f"bogie_{side}"] = rocker, bogie
            for a, axle in enumerate(AXLES):
                wheel = 2 * a + s
                carrier, origin = self.carrier(axle, s)
                steer = out[carrier] @ _about_z(self.hubs[wheel] - origin, joints.steering[wheel])
                out[f"steer_{axle}_{side}"] = steer
                out[f"wheel_{axle}_{side}"] = steer @ _about_y(np.zeros(3), joints.spin[wheel])
        return out


def _turn(xz: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return x, z of two sides (2, 2), turned about +y by angles (2,) [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * xz[:, 0] + s * xz[:, 1], c * xz[:, 1] - s * xz[:, 0]], axis=1)


def _about_y(origin: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s, origin[0]], [0, 1, 0, origin[1]], [-s, 0, c, origin[2]], [0, 0, 0, 1.0]])


def _about_z(origin: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, origin[0]], [s, c, 0, origin[1]], [0, 0, 1, origin[2]], [0, 0, 0, 1.0]])
