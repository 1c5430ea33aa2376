"""The courses on which envs.train_ppo trains: rock abundances from a range, and each scene crossed several times."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from envs.mars_nav import MarsNavEnv


class TrainingCourses(gymnasium.Wrapper):
    """Draws each scene's rock abundance from a range of Golombek's k, and lets the rover cross it several times.

    Attributes:
        k: Least and largest rock abundance.
        crossings: How often each scene is crossed.
    """

    def __init__(self, env: MarsNavEnv, k: tuple[float, float], crossings: int = 4) -> None:
        super().__init__(env)
        self.k, self.crossings = k, crossings
        self._rng = np.random.default_rng()
        self._crossed = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Draw a new scene, or drive back on the present one.

        A scene is new if a seed or options are given, or if the last one has been crossed often enough.
        """
        env = self.unwrapped
        assert isinstance(env, MarsNavEnv)
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        if seed is None and options is None and 0 < self._crossed < self.crossings:
            self._crossed += 1
            return env.drive_back()
        self._crossed = 1
        return self.env.reset(seed=seed, options={"k": float(self._rng.uniform(*self.k)), **(options or {})})
