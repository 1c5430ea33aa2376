from dataclasses import replace

import torch

from m3depth.network.config import M3DepthConfig
from m3depth.network.cost_volume import Aggregation, group_correlation_volume, soft_argmin


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
