"""How much of a training run's budget of steps and minutes is spent."""

from __future__ import annotations

from m3depth.training.config import TrainConfig


def shares_done(config: TrainConfig, step: int, seconds: float) -> dict[str, float]:
    """Share of each budget that is spent, by its flag and value; from 1 on there is nothing left to do."""
    shares = {}
    if config.max_steps:
        shares[f"--max-steps {config.max_steps}"] = step / config.max_steps
    if config.max_minutes:
        shares[f"--max-minutes {config.max_minutes:g}"] = seconds / 60 / config.max_minutes
    return shares


def share_done(config: TrainConfig, step: int, seconds: float) -> float:
    """Share of the run that is done, by the budget that is nearer to its end; 1 or more: it is spent."""
    return max(shares_done(config, step, seconds).values())


def spent_budget(config: TrainConfig, step: int, seconds: float) -> str | None:
    """Which budget is spent, as its flag and value; None: there is something left to do."""
    return next((name for name, share in shares_done(config, step, seconds).items() if share >= 1), None)
