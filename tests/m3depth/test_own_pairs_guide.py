"""The program of docs/guides/train.md that makes samples of a user's pairs."""

import numpy as np
import pytest
from small_network import SMALL

from m3depth.network import config as sizes
from m3depth.training.config import TrainConfig
from m3depth.training.loop import train

pytestmark = pytest.mark.usefixtures("undrawn_figures")


def test_pairs_in_memory_are_trained(plane_samples, tmp_path, monkeypatch, guide_program):
    monkeypatch.setitem(sizes.PRESETS, "lite", SMALL)
    program: dict = {}
    exec(guide_program("own_pairs.py"), program)
    expected = plane_samples[0]
    depth = expected.depth.copy()
    depth[-8:, :10] = np.nan
    sample = program["sample"](expected.left, expected.right, depth, expected.rig)
    known = np.isfinite(depth)
    for name in ("disparity", "valid", "occluded"):
        assert np.array_equal(getattr(sample, name)[known], getattr(expected, name)[known]), name
    assert not sample.valid[~known].any() and not sample.occluded[~known].any()
    config = TrainConfig((tmp_path / "none",), tmp_path / "run", max_steps=2, batch=1, crop=(32, 64), device="cpu")
    train(config, [sample, sample], [])
    assert (tmp_path / "run" / "weights.safetensors").is_file()
