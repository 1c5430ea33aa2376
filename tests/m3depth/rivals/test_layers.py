"""Features between cells, which two of the methods look up."""

import torch

from m3depth.rivals.layers import sampled


def test_features_between_cells_are_interpolated_and_0_outside() -> None:
    features = torch.arange(12.0).reshape(1, 1, 3, 4)
    places = torch.tensor([[2.0, 1.0], [0.5, 1.0], [3.0, 1.5], [9.0, 1.0]])  # columns and rows
    values = sampled(features, places.T[None, :, :, None])
    torch.testing.assert_close(values.flatten(), torch.tensor([6.0, 4.5, 9.0, 0.0]))


def test_a_map_of_one_cell_can_be_sampled() -> None:
    assert sampled(torch.full((1, 1, 1, 1), 3.0), torch.zeros(1, 2, 1, 1)).item() == 3
