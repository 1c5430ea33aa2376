import pytest
import torch

from m3depth.network.output import PlainMaps, StereoOutput, maps_at_size, padded


@pytest.mark.parametrize(("height", "width"), [(16, 32), (17, 30), (1, 1)])
def test_padding_repeats_the_last_row_and_column_and_moves_nothing(height: int, width: int) -> None:
    maps = torch.rand(1, 2, height, width)
    whole = padded(maps, 16)
    assert whole.shape[-2] % 16 == 0 and whole.shape[-1] % 16 == 0
    assert whole.shape[-2] - height < 16 and whole.shape[-1] - width < 16
    assert torch.equal(whole[..., :height, :width], maps)
    assert (whole[..., height:, :width] == maps[..., -1:, :]).all()
    assert (whole[..., :height, width:] == maps[..., -1:]).all()


def test_a_disparity_grows_with_the_width_of_its_images() -> None:
    """From 35 x 16 to 70 x 33 px, whose height is more than doubled."""
    one = torch.ones(1, 1, 16, 35)
    level = torch.cat([0 * one, 0 * one, -one], 1)
    enlarged = maps_at_size(PlainMaps(5 * one, None, None, None), 33, 70)
    start = StereoOutput(5 * one, level, one, one, None, []).start(33, 70)
    for disparity in (enlarged.disparity, start.disparity):
        torch.testing.assert_close(disparity, torch.full((1, 1, 33, 70), 10.0))
