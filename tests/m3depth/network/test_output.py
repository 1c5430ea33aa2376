import pytest
import torch

from m3depth.network.output import padded


@pytest.mark.parametrize(("height", "width"), [(16, 32), (17, 30), (1, 1)])
def test_padding_repeats_the_last_row_and_column_and_moves_nothing(height: int, width: int) -> None:
    maps = torch.rand(1, 2, height, width)
    whole = padded(maps, 16)
    assert whole.shape[-2] % 16 == 0 and whole.shape[-1] % 16 == 0
    assert whole.shape[-2] - height < 16 and whole.shape[-1] - width < 16
    assert torch.equal(whole[..., :height, :width], maps)
    assert (whole[..., height:, :width] == maps[..., -1:, :]).all()
    assert (whole[..., :height, width:] == maps[..., -1:]).all()
