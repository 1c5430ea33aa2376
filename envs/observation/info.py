"""The info of MarsNav-v0 that tells how an episode stands."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.courses.course import Course
from envs.world.gaze import Gaze
from envs.world.way_driven import WayDriven


def episode_info(outcome: str, course: Course, way: WayDriven, gaze: Gaze, believed_pose: np.ndarray) -> dict[str, Any]:
    """Return the values that MarsNavEnv documents, but those of the slip.

    Args:
        outcome: How the episode stands or ended.
        course: The course.
        way: The way driven.
        gaze: The last look, and the mast.
        believed_pose: (4, 4) body to world, as the odometry has it.
    """
    assert gaze.sight is not None
    return {
        "outcome": outcome,
        "is_success": outcome == "goal",
        "distance": float(np.hypot(*(course.goal - way.place[:2]))),
        "shortest": course.shortest,
        "to_go": float(way.to_go),
        "path_length": way.length,
        "min_clearance": way.min_clearance,
        "pan": gaze.pan,
        "position_error": float(np.hypot(*(believed_pose[:2, 3] - way.place[:2]))),
        "perception_seconds": gaze.sight.seconds if gaze.fresh else 0.0,
        "redraws": course.redraws,
        "looked": gaze.fresh,
    }
