"""The reward of a step of MarsNav-v0."""

from __future__ import annotations

STEP_COST = 0.01
GOAL_REWARD = 10.0
CRASH_COST = 10.0
CRASHES = ("collision", "tilt")  # outcomes that cost CRASH_COST


def step_reward(progress: float, outcome: str) -> float:
    """Return the reward of a step.

    Args:
        progress: How much shorter the way to the goal has become [m].
        outcome: State of the episode after the step, as MarsNavEnv names it.
    """
    reward = float(progress - STEP_COST)
    if outcome == "goal":
        return reward + GOAL_REWARD
    return reward - CRASH_COST if outcome in CRASHES else reward
