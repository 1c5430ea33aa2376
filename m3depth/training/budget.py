"""The budget of a training run: how much of its steps and minutes is spent."""

from __future__ import annotations

from m3depth.training.config import TrainConfig


def shares_done(config: TrainConfig, step: int, seconds: float) -> dict[str, float]:
    """Return the spent share of each budget, by its flag and value; 1 or more is spent."""
    shares = {}
    if config.max_steps:
        shares[f"--max-steps {config.max_steps}"] = step / config.max_steps
    if config.max_minutes:
        shares[f"--max-minutes {config.max_minutes:g}"] = seconds / 60 / config.max_minutes
    return shares


def share_done(config: TrainConfig, step: int, seconds: float) -> float:
    """Return the share of the run that is done, by the budget that ends first; 1 or more is the end."""
    return max(shares_done(config, step, seconds).values())


def spent_budget(config: TrainConfig, step: int, seconds: float) -> str | None:
    """Return the budget that is spent, as its flag and value; None if none is."""
    return next((name for name, share in shares_done(config, step, seconds).items() if share >= 1), None)
