import torch

from m3depth.rivals.output import Truth
from m3depth.rivals.uni_mvs_net import Sweep, focal_loss, moved_features

START, STEP, PLANES = 10.0, 2.0, 8


def sweep_of(disparity: torch.Tensor, certain: float = 1e-4) -> Sweep:
    """A sweep whose planes have the values that they should have."""
    above = (disparity - START) / STEP - torch.arange(PLANES)[:, None, None]
    value = torch.where((above >= 0) & (above < 1), 1 - above, 0.0)
    return Sweep(value.clamp(certain, 1 - certain).logit(), torch.full_like(disparity, START), STEP, 2)


def truth_of(disparity: torch.Tensor, known: torch.Tensor) -> Truth:
    return Truth(disparity, known, torch.zeros(1, 3, *disparity.shape[-2:]))


def test_plane_and_value_together_are_the_disparity() -> None:
    true = torch.tensor([[[[10.5, 13.0, 17.9, 25.9]]]])
    torch.testing.assert_close(sweep_of(true).disparity(), true, atol=1e-3, rtol=0)


def test_the_focal_loss_is_least_at_the_right_values_and_sees_the_known_cells_alone() -> None:
    cells = torch.tensor([[[[11.0, 20.0]]]])
    pixels = torch.zeros(1, 1, 1, 4)
    pixels[..., ::2] = cells
    known = torch.ones_like(pixels, dtype=torch.bool)
    right, wrong = sweep_of(cells), sweep_of(cells.flip(3))
    for focus, empty in ((2, 0.75), (0, 0.25)):
        assert focal_loss(wrong, truth_of(pixels, known), focus, empty) > 4 * focal_loss(
            right, truth_of(pixels, known), focus, empty
        )
    half_right = sweep_of(torch.tensor([[[[11.0, 14.0]]]]))
    first = known.clone()
    first[..., 2:] = False
    assert focal_loss(half_right, truth_of(pixels, first), 1, 0.5) == focal_loss(right, truth_of(pixels, first), 1, 0.5)
    assert focal_loss(right, truth_of(pixels, ~known), 1, 0.5) == 0


def test_a_missed_plane_weighs_more_than_a_found_one() -> None:
    """(1 + 2 miss)^focus of the plane in front of the truth: at a value of 1, from 1 where it is found to 3."""
    true = torch.full((1, 1, 1, 1), START + 2 * STEP)
    scores = torch.full((1, PLANES, 1, 1), -40.0)  # all planes are sure to be empty
    sweep = Sweep(scores, torch.full_like(true, START), STEP, 1)
    known = torch.ones_like(true, dtype=torch.bool)
    plain, focused = (float(focal_loss(sweep, truth_of(true, known), focus, 0.5)) for focus in (0, 2))
    sigmoid = 1 / (1 + 5**-1.0)
    assert plain == 40 / PLANES
    assert abs(focused / plain - (1 + 4 * (sigmoid - 0.5)) ** 2) < 1e-4


def test_the_planes_move_the_right_features_by_their_disparity() -> None:
    right = torch.rand(1, 3, 4, 16)
    moved = moved_features(right, torch.full((1, 1, 4, 16), 4.0), 2.0, 3, cell=2)  # 2, 3 and 4 cells
    assert moved.shape == (1, 3, 3, 4, 16)
    for plane, shift in enumerate((2, 3, 4)):
        torch.testing.assert_close(moved[:, :, plane, :, shift:], right[..., :-shift])
        assert not moved[:, :, plane, :, : shift - 1].any()
