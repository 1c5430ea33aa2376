"""The vehicle of an episode: PyBullet's rigid bodies, or a rover that settles on the ground without dynamics."""

from __future__ import annotations

from typing import Literal, Protocol, get_args

from marssim.base.command.notes import print_note
from marssim.base.rover_spec import RoverSpec
from marssim.engines.bullet import pybullet_is_installed
from marssim.physics.body import Part
from marssim.physics.kinematics import KinematicRover
from marssim.physics.rover import Rover
from marssim.physics.slipping_rover import SlippingRover
from marssim.physics.soil.slippage import Slippage
from marssim.physics.soil.soil_map import GroundName
from marssim.physics.state import Contacts, RoverState
from marssim.physics.world import PhysicsWorld
from marssim.scene.scene import Scene
from nav.controller import steerable, wheel_command

CHECK_EVERY = 0.25  # [s] between two checks for contacts during a drive
FALLBACK_NOTE = "PyBullet is not installed here, so the dynamics are kinematic"  # printed where a default falls back

DynamicsName = Literal["physics", "kinematic"]
DYNAMICS: tuple[DynamicsName, ...] = get_args(DynamicsName)


def checked_dynamics(name: str | None) -> DynamicsName:
    """Return the dynamics of that name; None means physics, or kinematic where PyBullet is not installed.

    Raises:
        ValueError: If there is no such dynamics.
        ImportError: If physics is asked for by name and PyBullet is not installed.
    """
    if name is None:
        return "physics" if pybullet_is_installed() else "kinematic"
    dynamics = dynamics_of_name(name)
    if dynamics == "physics" and not pybullet_is_installed():
        raise ImportError("`dynamics` physics needs PyBullet, which is not installed; choose kinematic instead")
    return dynamics


def dynamics_of_name(name: str) -> DynamicsName:
    """Return the dynamics of that name, whether PyBullet is installed or not. Raises ValueError if there is none."""
    for dynamics in DYNAMICS:
        if name == dynamics:
            return dynamics
    raise ValueError(f"dynamics {name!r} is unknown; choose from {', '.join(DYNAMICS)}")


def chosen_dynamics(name: str | None) -> DynamicsName:
    """Return checked_dynamics for a command, and print a note if None means kinematic, as PyBullet is not installed."""
    dynamics = checked_dynamics(name)
    if name is None and dynamics != "physics":
        print_note(FALLBACK_NOTE)
    return dynamics


class Vehicle(Protocol):
    """A rover on a scene."""

    def drive_twist(self, speed: float, yaw_rate: float, seconds: float) -> object:
        """Drive a circular arc for a time; stop early at a collision.

        Args:
            speed: Forward speed [m/s].
            yaw_rate: Yaw rate [rad/s], positive to the left.
            seconds: Time [s].
        """

    def state(self) -> RoverState:
        """Return where the rover is and how it moves."""
        ...

    def contacts(self) -> Contacts:
        """Return what the rover touched during the last drive."""
        ...

    def slippage(self) -> Slippage | None:
        """Return what the last drive lost on soil; None for wheels that do not slip."""
        ...

    def mesh(self, pan: float = 0.0) -> list[Part]:
        """Return the rover's parts, to draw it from outside; pan [rad] of the mast."""
        ...

    def close(self) -> None:
        """Free physics and meshes; may be called twice."""
        ...


class PhysicsVehicle:
    """A rover with six driven and steered wheels in PyBullet's world of a scene."""

    def __init__(
        self, scene: Scene, spec: RoverSpec, x: float, y: float, yaw: float, ground: GroundName | None = None
    ) -> None:
        self.spec = spec
        self.world = PhysicsWorld(scene, spec)
        try:
            self.rover = Rover(self.world, x, y, yaw, ground)
        except BaseException:
            self.world.close()
            raise

    def drive_twist(self, speed: float, yaw_rate: float, seconds: float) -> None:
        speed, yaw_rate = steerable(speed, yaw_rate, self.spec)
        command = wheel_command(speed, yaw_rate, self.spec)
        self.rover.drive(command.speeds, command.angles)
        while seconds > 0 and not self.rover.contacts().collision:
            self.world.step(min(CHECK_EVERY, seconds))
            seconds -= CHECK_EVERY
            if self.rover.state().tilt > self.spec.max_tilt:
                break  # so that the episode ends, though the rover might stand level again after a whole step

    def state(self) -> RoverState:
        return self.rover.state()

    def contacts(self) -> Contacts:
        return self.rover.contacts()

    def slippage(self) -> Slippage | None:
        return None if self.rover.soil is None else self.rover.soil.slippage

    def mesh(self, pan: float = 0.0) -> list[Part]:
        return self.rover.mesh(pan)

    def close(self) -> None:
        self.world.close()


class KinematicVehicle(KinematicRover):
    """A rover that settles on the ground without dynamics, on the curves that the wheels can steer."""

    def drive_twist(self, speed: float, yaw_rate: float, seconds: float, lateral: float = 0.0) -> RoverState:
        return super().drive_twist(*steerable(speed, yaw_rate, self.spec), seconds, lateral)

    def slippage(self) -> Slippage | None:
        return None


class SlippingVehicle(SlippingRover):
    """A KinematicVehicle whose wheels slip and sink."""

    def drive_twist(self, speed: float, yaw_rate: float, seconds: float, lateral: float = 0.0) -> RoverState:
        return super().drive_twist(*steerable(speed, yaw_rate, self.spec), seconds, lateral)


def make_vehicle(
    dynamics: DynamicsName,
    scene: Scene,
    spec: RoverSpec,
    x: float,
    y: float,
    yaw: float,
    ground: GroundName | None = None,
    previous: Vehicle | None = None,
) -> Vehicle:
    """Return a rover at rest on the ground.

    Args:
        dynamics: "physics" or "kinematic".
        scene: The scene.
        spec: The rover.
        x: World position [m].
        y: World position [m].
        yaw: Heading [rad].
        ground: None for wheels that do not slip. Else the soil under them: "scene" for the scene's own, or the name of
            a soil that lies everywhere.
        previous: A vehicle on the same scene, which is closed. Its map of the ground is used again.
    """
    if previous is not None:
        previous.close()
    if dynamics == "physics":
        return PhysicsVehicle(scene, spec, x, y, yaw, ground)
    support = previous.support if isinstance(previous, KinematicRover) else None
    if ground is not None:
        return SlippingVehicle(scene, spec, x, y, yaw, support, ground)
    return KinematicVehicle(scene, spec, x, y, yaw, support)
