"""Train a driver by reinforcement learning: PPO of stable-baselines3 on the kinematic environment with true depth.

    pip install 'mars-m3depth[rl]'
    python -m envs.train_ppo --out runs/ppo --max-minutes 60 --workers 8
    python -m envs.evaluate --driver runs/ppo/policy.zip straight --perception ground_truth --dynamics kinematic \\
        --out out/ppo

The policy sees what ImageObservation shows, the map included: it has no memory of its own. It corrects the driver
`straight` (StraightResidual), so that it begins as good as that. The same command goes on from OUT/policy.zip where it
was stopped; that file is read as your own, do not continue a stranger's.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import gymnasium
import numpy as np

from envs.course import CourseConfig
from envs.mars_nav import MarsNavEnv
from envs.policies import PolicyDriver, mark_residual
from envs.wrappers import ImageObservation, StraightResidual
from marssim.command import run_command
from marssim.scene.scene import Place


@dataclass(frozen=True)
class TrainConfig:
    """Train PPO on MarsNav-v0 and save OUT/policy.zip, which envs.evaluate takes as a driver."""

    out: Path
    """folder for policy.zip"""
    max_minutes: float = 60.0
    """time to train [min]"""
    max_steps: int = 100_000_000
    """and at most so many steps"""
    workers: int = 2
    """environments, each in a process of its own"""
    scene: Place = "gale"
    """preset of the courses' scenes"""
    k: tuple[float, float] = (0.05, 0.2)
    """rock abundance, Golombek's k, of each course: drawn between these"""
    goal_distance: float = 10.0
    """distance from start to goal [m]; shorter than in evaluation, so that goals are met early"""
    seed: int = 0
    """seed of courses and policy"""

    def __post_init__(self) -> None:
        for name in ("max_minutes", "max_steps", "workers"):
            if not getattr(self, name) > 0:
                raise ValueError(f"--{name.replace('_', '-')} must be positive, got {getattr(self, name)}")
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        CourseConfig(self.goal_distance)  # says what is out of range
        if not 0 <= self.k[0] <= self.k[1] <= 0.4:
            raise ValueError(f"--k must be two values in [0, 0.4], the lower one first, got {self.k[0]} {self.k[1]}")


class DrawnAbundance(gymnasium.Wrapper):
    """Draws the rock abundance of each course between two values of Golombek's k."""

    def __init__(self, env: gymnasium.Env, k: tuple[float, float]) -> None:
        super().__init__(env)
        self.k = k
        self._rng = np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        return self.env.reset(seed=seed, options={"k": float(self._rng.uniform(*self.k)), **(options or {})})


def train(config: TrainConfig, rollout: int = 256) -> Path:
    """Train until the time or the steps are used up; returns the policy's path. rollout: steps of each environment
    between two updates. Raises ImportError without stable-baselines3, ValueError for a policy.zip that is none."""
    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.callbacks import BaseCallback
        from stable_baselines3.common.monitor import Monitor
        from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv
    except ImportError:
        raise ImportError("envs.train_ppo needs stable-baselines3: pip install 'mars-m3depth[rl]'") from None

    def make() -> gymnasium.Env:
        env = MarsNavEnv(
            "ground_truth", "kinematic", scene=config.scene, goal_distance=config.goal_distance, map_observation=True
        )
        courses = DrawnAbundance(StraightResidual(env), config.k)
        return Monitor(ImageObservation(courses), info_keywords=("outcome",))

    path = config.out / "policy.zip"
    if path.is_file():
        PolicyDriver(path)  # says what is wrong with a file that is no policy
    config.out.mkdir(parents=True, exist_ok=True)
    makers: list[Callable[[], gymnasium.Env]] = [make] * config.workers
    vector = DummyVecEnv(makers) if config.workers == 1 else SubprocVecEnv(makers, start_method="spawn")
    until = monotonic() + 60 * config.max_minutes

    def save(model: Any) -> None:
        part = path.with_suffix(".part")  # whoever kills it meanwhile finds the last policy whole
        model.save(part)
        mark_residual(part)
        part.replace(path)

    class Clock(BaseCallback):
        """Ends the training in time, and saves and tells how it goes after each update."""

        def _on_step(self) -> bool:
            return monotonic() < until

        def _on_rollout_end(self) -> None:
            save(self.model)
            ended: list[dict[str, Any]] = list(self.model.ep_info_buffer or [])
            if ended:
                arrived = sum(e["outcome"] == "goal" for e in ended) / len(ended)
                reward = sum(e["r"] for e in ended) / len(ended)
                print(f"{self.num_timesteps} steps: last {len(ended)} episodes, {100 * arrived:.0f} % arrived, "
                      f"reward {reward:.1f}", flush=True)  # fmt: skip

    try:
        settings: dict[str, Any] = {"n_steps": rollout, "batch_size": min(256, rollout * config.workers), "n_epochs": 5,
                                    "gamma": 0.97, "ent_coef": 0.003, "learning_rate": 3e-4,
                                    "policy_kwargs": {"log_std_init": -1.0}}  # fmt: skip
        if path.is_file():
            model = PPO.load(path, vector, device="cpu")
            vector.seed(config.seed + model.num_timesteps)  # other courses than it began with
        else:
            model = PPO("MultiInputPolicy", vector, device="cpu", seed=config.seed, **settings)
        # not by the callback: a rollout that it ends is never learnt from
        model.learn(max(0, config.max_steps - model.num_timesteps), callback=Clock(), reset_num_timesteps=False)
        save(model)
    finally:
        vector.close()
    return path


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return run_command(lambda config: print(train(config)), TrainConfig, "python -m envs.train_ppo", __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
