import torch

from m3depth.network.backbone import LEAST_CONTRAST, Backbone, normalised


def test_a_pair_gets_one_mean_and_contrast_and_keeps_the_gain_between_its_images() -> None:
    left = 0.2 + 0.1 * torch.rand(2, 3, 8, 8)
    first, second = normalised(left, 2 * left).chunk(2)
    torch.testing.assert_close(first.mean((1, 2, 3)), torch.zeros(2), atol=1e-5, rtol=0)
    torch.testing.assert_close(first.std((1, 2, 3)), torch.ones(2))
    torch.testing.assert_close(second.std((1, 2, 3)), torch.full((2,), 2.0))
    brighter = normalised(3 * left + 0.1, 3 * 2 * left + 0.1).chunk(2)
    torch.testing.assert_close(brighter[0], first, atol=1e-4, rtol=0)


def test_a_blank_pair_is_not_divided_by_zero() -> None:
    blank = torch.full((1, 3, 8, 8), 0.5)
    assert normalised(blank, blank).abs().max() < 1e-6 / LEAST_CONTRAST


def test_without_the_right_eighths_all_other_features_stay() -> None:
    torch.manual_seed(0)
    backbone, pair = Backbone((8, 8, 16), (1, 1), 3).eval(), torch.rand(4, 3, 64, 32)
    with torch.inference_mode():
        both, left = backbone(pair), backbone(pair, both_eighths=False)
    assert both.eighth.shape == (4, 16, 8, 4) and left.eighth.shape == (2, 16, 8, 4)
    torch.testing.assert_close(left.eighth, both.eighth[:2])
    assert torch.equal(left.half, both.half) and torch.equal(left.quarter, both.quarter)
