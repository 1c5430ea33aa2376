"""Figures of merit of driven episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from envs.episodes import EpisodeRecord


def spl(success: bool, shortest: float, path_length: float) -> float:
    """Success weighted by path length, S L / max(P, L) (Anderson et al. 2018); L is the geodesic optimum [m].

    As in Habitat, L leads to the goal itself, and the drive may end at the goal radius.
    """
    return float(success) * shortest / max(path_length, shortest, 1e-9)


def soft_spl(start_distance: float, distance: float, shortest: float, path_length: float) -> float:
    """SPL with the success replaced by the share of the way covered: max(0, 1 - d_T / d_0) L / max(P, L)."""
    return max(0.0, 1 - distance / max(start_distance, 1e-9)) * shortest / max(path_length, shortest, 1e-9)


def wilson_interval(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson score interval of a proportion, 95 % by default. Raises ValueError without trials."""
    if trials < 1:
        raise ValueError("an interval needs at least one trial")
    p, n = successes / trials, trials
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float(max(0.0, middle - half)), float(min(1.0, middle + half))


def summarise(records: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Figures over the episodes of one driver, perception and cell. Raises ValueError without episodes.

    path_inefficiency: mean of P / L over the successes; down to 0.95 on 20 m, as the drive ends 1 m before the goal.
    """
    n = len(records)
    if n == 0:
        raise ValueError("a summary needs at least one episode")
    success = [r.outcome == "goal" for r in records]
    outcomes = Counter(r.outcome for r in records)
    driven = [r for r in records if r.outcome == "goal"]
    return {
        "episodes": n,
        "success_rate": sum(success) / n,
        "success_interval": list(wilson_interval(sum(success), n)),
        "spl": float(np.mean([spl(s, r.shortest, r.path_length) for s, r in zip(success, records)])),
        "soft_spl": float(
            np.mean([soft_spl(r.start_distance, r.distance, r.shortest, r.path_length) for r in records])
        ),
        "collision_rate": outcomes["collision"] / n,
        "tilt_rate": outcomes["tilt"] / n,
        "outcomes": dict(sorted(outcomes.items())),
        "path_inefficiency": float(np.mean([r.path_length / r.shortest for r in driven])) if driven else None,
        "min_clearance": float(np.min([r.min_clearance for r in records])),
        "steps": float(np.mean([r.steps for r in records])),
        "step_seconds": float(np.mean([r.step_seconds for r in records])),
        "perception_seconds": float(np.mean([r.perception_seconds for r in records])),
        "redraws": int(sum(r.redraws for r in records)),
    }
