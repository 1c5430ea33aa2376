"""Scores of ablation runs with known figures."""

import numpy as np

from m3depth.ablation.studies import STUDIES

ABOUT = {
    "preset": "lite", "steps": 100, "minutes": None, "batch": 4, "crop": [256, 448], "data": ["data/train"],
    "test": "data/train", "limit": None, "seeds": [0, 1], "versions": {"torch": "2"}, "depth_range_m": (0.5, 15.0),
}  # fmt: skip


def score(figures: dict[str, np.ndarray], views: int = 1) -> dict:
    """score.json of a run with these figures, (pairs,) each, so many pairs a scene."""
    count = len(next(iter(figures.values())))
    records = [
        {
            "index": i,
            "pair": f"left/{i}",
            "scene": str(i // views),
            "M3Depth": {name: float(x[i]) for name, x in figures.items()},
        }
        for i in range(count)
    ]
    return {
        "parameters": 1_500_000, "code": "0123456789ab", "device": "cpu", "steps": 100, "minutes": 2.0,
        "per_pair": records,
        "result": {"seconds": {"median": 0.5}, "sky": {"near_ground_as_sky": 0.0002, "missed": None}},
    }  # fmt: skip


def levels(changes: list[float | None], noise: float = 0.0) -> dict:
    """Scores of the levels study: Abs Rel of each row is so many times that of hard and easy pairs."""
    rng = np.random.default_rng(0)
    pairs = rng.uniform(0.5, 2, 30)
    scores = {}
    for row, factor in zip(STUDIES["levels"].rows, changes, strict=True):
        known = {}
        for seed in range(2):
            x = pairs * (factor or 0) * np.exp(noise * rng.normal(size=30))
            known[seed] = score({name: x for name in ("abs_rel", "sq_rel", "rmse", "delta1")})
        scores[row.variant.name] = {} if factor is None else known
    return scores
