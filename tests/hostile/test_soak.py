"""The verdict of a long run finds growth, and takes noise and the first minutes for none."""

import numpy as np
import pytest
from soak import FEWEST, held, verdict


def rows(memory, files=20.0):
    return [{"seconds": 5.0 * n, "memory": m, "files": files, "threads": 4.0} for n, m in enumerate(memory)]


@pytest.mark.parametrize("grows", [False, True])
def test_growth_is_told_from_noise_and_from_a_warm_start(grows):
    rng, number = np.random.default_rng(0), 400
    memory = 500 + 300 * (1 - np.exp(-np.arange(number) / 20)) + rng.normal(0, 5, number)
    memory[350] += 400  # a peak
    found, words = verdict(rows(memory + grows * 0.5 * np.arange(number)))
    assert found == grows and ("memory GROWS" in words) == grows
    assert verdict(rows([500.0] * FEWEST)) == (False, f"too short for a verdict: {FEWEST // 2} of {FEWEST} lines")


def test_what_a_process_holds_is_counted(tmp_path):
    before = held()
    with (tmp_path / "file").open("w"):
        assert held()["files"] == before["files"] + 1
    assert before["memory"] > 1 and before["threads"] >= 1
