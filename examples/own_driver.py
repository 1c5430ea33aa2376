"""Let a driver of your own cross a course, beside the navigator.

    python examples/own_driver.py

The same class is scored by the command:

    cd examples
    python -m envs.evaluate --driver own_driver:Wary navigator --perception ground_truth --dynamics kinematic \\
        --goal-distance 12 --episodes 2 --k .1 --no-videos --out out/wary
"""

from typing import Any

import numpy as np
import tyro

from envs import Cell, MarsNavEnv, NavigatorDriver, Stop, run_episode


class Wary:
    """Heads for the goal, and bends away from the side on which things are nearer."""

    needs_map = False  # True: observation["map"] is there, too

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        """Begin an episode."""
        self.steps = 0

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        """Return speed, yaw rate and pan of the mast, each in [-1, 1]; or a Stop, which ends the drive."""
        distance, sine, cosine = observation["goal"]
        self.steps += 1
        if distance < 0.5:
            return Stop.ARRIVED  # by its odometry; at the true goal the environment ends the drive
        if self.steps > 400:
            return Stop.NO_PATH
        left, right = np.split(observation["depth"][20:44], 2, axis=1)  # (24, 32) each [m], 0 where unknown
        bend = (left.mean() - right.mean()) / max(left.mean() + right.mean(), 1e-6)
        turn = np.arctan2(sine, cosine) + 4 * bend  # [rad]
        return np.array([0.6, np.clip(turn / 0.5, -1, 1), 0.0], dtype=np.float32)


def main(goal_distance: float = 10.0, k: float = 0.05, seed: int = 1) -> None:
    """Drive one course with each driver, and print how it ended.

    Args:
        goal_distance: Distance from start to goal [m].
        k: Rock abundance, Golombek's k.
        seed: Seed of the course.
    """
    for driver in (Wary(), NavigatorDriver()):
        env = MarsNavEnv("ground_truth", "kinematic", goal_distance=goal_distance, mast=True)
        record = run_episode(env, driver, Cell(k=k), seed, episode=0)
        env.close()
        name = type(driver).__name__
        print(f"{name:16} {record.outcome:10} {record.path_length:5.1f} m driven, shortest: {record.shortest:.1f} m")


if __name__ == "__main__":
    tyro.cli(main)
