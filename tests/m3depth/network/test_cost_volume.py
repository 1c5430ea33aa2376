from dataclasses import replace

import pytest
import torch
from torch import nn

from m3depth.network.config import M3DepthConfig
from m3depth.network.cost_volume import Aggregation, ScoreConvolution, group_correlation_volume, soft_argmin


def test_volume_against_loops() -> None:
    torch.manual_seed(0)
    left, right = torch.randn(2, 1, 6, 3, 10, dtype=torch.float64)
    volume = group_correlation_volume(left, right, hypotheses=4, groups=2)
    assert volume.shape == (1, 2, 4, 3, 10)
    for group in range(2):
        channels = slice(3 * group, 3 * group + 3)
        for i in range(4):
            for y in range(3):
                for x in range(10):
                    other = right[0, channels, y, x - i] if x >= i else torch.zeros(3, dtype=torch.float64)
                    expected = (left[0, channels, y, x] * other).mean()
                    torch.testing.assert_close(volume[0, group, i, y, x], expected)


@pytest.mark.parametrize("kernel", [1, 3, 5])
def test_score_convolution_is_that_of_pytorch(kernel: int) -> None:
    torch.manual_seed(0)
    score = ScoreConvolution(groups=6, kernel=kernel).double()
    volume = torch.randn(2, 6, 4, 5, 7, dtype=torch.float64, requires_grad=True)
    results = []
    for scores in (score(volume), nn.Conv3d.forward(score, volume)):
        gradients = torch.autograd.grad(scores.square().sum(), [volume, *score.parameters()])
        results.append([scores, *gradients])
    torch.testing.assert_close(*results, rtol=1e-5, atol=1e-5)  # the sums are float32


def test_score_convolution_adds_in_float32_under_autocast() -> None:
    torch.manual_seed(0)
    score, volume = ScoreConvolution(groups=8, kernel=3), torch.randn(1, 8, 4, 5, 7)
    exact = score(volume)
    with torch.autocast("cpu", torch.bfloat16):
        scores = score(volume)
    assert scores.dtype == torch.float32
    torch.testing.assert_close(scores, exact, rtol=0, atol=0.02)


def test_soft_argmin_of_a_sharp_peak_is_its_disparity() -> None:
    scores = torch.full((1, 8, 1, 2), -50.0)
    scores[0, 3, 0, 0] = scores[0, 5, 0, 1] = 50.0
    torch.testing.assert_close(soft_argmin(scores, 8.0), torch.tensor([[[[24.0, 40.0]]]]))


def test_soft_argmin_gradients() -> None:
    scores = torch.randn(1, 5, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda s: soft_argmin(s, 8.0), (scores,))


def test_residual_starts_without_effect() -> None:
    """P_2 = P_1 + a residual that has learned nothing yet, up to its bias."""
    torch.manual_seed(0)
    config = M3DepthConfig(channels=(8, 8, 8), groups=8, volume_width=8, hypotheses=8, residual_width=8)
    with_context, plain = Aggregation(config), Aggregation(replace(config, residual_width=0))
    plain.load_state_dict(with_context.state_dict(), strict=False)
    volume, left = torch.randn(1, 8, 8, 4, 6), torch.randn(1, 8, 4, 6)
    bias = with_context.residual.bias[:, None, None]
    torch.testing.assert_close(with_context(volume, left)[1] - bias, plain(volume, left)[1])
    assert plain(volume, left)[2] is None
