"""The errors of a quick validation, against sums by hand."""

import pytest
import torch

from m3depth.losses import Target
from m3depth.network.model import StereoOutput
from m3depth.validation import error_sums

SHAPE = (1, 1, 8, 12)


def target_of(disparity: torch.Tensor, label: torch.Tensor) -> Target:
    normal = torch.tensor([0.0, 0.0, -1.0])[:, None, None].expand(1, 3, *SHAPE[2:])
    no = torch.zeros(SHAPE, dtype=torch.bool)
    return Target(disparity * label, normal, label, no, no, torch.tensor([[60.0, 60.0, 5.5, 3.5]]))


def output_of(disparity: torch.Tensor, target: Target) -> StereoOutput:
    logits = torch.full(SHAPE, -5.0)
    return StereoOutput(disparity, target.normal, -logits, logits, (disparity, target.normal), [])


def test_edges_of_sparse_truth_are_those_between_labelled_pixels() -> None:
    disparity = torch.full(SHAPE, 20.0)
    label = torch.rand(SHAPE, generator=torch.Generator().manual_seed(1)) < 0.4
    sums = error_sums(output_of(disparity + 1.5, target_of(disparity, label)), target_of(disparity, label))
    count = int(label.sum())
    assert sums["edge_epe"] == (0, 0)
    assert sums["epe"] == pytest.approx((1.5 * count, count))
    assert sums["bad1"] == (count, count)
    disparity[..., 6:] = 40.0
    everywhere = torch.ones_like(label)
    sums = error_sums(output_of(disparity + 0.5, target_of(disparity, everywhere)), target_of(disparity, everywhere))
    assert sums["edge_epe"] == (0.5 * 2 * SHAPE[2], 2 * SHAPE[2])  # both sides of the step
    assert sums["abs_rel"][0] == pytest.approx(SHAPE[2] * 6 * (1 - 20 / 20.5 + 1 - 40 / 40.5), rel=1e-4)
