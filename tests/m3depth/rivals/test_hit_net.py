"""HITNet's planes, costs and losses on maps whose result is known in closed form."""

import pytest
import torch
from small_rivals import TINY

from m3depth.kinds.config import preset_config
from m3depth.kinds.networks import new_network
from m3depth.rivals.hit_net import Initialisation, Refine, subdivided, warped_costs
from m3depth.rivals.hit_net_loss import TILE, Choice, HitNetOutput, Scored, guess_loss, robust, spread, tile_truth
from m3depth.rivals.output import Truth

ACROSS, DOWN = 0.25, -0.5  # slopes of a plane [px / px]


def plane_tiles(rows: int, columns: int, side: float) -> torch.Tensor:
    """Return hypotheses (1, 3, rows, columns) of one plane of disparity, in tiles of a side [px]."""
    y, x = (side * torch.arange(count) + (side - 1) / 2 for count in (rows, columns))  # centres of the tiles
    disparity = 20 + ACROSS * x + DOWN * y[:, None]
    return torch.stack([disparity, torch.full_like(disparity, ACROSS), torch.full_like(disparity, DOWN)])[None]


def test_tiles_of_one_plane_are_that_plane_at_every_pixel_and_after_subdivision() -> None:
    tiles = plane_tiles(2, 3, TILE)
    y, x = torch.arange(8.0)[:, None], torch.arange(12.0)
    torch.testing.assert_close(spread(tiles, TILE, 1.0)[0, 0], 20 + ACROSS * x + DOWN * y)
    torch.testing.assert_close(subdivided(tiles, 1, TILE / 2), plane_tiles(4, 6, TILE / 2))


def test_the_next_resolution_doubles_disparities_and_keeps_the_slopes() -> None:
    finer = subdivided(plane_tiles(2, 3, TILE), 2, TILE)
    y, x = (TILE * torch.arange(count) + TILE / 2 - 0.5 for count in (4, 6))  # [px of the finer resolution]
    # pixel x of the coarse resolution covers 2 x and 2 x + 1, so that its centre lies at 2 x + 0.5
    expected = 2 * 20 + ACROSS * (x - 0.5) + DOWN * (y - 0.5)[:, None]
    torch.testing.assert_close(finer[0, 0], expected)
    torch.testing.assert_close(finer[0, 1:, 0, 0], torch.tensor([ACROSS, DOWN]))


def test_the_right_plane_has_no_cost_and_its_neighbours_have() -> None:
    right = torch.rand(1, 2, 8, 40, generator=torch.Generator().manual_seed(0))
    left = right.roll(5, 3)  # a disparity of 5 px
    planes = torch.zeros(1, 3, 2, 10)
    planes[:, 0] = 5
    costs = warped_costs(planes, left, right).unflatten(1, (4, TILE**2))[..., 2:-1]  # without the borders
    assert costs.shape == (1, 4, TILE**2, 2, 7)
    torch.testing.assert_close(costs[:, 2], torch.zeros(1, TILE**2, 2, 7))
    assert costs[:, 1].mean() > 0.3 and costs[:, 3].mean() > 0.3


def test_the_first_guess_is_the_disparity_of_equal_features() -> None:
    torch.manual_seed(0)
    first = Initialisation(features=3, described=2, width=6, disparities=16)
    right = torch.rand(1, 3, 8, 64)
    planes, costs = first(right.roll(7, 3), right, torch.rand(1, 2, 2, 16))
    assert planes.shape == (1, 16, 2, 16) and costs.shape == (1, 16, 2, 16)
    assert (planes[:, 0, :, 3:] == 7).all() and not planes[:, 1:3].any()


@pytest.mark.parametrize("features", [8, 16, 24])
def test_tiles_of_both_images_are_compared_alike_in_bfloat16(features) -> None:
    """The strides of the two differ, for which PyTorch has different kernels."""
    torch.manual_seed(0)
    first, image = Initialisation(features, described=2, width=8, disparities=8), torch.rand(1, features, 32, 64)
    with torch.autocast("cpu", torch.bfloat16):
        _, costs = first(image.bfloat16(), image.bfloat16(), torch.rand(1, 2, 8, 16))
    assert costs.dtype == torch.float32 and (costs[:, 0] == 0).all() and costs[:, 1:].mean() > 0.1


def test_a_tile_has_its_largest_known_disparity() -> None:
    disparity = torch.full((1, 1, 4, 8), -1.0)
    disparity[..., 1, 2], disparity[..., 3, 3] = 6.0, 10.0
    true, valid = tile_truth(disparity, 4, 2)
    assert true[0, 0, 0, 0] == 5
    assert valid.flatten().tolist() == [True, False]


def test_the_loss_of_a_guess_is_its_cost_at_the_truth_and_what_a_wrong_one_lacks() -> None:
    costs = torch.tensor([3.0, 0.2, 0.4, 5.0, 0.7])[None, :, None, None]
    true = torch.full((1, 1, 1, 1), 1.5)  # 0 and 3 px are just not wrong, so 4 px is the only wrong disparity
    loss = guess_loss(costs, true, torch.ones_like(true, dtype=torch.bool))
    torch.testing.assert_close(loss, torch.tensor(0.3 + (1 - 0.7)))
    assert guess_loss(costs, true + 9, torch.ones_like(true, dtype=torch.bool)) == 0  # beyond the search


def test_larger_costs_are_better_where_one_of_the_wrong_ones_is_least() -> None:
    """Else the costs of features that are not trained would fall to 0, all alike."""
    costs = torch.tensor([0.1, 0.9, 0.9, 0.3, 0.9, 0.9, 0.5])[None, :, None, None]
    true = torch.full((1, 1, 1, 1), 3.0)
    known = torch.ones_like(true, dtype=torch.bool)
    assert guess_loss(costs, true, known) == pytest.approx(0.3 + (0.9 + 0.1 + 0.1 + 0.5) / 4)  # 0, 1, 5 and 6 are wrong
    assert guess_loss(1.1 * costs, true, known) < guess_loss(costs, true, known)


def test_the_robust_distance_is_a_parabola_first_and_grows_more_slowly_than_the_error_later() -> None:
    small, large = torch.tensor([0.01, 0.02]), torch.tensor([10.0, 20.0])
    assert float(robust(small)[1] / robust(small)[0]) == pytest.approx(4, rel=0.02)
    assert 1.5 < float(robust(large)[1] / robust(large)[0]) < 2


def test_weights_that_are_not_finite_give_maps_that_are_not_finite() -> None:
    """The trainer then ends with a message, and not with an index out of range."""
    network = new_network(TINY["hit-net"])
    with torch.no_grad():
        next(network.refine.parameters()).fill_(torch.nan)
        next(network.propagation.parameters()).fill_(torch.nan)
        images = torch.rand(2, 1, 3, 32, 64)
        assert network(*images, torch.tensor([[60.0, 60, 32, 16]])).disparity.isnan().all()


def plane_output(scale: int, off: float = 0.0) -> tuple[HitNetOutput, Truth]:
    """Return the true planes of a plane of disparity at 1 / scale, moved by some pixels there, and the truth."""
    rows, columns, cell = 2, 3, TILE * scale
    tiles = plane_tiles(rows, columns, cell)  # disparities of the image
    y, x = torch.arange(float(rows * cell))[:, None], torch.arange(float(columns * cell))
    disparity = (20 + ACROSS * x + DOWN * y)[None, None]
    plane = torch.cat([tiles[:, :1] / scale + off, tiles[:, 1:]], 1)
    confidence = torch.full((1, 1, rows, columns), 0.5)
    output = HitNetOutput(disparity, [Scored(plane, cell, scale)], [], [Choice(confidence, plane, scale)])
    return output, Truth(disparity, disparity >= 0, torch.zeros(1, 3, *disparity.shape[2:]))


@pytest.mark.parametrize("scale", [1, 4])
def test_tiles_that_lie_in_the_true_plane_have_no_loss_and_should_be_chosen(scale) -> None:
    terms = HitNetOutput.terms(*plane_output(scale))
    assert float(terms["disparity"]) == pytest.approx(0, abs=1e-9)
    share = 1 - (TILE * scale * 2 - 2) * (TILE * scale * 3 - 2) / (TILE * scale) ** 2 / 6  # of pixels at the border
    assert float(terms["slant"]) < 0.75 * share  # where the true slopes are too small
    assert float(terms["choice"]) == pytest.approx(0.5)  # what the confidence lacks to 1


def test_tiles_that_lie_off_the_true_plane_have_their_robust_distance_and_should_not_be_chosen() -> None:
    terms = HitNetOutput.terms(*plane_output(4, off=1.6))
    assert float(terms["disparity"]) == pytest.approx(float(robust(torch.tensor(1.0))))  # no more than 1 px counts
    assert float(terms["choice"]) == pytest.approx(0.5) and float(terms["slant"]) == 0


def test_features_keep_their_size_at_the_start() -> None:
    torch.manual_seed(0)
    features = new_network(preset_config("hit-net")).features(2 * torch.rand(1, 3, 64, 64) - 1)
    assert all(0.1 < float(x.detach().std()) < 10 for x in features)


def test_a_part_of_a_pixel_changes_the_refinement_in_bfloat16() -> None:
    torch.manual_seed(0)
    refine, left = Refine(4, 8, (1,)), torch.rand(1, 4, 8, 8)
    planes = torch.zeros(1, 16, 8, 8)
    planes[:, 0] = 150
    moved = planes.clone()
    moved[:, 0, ::2] += 0.3
    with torch.autocast("cpu", torch.bfloat16):
        change = refine(moved, left) - moved - (refine(planes, left) - planes)
    assert float(change.detach().abs().max()) > 1e-3
