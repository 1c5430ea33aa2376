"""Drive one episode of MarsNav-v0 by hand-made actions, with the true depth or that of M3Depth.

python examples/one_episode.py
python examples/one_episode.py --perception m3depth --dynamics physics
"""

import gymnasium
import numpy as np
import tyro


def main(
    perception: str = "ground_truth", dynamics: str = "kinematic", goal_distance: float = 10.0, seed: int = 1
) -> None:
    """Head for the goal without looking, and print each step.

    Args:
        perception: Method that turns the images into depth: ground_truth, m3depth, sgbm or package.module:Class.
        dynamics: How the rover moves: kinematic or physics.
        goal_distance: Distance from start to goal [m].
        seed: Seed of the episode.
    """
    env = gymnasium.make("envs:MarsNav-v0", perception=perception, dynamics=dynamics, goal_distance=goal_distance)
    observation, info = env.reset(seed=seed)
    total, ended = 0.0, False
    while not ended:
        distance, sine, cosine = observation["goal"]
        action = np.array([1.0, np.clip(2 * np.arctan2(sine, cosine), -1, 1)], dtype=np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        total, ended = total + float(reward), terminated or truncated
        nearest = observation["depth"][observation["depth"] > 0].min(initial=15.0)
        print(f"{distance:5.1f} m to go, nearest ground in view {nearest:4.1f} m, reward {reward:6.2f}")
    env.close()
    print(f"{info['outcome']} after {info['path_length']:.1f} m, total reward {total:.1f}")


if __name__ == "__main__":
    tyro.cli(main)
