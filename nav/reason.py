"""Why the navigator gave its last command, in words."""

from __future__ import annotations

import numpy as np

from nav.command import Command
from nav.navigator import Navigator
from nav.path.planner import Motion

STRAIGHT = 0.05  # [1/m] curvature below which an arc is called straight


def reason_of(navigator: Navigator, command: Command) -> str:
    """Return a sentence on the last step of a navigator.

    Args:
        navigator: The navigator, after the step.
        command: What the step returned.
    """
    sentence = _reason(navigator, command)
    level = navigator.risk.level
    return f"{sentence}, at risk level {level}" if level and not command.over else sentence


def _reason(navigator: Navigator, command: Command) -> str:
    config, recovery, motion = navigator.config, navigator.recovery, navigator.motion
    if command.status == "arrived":
        return f"the goal is within {config.goal_radius:g} m by odometry"
    if command.status == "blind":
        return "the image showed no ground"
    if command.status == "stuck":
        return f"{recovery.attempts} recoveries brought the rover no nearer to the goal, and no motion is free"
    if command.status == "no_path":
        if navigator.risk.given_up:
            return f"known obstacles have closed every path to the goal for {navigator.risk.closed} steps"
        return f"no motion is free after {recovery.attempts} recoveries, and known obstacles close every path"
    if command.status == "recover":
        number = f"recovery {recovery.attempts} of at most {config.max_recoveries}"
        if command.speed < 0:
            return f"backs out along its track, {recovery.back_left:.1f} m left, {number}"
        return f"turns in place to look for another path, {number}"
    if navigator.looks_along:
        return "the map shows no long free path, so the mast looks along the planned one first"
    if motion is None:
        if recovery.looking:
            return "no motion is free, so the mast looks to the sides"
        return "no motion, no way back and no turn is free"
    if command.status == "look":
        return f"looks first where it wants to turn: {_in_words(motion)}"
    assert navigator.planner.considered is not None
    cost = np.sort(navigator.planner.considered.cost)
    free = int(np.isfinite(cost).sum())
    if free == 1:
        return f"{_in_words(motion)}, the only free motion of {cost.size}"
    return f"{_in_words(motion)}, {cost[1] - cost[0]:.2f} m cheaper than the next of {free} free motions"


def _in_words(motion: Motion) -> str:
    if motion.turn:
        return f"a turn in place of {np.rad2deg(abs(motion.turn)):.0f} deg to the {_side(motion.turn)}"
    if abs(motion.curvature) < STRAIGHT:
        return "straight on"
    return f"an arc of {1 / abs(motion.curvature):.1f} m radius to the {_side(motion.curvature)}"


def _side(value: float) -> str:
    return "left" if value > 0 else "right"
