import torch

from m3depth.rivals.output import SequenceOutput, Truth, fading_shares
from m3depth.rivals.recurrent import sequence_shares


def truth_of(disparity: torch.Tensor, known: torch.Tensor) -> Truth:
    return Truth(disparity, known, torch.zeros(1, 3, *disparity.shape[-2:]))


def test_the_loss_of_a_sequence_is_the_weighted_sum_of_the_mean_errors_of_its_maps() -> None:
    true = torch.full((1, 1, 2, 2), 10.0)
    known = torch.tensor([[[[True, True], [True, False]]]])
    first, last = true + 4, true + torch.tensor([[1.0, 2.0], [3.0, torch.nan]])
    loss = SequenceOutput([first, last], [0.5, 1.0]).terms(truth_of(true, known))["disparity"]
    assert float(loss) == 0.5 * 4 + 2
    smooth = SequenceOutput([last], [1.0], knee=2.0).terms(truth_of(true, known))["disparity"]
    torch.testing.assert_close(smooth, torch.tensor((0.25 + 1.0 + 2.0) / 3))
    assert SequenceOutput([last], [1.0]).terms(truth_of(true, ~known))["disparity"].isnan()
    assert SequenceOutput([last], [1.0]).terms(truth_of(true, known & False))["disparity"] == 0


def test_the_weights_of_steps_end_at_1_and_the_first_ones_does_not_depend_on_their_number() -> None:
    assert fading_shares(3, 0.5) == [0.25, 0.5, 1.0]
    for count in (2, 8, 22):
        shares = sequence_shares(count)
        assert len(shares) == count and shares[-1] == 1
        torch.testing.assert_close(shares[0], 0.9**15)
    assert sequence_shares(1) == [1.0]
