"""CREStereo's correlation in a window, its positions, and the vertical component that is trained to be 0."""

import torch

from m3depth.rivals.cre_stereo import (
    GROUPS,
    SAMPLES,
    DisplacementOutput,
    Level,
    adaptive_correlation,
    position_code,
    window_offsets,
)
from m3depth.rivals.output import Truth


def test_the_scores_are_those_of_the_window_around_the_displacement() -> None:
    left, right = torch.randn(2, 1, 8, 6, 20, generator=torch.Generator().manual_seed(0))
    moved = torch.zeros(1, 2, 6, 20)
    moved[:, 0] = -3  # 3 cells to the left
    still = torch.zeros(1, SAMPLES, 2, 6, 20)
    for step, (sample, down, across) in ((0, (6, 0, 2)), (1, (5, 0, 1)), (1, (1, -1, 0))):
        y, x = 3, 10
        products = left[0, :, y, x] * right[0, :, y + down, x - 3 + across]
        expected = products.unflatten(0, (GROUPS, -1)).mean(1)
        for offsets in (None, still):  # learned offsets of 0 are the window itself
            scores = adaptive_correlation(Level(left, right, left, left, offsets), moved, step)
            assert scores.shape == (1, GROUPS * SAMPLES, 6, 20)
            torch.testing.assert_close(scores.unflatten(1, (GROUPS, SAMPLES))[0, :, sample, y, x], expected)
    away = still.clone()
    away[:, :, 1] = 1  # a learned offset of one row
    scores = adaptive_correlation(Level(left, right, left, left, away), moved, 0).unflatten(1, (GROUPS, SAMPLES))
    below = (left[0, :, 3, 10] * right[0, :, 4, 7]).unflatten(0, (GROUPS, -1)).mean(1)
    torch.testing.assert_close(scores[0, :, SAMPLES // 2, 3, 10], below)


def test_both_windows_have_nine_cells_around_the_middle() -> None:
    row, square = (window_offsets(step, torch.zeros(1)) for step in (0, 1))
    assert row[:, 1].eq(0).all() and row[:, 0].tolist() == list(range(-4, 5))
    assert sorted(map(tuple, square.int().tolist())) == [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]


def test_no_two_cells_have_one_position() -> None:
    code = position_code(torch.zeros(1, 16, 5, 7))
    assert code.shape == (1, 16, 5, 7)
    cells = code[0].flatten(1).T
    assert (torch.cdist(cells, cells) + 9 * torch.eye(35)).min() > 0.1


def test_the_loss_is_the_mean_of_both_components_and_rows_should_be_0() -> None:
    true = torch.full((1, 1, 2, 2), 5.0)
    valid = torch.tensor([[[[True, True], [True, False]]]])
    output = DisplacementOutput([true + 2, true - 1], [0.8, 1.0], rows=[true * 0 + 0.5, true * 0 - 0.1])
    terms = output.terms(Truth(true, valid, torch.zeros(1, 3, 2, 2)))
    torch.testing.assert_close(terms["disparity"], torch.tensor((0.8 * 2 + 1) / 2))
    torch.testing.assert_close(terms["rows"], torch.tensor((0.8 * 0.5 + 0.1) / 2))
    cut = output.cropped(1, 2)
    assert {x.shape for x in (*cut.maps, *cut.rows)} == {(1, 1, 1, 2)}
