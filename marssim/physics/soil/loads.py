"""How the weight of a rocker-bogie rover is shared by its wheels when it stands tilted."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec

CENTRE_OF_MASS = 0.43  # [m] its height over the ground: that of the links of marssim.physics.urdf together
LEAST_SHARE = 0.05  # of the weight that a side, or an axle's pair of wheels, bears at least


def wheel_loads(spec: RoverSpec, weight: np.ndarray) -> np.ndarray:
    """Return the loads of the wheels (6,) [N], normal to the ground.

    The weight acts at CENTRE_OF_MASS, so a tilt moves it downhill. A rocker carries the front wheel and the bogie, and
    a bogie shares its load between the middle and the rear wheel. The thrust of the wheels moves no load.

    Args:
        spec: The rover.
        weight: (3,) weight in the body frame [N]; -z on level ground.
    """
    front, middle, rear = spec.wheel_x
    bogie = (middle + rear) / 2
    normal = max(-float(weight[2]), 1e-9)
    ahead, left = CENTRE_OF_MASS * weight[0] / normal, CENTRE_OF_MASS * weight[1] / normal
    first = np.clip((ahead - bogie) / (front - bogie), LEAST_SHARE, 1 - LEAST_SHARE)
    side = np.clip(0.5 + left / spec.track, LEAST_SHARE, 1 - LEAST_SHARE)
    axles = np.array([first, (1 - first) / 2, (1 - first) / 2])
    return normal * np.outer(axles, [side, 1 - side]).ravel()
