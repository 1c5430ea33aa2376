"""Commands whose state is saved more often than users can ask for, so that a kill in a few seconds of work hits it."""

from __future__ import annotations

from collections.abc import Sequence

import m3depth.evaluate
from envs.train_ppo import PPOConfig
from envs.train_ppo import train as train_driver
from m3depth.evaluation import resume
from marssim.base.command.run import run_command

ROLLOUT = 8  # choices between two updates of the policy


def train_ppo(args: Sequence[str] | None = None) -> int:
    """Run envs.train_ppo with short rollouts and return the exit code."""
    return run_command(lambda config: print(train_driver(config, ROLLOUT)), PPOConfig, "train_ppo", __doc__, args)


def evaluate(args: Sequence[str] | None = None) -> int:
    """Run m3depth.evaluate, which saves its state after every pair here, and return the exit code."""
    resume.SECONDS = 0.0
    return m3depth.evaluate.main(args)
