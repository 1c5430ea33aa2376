import torch

from m3depth.network.fine import warp_right
from m3depth.network.refinement import ConvexUpsampling, CorrelationLookup


def test_lookup_against_loops() -> None:
    """Row-wise scores, interpolated between pixels, 0 outside; the second level sees pairs of right pixels."""
    torch.manual_seed(0)
    left, right = torch.randn(2, 1, 4, 2, 8)
    disparity = torch.tensor([0.0, 0.25, 1.0, 2.5, 7.0, 20.0, 0.0, 3.75]).expand(1, 1, 2, 8)
    found = CorrelationLookup(left, right, radius=2, levels=2)(disparity)
    assert found.shape == (1, 10, 2, 8)
    scores = torch.einsum("bchx,bchy->hxy", left, right) / 2
    halved = scores.unflatten(2, (4, 2)).mean(3)

    def at(row: torch.Tensor, position: float) -> float:
        low = int(position // 1)
        share = position - low
        value = [float(row[i]) if 0 <= i < len(row) else 0.0 for i in (low, low + 1)]
        return value[0] * (1 - share) + value[1] * share

    for y in range(2):
        for x in range(8):
            place = x - float(disparity[0, 0, y, x])
            expected = [at(scores[y, x], place + k) for k in range(-2, 3)]
            expected += [at(halved[y, x], (place - 0.5) / 2 + k) for k in range(-2, 3)]
            torch.testing.assert_close(found[0, :, y, x], torch.tensor(expected))


def test_upsampling_stays_within_the_neighbourhood() -> None:
    torch.manual_seed(0)
    upsample = ConvexUpsampling(4, 4)
    maps = torch.randn(1, 2, 5, 6)
    fine = upsample(3 * torch.randn(1, 4, 5, 6), maps)
    assert fine.shape == (1, 2, 20, 24)
    highest = torch.nn.functional.max_pool2d(maps, 3, 1, 1)
    lowest = -torch.nn.functional.max_pool2d(-maps, 3, 1, 1)
    cells = fine.unflatten(3, (6, 4)).unflatten(2, (5, 4)).permute(0, 1, 3, 5, 2, 4)  # (B, M, 4, 4, 5, 6)
    assert (cells <= highest[:, :, None, None] + 1e-5).all()
    assert (cells >= lowest[:, :, None, None] - 1e-5).all()


def test_a_disparity_that_is_no_number_stays_one() -> None:
    """It must not become a place outside the scores: training stops at a loss of NaN, infer says unknown."""
    left, right = torch.ones(2, 1, 4, 2, 8)
    disparity = torch.ones(1, 1, 2, 8)
    disparity[0, 0, 0, 3], disparity[0, 0, 1, 4] = torch.nan, torch.inf
    found = CorrelationLookup(left, right, radius=2, levels=2)(disparity)
    assert found[0, :, 0, 3].isnan().all() and found[0, :, 1, 4].isnan().all()
    assert int(found.isfinite().all(1).sum()) == 14
    warped = warp_right(right, disparity)
    assert warped[0, :, 0, 3].isnan().all() and warped[0, :, 0, 2].isfinite().all()
