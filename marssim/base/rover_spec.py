"""What the rover is: plain numbers that the physics, the navigator and the environment share.

Body frame: x forward, y left, z up; origin on the ground under the middle of the rover, on level ground.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.base.camera import look_pose


@dataclass(frozen=True)
class CameraMount:
    """A mast over the front axle that carries the stereo pair.

    x, height: the pan axis ahead of the body origin, and the eyes above the ground [m]; pitch: downwards [rad];
    pan_limit: the mast turns this far to either side [rad]; pan_rate [rad/s].
    """

    x: float = 0.65
    height: float = 1.2
    pitch: float = float(np.deg2rad(20.0))
    pan_limit: float = float(np.deg2rad(90.0))
    pan_rate: float = float(np.deg2rad(30.0))

    def left_eye(self, baseline: float, pan: float = 0.0) -> np.ndarray:
        """(4, 4) pose of the left camera in the body frame. baseline [m]; pan [rad], positive to the left."""
        half = baseline / 2
        position = np.array([self.x - half * np.sin(pan), half * np.cos(pan), self.height])
        return look_pose(position, yaw=pan, pitch=self.pitch)


@dataclass(frozen=True)
class RoverSpec:
    """A six-wheel rocker-bogie rover after Zhurong. SI units, radians.

    The driving footprint is length x width, outer wheel edges included; the unfolded solar panels (2.6 m x 3.0 m)
    are carried above the rocks and do not count. belly_clearance: ground to the underside of the chassis box.
    """

    mass: float = 240.0
    wheel_radius: float = 0.15
    wheel_width: float = 0.20
    wheel_x: tuple[float, float, float] = (0.65, 0.0, -0.65)  # axles, front to rear
    track: float = 1.20  # between the centres of left and right wheels
    chassis_size: tuple[float, float, float] = (1.10, 0.80, 0.40)
    belly_clearance: float = 0.32
    obstacle_height: float = 0.30  # an exposed height from which on a rock is an obstacle
    max_tilt: float = float(np.deg2rad(30.0))
    max_speed: float = 0.20  # [m/s]; the real rover drives 0.056 m/s
    max_yaw_rate: float = 0.25  # [rad/s]
    max_wheel_speed: float = 2.5  # [rad/s]
    max_steer: float = float(np.deg2rad(70.0))
    wheel_torque: float = 60.0  # [N m] per wheel
    mount: CameraMount = field(default_factory=CameraMount)

    @property
    def length(self) -> float:
        """Footprint along x [m]."""
        return self.wheel_x[0] - self.wheel_x[-1] + 2 * self.wheel_radius

    @property
    def width(self) -> float:
        """Footprint along y [m]."""
        return self.track + self.wheel_width

    @property
    def wheel_positions(self) -> np.ndarray:
        """(6, 3) wheel centres in the body frame: front left, front right, middle left, ... rear right."""
        return np.array([[x, side * self.track / 2, self.wheel_radius] for x in self.wheel_x for side in (1, -1)])


ZHURONG = RoverSpec()
