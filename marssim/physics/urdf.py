"""The rover as URDF text, made from its specification."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from marssim.physics.linkage import AXLES, MAX_SWING, SIDES, Linkage

ROCKER_MASS, BOGIE_MASS, STEER_MASS, WHEEL_MASS = 8.0, 5.0, 2.5, 6.0  # [kg] each; the chassis has the rest


def rover_urdf(spec: RoverSpec) -> str:
    """Return the URDF of the rover: chassis, rockers, bogies, six steering and six wheel links.

    The origin of the root link is the middle of the chassis box. Only the chassis (a box) and the wheels (cylinders)
    collide. The axis of rockers, bogies and wheels is +y, so that positive spin rolls forward; that of steering is +z.

    Raises:
        ValueError: The rover's mass leaves nothing for the chassis.
    """
    linkage = Linkage.from_spec(spec)
    length, width, height = spec.chassis_size
    middle = np.array([0, 0, chassis_middle(spec)])
    mass = spec.mass - 2 * (ROCKER_MASS + BOGIE_MASS) - 6 * (STEER_MASS + WHEEL_MASS)
    if mass <= 0:
        raise ValueError(
            f"mass must be above {spec.mass - mass} kg, the weight of the links without chassis, got {spec.mass}"
        )
    box = f'<collision><geometry><box size="{length} {width} {height}"/></geometry></collision>'
    parts = [_link("chassis", mass, _box_inertia(mass, length, width, height), collision=box)]
    for s, side in enumerate(SIDES):
        rocker, bogie = linkage.rocker[s], linkage.bogie[s]
        parts += [
            _link(f"rocker_{side}", ROCKER_MASS, _box_inertia(ROCKER_MASS, 1.0, 0.1, 0.2)),
            _joint(f"rocker_{side}", "chassis", rocker - middle, "0 1 0", MAX_SWING),
            _link(f"bogie_{side}", BOGIE_MASS, _box_inertia(BOGIE_MASS, 0.7, 0.1, 0.2)),
            _joint(f"bogie_{side}", f"rocker_{side}", bogie - rocker, "0 1 0", MAX_SWING),
        ]
        for a, axle in enumerate(AXLES):
            hub = linkage.hubs[2 * a + s]
            carrier, origin = linkage.carrier(axle, s)
            parts += [
                _link(f"steer_{axle}_{side}", STEER_MASS, _box_inertia(STEER_MASS, 0.2, 0.2, 0.3)),
                _joint(f"steer_{axle}_{side}", carrier, hub - origin, "0 0 1", spec.max_steer + 0.02),
                _link(
                    f"wheel_{axle}_{side}", WHEEL_MASS, _wheel_inertia(spec),
                    collision=f'<collision><origin rpy="{np.pi / 2} 0 0"/><geometry>'
                    f'<cylinder radius="{spec.wheel_radius}" length="{spec.wheel_width}"/></geometry></collision>',
                ),
                _joint(f"wheel_{axle}_{side}", f"steer_{axle}_{side}", np.zeros(3), "0 1 0"),
            ]  # fmt: skip
    return '<?xml version="1.0"?>\n<robot name="rover">\n' + "\n".join(parts) + "\n</robot>\n"


def chassis_middle(spec: RoverSpec) -> float:
    """Return the height of the chassis box's middle above the body origin [m]."""
    return spec.belly_clearance + spec.chassis_size[2] / 2


def _link(name: str, mass: float, inertia: tuple[float, float, float], collision: str = "") -> str:
    ixx, iyy, izz = inertia
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial>{collision}</link>'
    )


def _joint(child: str, parent: str, origin: np.ndarray, axis: str, limit: float | None = None) -> str:
    kind = "continuous" if limit is None else "revolute"
    stop = "" if limit is None else f'<limit lower="{-limit}" upper="{limit}" effort="1000" velocity="10"/>'
    x, y, z = origin
    return (
        f'<joint name="{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/>{stop}</joint>'
    )


def _box_inertia(mass: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    return mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12


def _wheel_inertia(spec: RoverSpec) -> tuple[float, float, float]:
    r, w = spec.wheel_radius, spec.wheel_width
    across = WHEEL_MASS * (3 * r * r + w * w) / 12
    return across, WHEEL_MASS * r * r / 2, across
