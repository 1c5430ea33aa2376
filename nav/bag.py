"""What the navigator decided, as messages of a ROS 2 bag."""

from __future__ import annotations

import numpy as np

from marssim.base.bags.stereo_writer import StereoBagWriter
from nav.navigator import Navigator

PATH_LENGTH = 24.0  # [m] of the planned path that is written


def write_decision(
    bag: StereoBagWriter,
    stamp: int,
    status: str,
    speed: float,
    yaw_rate: float,
    body: np.ndarray,
    navigator: Navigator | None = None,
) -> None:
    """Write a command, the driver's status, and the navigator's planned path if it has one.

    Args:
        bag: The bag.
        stamp: Time of the decision [ns].
        status: As Command.status, or how the drive ended.
        speed: Commanded speed [m/s], negative backwards.
        yaw_rate: Commanded yaw rate [rad/s], positive to the left.
        body: (4, 4) pose of the rover as the navigator has it, body to world. The path gets its height.
        navigator: The navigator; None for a driver without one.
    """
    bag.write_command(stamp, speed, yaw_rate)
    bag.write_status(stamp, status)
    if navigator is None or navigator.ground is None:
        return
    path = navigator.planner.field.path(body[:2, 3], PATH_LENGTH)
    bag.write_path(stamp, np.column_stack([path, np.full(len(path), body[2, 3])]))
