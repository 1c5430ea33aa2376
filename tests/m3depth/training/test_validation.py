"""The errors of a quick validation, against sums by hand."""

import cv2
import numpy as np
import pytest
import torch

from m3depth.network.model import M3Depth, M3DepthConfig, StereoOutput
from m3depth.training.losses import Target
from m3depth.training.packing import pack
from m3depth.training.validation import COLUMNS, HEADER, error_sums, save_panel

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


def test_panels_are_headed_column_by_column(plane_samples, tmp_path) -> None:
    config = M3DepthConfig(
        channels=(8, 8, 16), wavelet_levels=(1, 1), match_channels=16, hypotheses=8, groups=8, volume_width=8,
        normal_widths=(8, 8, 8), refine_steps=1, hidden=8, motion=8, lookup_channels=8,
    )  # fmt: skip
    path = tmp_path / "panel.png"
    sample = plane_samples[0]
    model = M3Depth(config).eval()
    assert model.refinement is not None
    torch.nn.init.constant_(model.refinement.decisions[2].bias, 50.0)  # all is sky
    panel = save_panel(path, model, [pack(sample)] * 2, torch.device("cpu"))
    width = sample.left.shape[1] // 2
    assert panel.shape == (HEADER + sample.left.shape[0], len(COLUMNS) * width, 3)
    np.testing.assert_array_equal(panel, cv2.imread(str(path))[..., ::-1])
    np.testing.assert_array_equal(panel[HEADER:][: sample.left.shape[0] // 2, :width], sample.left[::2, ::2])
    assert (panel[HEADER:, 5 * width :] == 0).all(), "neither normals nor confidence in the sky"
    for column in range(len(COLUMNS)):
        name = panel[:HEADER, column * width :][:, :width]
        assert name.min() < 150 and (name[:, -1] == 255).all()  # something is written, and it ends before the next one
