import pytest
import torch
from plane_target import every_second_row, make_target, random_holes, with_holes

from m3depth.training.batch import disparity_edges, reduce_target


def test_reduced_disparity_is_that_of_the_cells_centre() -> None:
    target = make_target()
    reduced, _ = reduce_target(target, 8, torch.ones_like(target.disparity))
    # Disparity is affine on a plane: the mean over a cell is the value at its centre.
    expected = torch.nn.functional.avg_pool2d(target.disparity, 8)
    assert reduced.label.all()
    torch.testing.assert_close(reduced.disparity, expected)
    torch.testing.assert_close(reduced.normal, target.normal[..., :2, :3])


@pytest.mark.parametrize("holes_of", [random_holes, every_second_row])
def test_gaps_are_no_edges_and_cells_need_no_four_pixels(holes_of) -> None:
    full = make_target(64, 96)
    target = with_holes(full, holes_of(full.label.shape))
    labelled = target.label
    assert 0.2 < labelled.float().mean() < 0.6
    assert not (disparity_edges(target.disparity, target.valid) & labelled).any()
    for factor in (4, 8):
        reduced, _ = reduce_target(target, factor, torch.ones_like(target.disparity))
        centre = torch.nn.functional.avg_pool2d(full.disparity, factor)
        assert reduced.label.float().mean() > 0.6
        slope = (full.disparity[..., 1:, :] - full.disparity[..., :-1, :]).max()
        assert (reduced.disparity - centre)[reduced.label].abs().max() <= slope  # half a pixel each way
        assert (reduced.normal - full.normal[..., :1, :1]).abs().amax(1, keepdim=True)[reduced.label].max() < 1e-6


def test_an_edge_between_sparse_pixels_is_one_and_what_is_known_but_not_trained_hides_no_cell() -> None:
    target = make_target(16, 16)
    target.disparity[..., 8:] += 30
    step = target.disparity[..., :1, 7:9]
    assert step.diff().item() > 29
    sparse = with_holes(target, every_second_row(target.label.shape))
    assert disparity_edges(sparse.disparity, sparse.valid)[0, 0, 1::2, 7:9].all()
    assert not disparity_edges(sparse.disparity, sparse.valid)[0, 0, 1::2, :6].any()
    far = make_target(16, 16)  # as beyond 40 m: known, not trained
    far.label[..., 3, 3] = False
    reduced, _ = reduce_target(far, 8, torch.ones_like(far.disparity))
    assert not reduced.label[0, 0, 0, 0] and reduced.label.sum() == 3


def test_a_cell_weighs_as_much_as_the_heaviest_of_its_middle_pixels() -> None:
    target = make_target()
    weight = torch.ones_like(target.disparity)
    weight[..., 3, 4] = 5
    weight[..., 8:, 8] = 9  # beside the middle of their cells
    _, reduced = reduce_target(target, 8, weight)
    assert reduced[0, 0].tolist() == [[5, 1, 1], [1, 1, 1]]
