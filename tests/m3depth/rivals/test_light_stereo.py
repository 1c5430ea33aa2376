"""LightStereo's upsampling, and where its search ends."""

from dataclasses import replace

import torch
from small_rivals import TINY

from m3depth.kinds.networks import new_network
from m3depth.rivals.light_stereo import by_neighbours
from m3depth.stereo.pairs import NEAREST


def test_a_pixel_is_the_weighed_mean_of_the_cells_around_its_own() -> None:
    cells = torch.arange(12.0).reshape(1, 1, 3, 4)
    middle, left = torch.zeros(2, 1, 9, 12, 16)
    middle[:, 4] = 1
    left[:, 3] = 1
    torch.testing.assert_close(
        by_neighbours(cells, middle)[0, 0], cells[0, 0].repeat_interleave(4, 0).repeat_interleave(4, 1)
    )
    assert by_neighbours(cells, left)[0, 0, 5, 9] == cells[0, 0, 1, 1]
    assert by_neighbours(cells, left)[0, 0, 5, 0] == cells[0, 0, 1, 0]  # the border repeats
    torch.testing.assert_close(
        by_neighbours(cells, torch.full((1, 9, 12, 16), 1 / 9))[0, 0, 6, 6], cells[0, 0, :, :3].mean()
    )


def test_pairs_are_reduced_to_the_disparities_that_the_shifts_reach(plane_samples) -> None:
    sample = plane_samples[0]
    nearest = sample.rig.fb / NEAREST  # [px]
    height, width = sample.left.shape[:2]
    for shifts, reach in ((4, 16), (8, 32), (48, 192)):
        network = new_network(replace(TINY["light-stereo"], shifts=shifts)).eval()
        assert network.reach == reach
        sizes = []
        network.register_forward_pre_hook(lambda _, inputs, sizes=sizes: sizes.append(tuple(inputs[0].shape[-2:])))
        network.infer(sample.left, sample.right, sample.rig)
        scale = min(1, reach / nearest)
        assert sizes == [(round(height * scale), round(width * scale))]
