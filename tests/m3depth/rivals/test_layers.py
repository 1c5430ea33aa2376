"""Features between cells, which two of the methods look up."""

import pytest
import torch

from m3depth.rivals.layers import sampled, upsampled


def test_features_between_cells_are_interpolated_and_0_outside() -> None:
    features = torch.arange(12.0).reshape(1, 1, 3, 4)
    places = torch.tensor([[2.0, 1.0], [0.5, 1.0], [3.0, 1.5], [9.0, 1.0]])  # columns and rows
    values = sampled(features, places.T[None, :, :, None])
    torch.testing.assert_close(values.flatten(), torch.tensor([6.0, 4.5, 9.0, 0.0]))


def test_a_map_of_one_cell_can_be_sampled() -> None:
    assert sampled(torch.full((1, 1, 1, 1), 3.0), torch.zeros(1, 2, 1, 1)).item() == 3


@pytest.mark.parametrize("factor", [2, 8])
def test_cells_of_a_larger_grid_lie_at_their_pixels(factor: int) -> None:
    cells = torch.arange(5.0).expand(1, 1, 3, 5) + torch.arange(3.0)[:, None]
    larger = upsampled(cells, factor)
    assert larger.shape == (1, 1, 3 * factor, 5 * factor)
    torch.testing.assert_close(larger[..., ::factor, ::factor], cells)
    torch.testing.assert_close(larger[..., 0, 1], torch.full((1, 1), 1 / factor))
    assert (larger[..., -factor:, -1] == 6).all()  # beyond the last cell
    torch.testing.assert_close(upsampled(cells, factor, (2 * factor + 1, 4)), larger[..., : 2 * factor + 1, :4])
