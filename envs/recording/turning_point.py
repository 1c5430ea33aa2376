"""The step of a recorded drive at which its outcome was decided."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from envs.courses.clearance import FAR
from marssim.base.dataset.drive_file import DriveFile
from marssim.base.pose import planar_pose
from nav.path.footprint import arc_poses

SPACING = 0.1  # [m] between the checked places of a motion
LED_THERE = 0.5  # [m] from the place where the drive ended, within which a motion leads over it
NO_FARTHER = 0.02  # [m] by which a rover that turns in place may move away from its goal
BELOW_FAR = FAR - 0.001  # [m] the largest clearance that is measured
ASTRAY = 0.5  # [m] error of the odometry from which a drive can end elsewhere

Step = Mapping[str, Any]


def turning_point(drive: DriveFile) -> tuple[int, str]:
    """Return the step at which the outcome was decided, and what makes it that step, in words.

    An arrival is decided where the rover begins to come nearer to the goal at every step; a collision or a tilt where
    the navigator begins to choose motions that lead over the place where it happened, or, where it chose no such motion
    and for other drivers, where the clearance begins to fall for good or the tilt to rise; a drive that ends elsewhere
    where the odometry has gone astray for good, if it ends astray; giving up where the navigator begins to accept more
    risk, as every path is closed; and any other end at the place nearest to the goal, after which nothing helped.
    """
    steps = drive.steps
    last = len(steps) - 1
    outcome = drive.content["episode"]["outcome"]
    if outcome == "goal":
        start = _run_back(last, lambda i: steps[i + 1]["distance"] <= steps[i]["distance"] + NO_FARTHER)
        return start, "from here on, each step brought the rover nearer to the goal"
    if outcome in ("collision", "tilt"):
        end = np.array(steps[-1]["pose"])[:2, 3]
        start = _run_back(last, lambda i: _leads_over(steps[i], end))
        if start < last:
            return start, "from here on, the chosen motion led over the place where the drive ended"
        if outcome == "tilt":
            start = _run_back(last, lambda i: steps[i + 1]["tilt_deg"] >= steps[i]["tilt_deg"])
            return start, "from here on, the rover tilted more at each step"
        start = _run_back(last, lambda i: steps[i + 1]["clearance"] <= min(steps[i]["clearance"], BELOW_FAR))
        return start, "from here on, the rover came nearer to an obstacle at each step"
    if outcome == "elsewhere" and _odometry_error(steps[last]) > ASTRAY:  # not so if the driver alone erred
        start = _run_back(last, lambda i: _odometry_error(steps[i]) > ASTRAY)
        return start, f"from here on, the odometry was wrong by more than {ASTRAY:g} m"
    start = _run_back(last, lambda i: steps[i]["risk_level"] > 0)
    if outcome == "no_path" and start < last:
        return start, "from here on, the navigator accepted more risk, as it found no way"
    nearest = min(range(len(steps)), key=lambda i: steps[i]["distance"])
    return nearest, "the rover never came nearer to the goal than here"


def _run_back(last: int, holds: Callable[[int], bool]) -> int:
    """Return the first of the steps before the last one from which on something holds at each; `last` if at none."""
    start = last
    while start > 0 and holds(start - 1):
        start -= 1
    return start


def _odometry_error(step: Step) -> float:
    return float(np.hypot(*(np.array(step["pose"]) - np.array(step["believed_pose"]))[:2, 3]))


def _leads_over(step: Step, place: Sequence[float] | np.ndarray) -> bool:
    """Return whether the motion that was chosen at a step passes a true place (2,) [m]."""
    if step["chosen"] is None or step["candidates"] is None:
        return False
    curvature, turn, free = (step["candidates"][name][step["chosen"]] for name in ("curvature", "turn", "free"))
    start = planar_pose(np.array(step["pose"]))
    start[2] += turn
    way = arc_poses(start, np.array(curvature), np.arange(0.0, min(free, 100.0) + SPACING, SPACING))
    return bool(np.hypot(*(way[:, :2] - place).T).min() < LED_THERE)
