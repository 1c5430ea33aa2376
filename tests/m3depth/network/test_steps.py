"""The disparity after each refinement step, on the grids of the network and at the size of the images."""

from dataclasses import replace

import numpy as np
import torch
from small_network import SMALL

from m3depth.network.model import M3Depth
from m3depth.network.output import GridMap


def test_a_grid_is_enlarged_to_the_images_and_its_disparities_with_it() -> None:
    ramp = torch.arange(6.0).repeat_interleave(4)[None]  # [px of a working image of 22 x 24 px]
    cells = torch.arange(6.0).expand(1, 1, 6, 6)
    small = GridMap("step 1", cells, 4).at_size((22, 24), (22, 24))
    assert small.disparity.shape == (22, 24) and small.working_size == (22, 24)
    np.testing.assert_allclose(small.disparity.mean(0), ramp[0], atol=0.5)
    large = GridMap("step 1", cells, 4).at_size((22, 24), (44, 48))
    np.testing.assert_allclose(large.disparity[::2, ::2].mean(), 2 * small.disparity.mean(), rtol=0.05)


def test_a_disparity_of_no_finite_depth_is_0() -> None:
    step = GridMap("result", torch.tensor([[[[-1.0, 0.01, 2.0, torch.nan]]]]), 1).at_size((1, 4), (1, 4))
    np.testing.assert_array_equal(step.disparity, [[0, 0, 2, np.nan]])


def test_a_large_pair_has_the_steps_of_each_size_and_ends_at_the_result(large_samples) -> None:
    torch.manual_seed(0)
    network = M3Depth(SMALL).eval()
    sample = large_samples[0]
    steps = network.infer_steps(sample.left, sample.right, sample.rig)
    finer = [f"step {n}" for n in range(1, SMALL.finer_steps + 1)]
    assert [step.name for step in steps] == ["first map", "step 1", "step 2", "result", *finer, "result"]
    assert steps[0].working_size < steps[-1].working_size == sample.left.shape[:2]
    assert {step.disparity.shape for step in steps} == {sample.left.shape[:2]}
    prediction = network.infer(sample.left, sample.right, sample.rig)
    measured = np.isfinite(prediction.depth)
    np.testing.assert_array_equal(steps[-1].disparity[measured], prediction.disparity[measured])


def test_a_network_without_refinement_takes_no_steps() -> None:
    assert M3Depth(SMALL).takes_steps
    assert not M3Depth(replace(SMALL, refine_steps=0, fine_width=0, lookup_levels=0)).takes_steps
