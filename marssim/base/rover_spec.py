"""The dimensions and limits of the rover, which the physics, the navigator and the environment share.

Body frame: x forward, y left, z up; origin on the ground under the middle of the rover, on level ground.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.base.pose import look_pose

SHORTEST = 1e-3  # [m] of any length that must not be 0, and of speeds likewise
LONGEST = 10.0  # [m] of any length, and [m/s] and [rad/s] of any speed
RIGHT_ANGLE = float(np.pi / 2)


def _check(spec: object, least: float, most: float, unit: str, *names: str) -> None:
    """Raise ValueError that names a field whose value is not finite, or lies outside [least, most]."""
    for name in names:
        value = getattr(spec, name)
        if not least <= value <= most:
            hint = {"m": "; is it in millimetres?", "rad": "; is it in degrees?"}.get(unit, "") if value > most else ""
            raise ValueError(f"{name} must lie in [{least:g}, {most:.3g}] {unit}, got {value:g}{hint}")


@dataclass(frozen=True)
class CameraMount:
    """A mast over the front axle that carries the stereo pair.

    Raises:
        ValueError: A value that no mast has, as one in another unit; the message names the field.
    """

    x: float = 0.65
    """Distance of the pan axis ahead of the body origin [m]."""
    y: float = 0.0
    """Distance of the pan axis to the left of the body origin [m]."""
    height: float = 1.2
    """Height of the cameras above level ground [m]."""
    pitch: float = float(np.deg2rad(20.0))
    """How far the cameras look down from the horizon [rad]."""
    pan_limit: float = float(np.deg2rad(90.0))
    """Largest pan to either side [rad]."""
    pan_rate: float = float(np.deg2rad(30.0))
    """Speed at which the mast turns [rad/s]."""

    def __post_init__(self) -> None:
        _check(self, -LONGEST, LONGEST, "m", "x", "y")
        _check(self, SHORTEST, LONGEST, "m", "height")
        _check(self, -RIGHT_ANGLE, RIGHT_ANGLE, "rad", "pitch")
        _check(self, 0.0, 2 * RIGHT_ANGLE, "rad", "pan_limit")
        _check(self, SHORTEST, LONGEST, "rad/s", "pan_rate")

    def left_eye(self, baseline: float, pan: float = 0.0) -> np.ndarray:
        """Return the pose of the left camera.

        Args:
            baseline: Distance between the cameras [m].
            pan: Pan of the mast [rad], positive to the left.

        Returns:
            (4, 4) left camera to body.
        """
        half = baseline / 2
        position = np.array([self.x - half * np.sin(pan), self.y + half * np.cos(pan), self.height])
        return look_pose(position, yaw=pan, pitch=self.pitch)

    @classmethod
    def of_flag(cls, mount: tuple[float, float, float]) -> CameraMount:
        """Return Zhurong's mast with the cameras where --mount puts them.

        Args:
            mount: Metres ahead of the rover's origin, metres above the ground, and degrees that the cameras look down.

        Raises:
            ValueError: No mast has such values; the message names the flag.
        """
        x, height, pitch_deg = mount
        try:
            return cls(x=x, height=height, pitch=float(np.deg2rad(pitch_deg)))
        except ValueError:
            raise ValueError(
                f"--mount must be metres ahead, {-LONGEST:g} to {LONGEST:g}, metres above the ground, {SHORTEST:g} to "
                f"{LONGEST:g}, and -90 to 90 degrees, got {x:g} {height:g} {pitch_deg:g}"
            ) from None

    @classmethod
    def of_left_eye(cls, pose: np.ndarray, baseline: float) -> tuple[CameraMount, float]:
        """Return the mast that holds the left camera where a pose says, and its pan [rad].

        Roll is left out.

        Args:
            pose: (4, 4) left camera to body.
            baseline: Distance between the cameras [m].

        Raises:
            ValueError: The camera is not above the ground.
        """
        x, y, height = (float(value) for value in pose[:3, 3])
        if not height > 0:
            raise ValueError(f"the camera must be above the ground of the rover, got {height:g} m")
        pan, pitch = float(np.arctan2(pose[1, 2], pose[0, 2])), float(np.arcsin(np.clip(-pose[2, 2], -1, 1)))
        half = baseline / 2
        return cls(x + half * float(np.sin(pan)), y - half * float(np.cos(pan)), height, pitch), pan


@dataclass(frozen=True)
class RoverSpec:
    """A six-wheel rocker-bogie rover after Zhurong.

    The driving footprint is length x width, outer wheel edges included. The solar panels do not count: unfolded
    (2.6 m x 3.0 m) they are carried above the rocks.

    Raises:
        ValueError: A value that no such rover has, as one in another unit; the message names the field.
    """

    mass: float = 240.0
    """Mass of the rover [kg]."""
    wheel_radius: float = 0.15
    """Radius of the wheels [m]."""
    wheel_width: float = 0.20
    """Width of the wheels [m]."""
    wheel_x: tuple[float, float, float] = (0.65, 0.0, -0.65)
    """Positions of the front, middle and rear axle along x [m]; the origin is midway between the front and the rear."""
    track: float = 1.20
    """Distance between the centres of the left and the right wheels [m]."""
    chassis_size: tuple[float, float, float] = (1.10, 0.80, 0.40)
    """Length, width and height of the chassis box [m]."""
    belly_clearance: float = 0.32
    """Height of the chassis' underside above level ground [m]."""
    obstacle_height: float = 0.30
    """Height above ground from which a rock is an obstacle, and depth from which a drop is one [m]."""
    max_slope: float = float(np.deg2rad(25.0))
    """Slope of the ground under the footprint from which it is an obstacle [rad]: 5 deg below max_tilt, as wheels stand
    on stones and ripples. Zhurong is rated for 20 deg."""
    max_tilt: float = float(np.deg2rad(30.0))
    """Largest tilt of the chassis at which the rover is safe [rad]."""
    max_speed: float = 0.20
    """Largest driving speed [m/s]. The real rover drives 0.056 m/s."""
    max_yaw_rate: float = 0.25
    """Largest yaw rate [rad/s]."""
    max_wheel_speed: float = 2.5
    """Largest speed of a wheel's rotation [rad/s]."""
    max_steer: float = float(np.deg2rad(70.0))
    """Largest steering angle to either side [rad]."""
    wheel_torque: float = 60.0
    """Largest torque of a wheel's motor [N m]."""
    mount: CameraMount = field(default_factory=CameraMount)
    """The mast with the cameras."""

    def __post_init__(self) -> None:
        if len(self.wheel_x) != 3 or not self.wheel_x[0] > self.wheel_x[1] > self.wheel_x[2]:
            raise ValueError(f"wheel_x must be three axles from front to rear [m], got {self.wheel_x}")
        if not abs(self.wheel_x[0] + self.wheel_x[2]) < SHORTEST:
            raise ValueError(
                f"wheel_x must have the origin midway between the front and the rear axle [m], got {self.wheel_x}; "
                "move the origin, and the cameras' mount with it"
            )
        if len(self.chassis_size) != 3 or not all(SHORTEST <= side <= LONGEST for side in self.chassis_size):
            raise ValueError(f"chassis_size must be three lengths up to {LONGEST:g} m, got {self.chassis_size}")
        _check(self, SHORTEST, LONGEST, "m", "wheel_radius", "wheel_width", "track", "obstacle_height")
        _check(self, 0.0, LONGEST, "m", "belly_clearance")
        _check(self, SHORTEST, RIGHT_ANGLE, "rad", "max_slope", "max_tilt")
        _check(self, 0.0, RIGHT_ANGLE, "rad", "max_steer")
        _check(self, SHORTEST, LONGEST, "m/s", "max_speed")
        _check(self, SHORTEST, LONGEST, "rad/s", "max_yaw_rate")
        for name in ("mass", "max_wheel_speed", "wheel_torque"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be above 0, got {getattr(self, name):g}")

    @property
    def length(self) -> float:
        """Length of the footprint along x [m]."""
        return self.wheel_x[0] - self.wheel_x[-1] + 2 * self.wheel_radius

    @property
    def width(self) -> float:
        """Width of the footprint along y [m]."""
        return self.track + self.wheel_width

    @property
    def wheel_positions(self) -> np.ndarray:
        """(6, 3) wheel centres in the body frame [m]: front left, front right, middle left, ..., rear right."""
        return np.array([[x, side * self.track / 2, self.wheel_radius] for x in self.wheel_x for side in (1, -1)])


ZHURONG = RoverSpec()
