import math
from dataclasses import replace

import pytest
import torch
import torch.nn.functional as F
from small_network import SMALL

from m3depth.network import refinement
from m3depth.network.fine_correction import warp_right
from m3depth.network.geometry import scale_camera, unit
from m3depth.network.model import M3Depth
from m3depth.network.refinement import ConvexUpsampling, ConvGRU, CorrelationLookup, RefinementStep


def test_lookup_against_loops() -> None:
    """Row-wise scores, interpolated between pixels, 0 outside; the second level sees pairs of right pixels."""
    torch.manual_seed(0)
    left, right = torch.randn(2, 1, 4, 2, 8)
    disparity = torch.tensor([0.0, 0.25, 1.0, 2.5, 7.0, 20.0, 0.0, 3.75]).expand(1, 1, 2, 8)
    looked_up = CorrelationLookup(left, right, radius=2, levels=2)(disparity)
    assert looked_up.shape == (1, 10, 2, 8)
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
            torch.testing.assert_close(looked_up[0, :, y, x], torch.tensor(expected))


@pytest.mark.parametrize("band", [1, 900, 10**9])
def test_scores_that_are_not_kept_are_the_same(monkeypatch, band: int) -> None:
    torch.manual_seed(0)
    left, right = torch.randn(2, 2, 4, 7, 12)
    disparity = 14 * torch.rand(2, 1, 7, 12) - 1
    with torch.inference_mode():
        kept = CorrelationLookup(left, right, radius=2, levels=2)
        monkeypatch.setattr(refinement, "KEPT_SCORES", 100)
        monkeypatch.setattr(refinement, "BAND_SCORES", band)
        banded = CorrelationLookup(left, right, radius=2, levels=2)
        assert kept.pyramid is not None and banded.pyramid is None
        torch.testing.assert_close(banded(disparity), kept(disparity))
    assert CorrelationLookup(left, right, radius=2, levels=2).pyramid is not None  # training needs them


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


def test_a_nan_disparity_stays_nan() -> None:
    """It must not become a place outside the scores: training stops at a loss of NaN, infer says unknown."""
    left, right = torch.ones(2, 1, 4, 2, 8)
    disparity = torch.ones(1, 1, 2, 8)
    disparity[0, 0, 0, 3], disparity[0, 0, 1, 4] = torch.nan, torch.inf
    looked_up = CorrelationLookup(left, right, radius=2, levels=2)(disparity)
    assert looked_up[0, :, 0, 3].isnan().all() and looked_up[0, :, 1, 4].isnan().all()
    assert int(looked_up.isfinite().all(1).sum()) == 14
    warped = warp_right(right, disparity)
    assert warped[0, :, 0, 3].isnan().all() and warped[0, :, 0, 2].isfinite().all()


def test_the_gru_is_eq_20() -> None:
    """One pixel and one channel: H is blended with a candidate that sees what the reset gate lets through of H."""
    torch.manual_seed(0)
    gru = ConvGRU(1, 2).double()
    hidden, x, context = (torch.randn(1, channels, 1, 1).double() for channels in (1, 2, 3))

    def affine(layer: torch.nn.Conv2d, values: list[float]) -> list[float]:
        middle = layer.weight[:, :, 1, 1]
        return (middle @ torch.tensor(values).double() + layer.bias).tolist()

    h, (a, b), (c_update, c_reset, c_candidate) = float(hidden), x.flatten().tolist(), context.flatten().tolist()
    update, reset = affine(gru.gates, [h, a, b])
    update, reset = (1 / (1 + math.exp(-v)) for v in (update + c_update, reset + c_reset))
    candidate = math.tanh(affine(gru.candidate, [reset * h, a, b])[0] + c_candidate)
    assert gru(hidden, x, context).item() == pytest.approx((1 - update) * h + update * candidate)


@pytest.mark.parametrize("paper", [False, True])
def test_a_step_adds_what_its_heads_say(paper: bool) -> None:
    """D + Phi_d in pixels of the image, and at least 0; N + Phi_n of unit length (Eq. 18, 19)."""
    torch.manual_seed(0)
    step = RefinementStep(replace(SMALL, heads_see_all=paper), cell=4)
    hidden, first, context = torch.randn(1, 8, 5, 6), torch.randn(1, 8, 5, 6), torch.randn(1, 24, 5, 6)
    disparity, normal = 20 * torch.rand(1, 1, 5, 6), unit(torch.randn(1, 3, 5, 6))
    features = torch.randn(2, 1, 8, 5, 6)
    lookup = CorrelationLookup(*features, radius=SMALL.lookup_radius, levels=SMALL.lookup_levels)
    camera = torch.tensor([[60.0, 55.0, 2.3, 1.8]])

    def run(to_disparity: float, to_normal: tuple[float, float, float]) -> tuple[torch.Tensor, ...]:
        for head, bias in ((step.disparity, [to_disparity]), (step.normal, to_normal)):
            torch.nn.init.zeros_(head[-1].weight)
            head[-1].bias.data = torch.tensor(bias)
        return step(hidden, context, first, disparity, normal, lookup, camera)

    moved, same_disparity, same_normal = run(0.0, (0.0, 0.0, 0.0))
    assert not torch.equal(moved, hidden)
    torch.testing.assert_close(same_disparity, disparity)
    torch.testing.assert_close(same_normal, normal)
    _, farther, turned = run(-1.5, (0.0, 2.0, 0.0))
    torch.testing.assert_close(farther, (disparity - 6).clamp(min=0))
    torch.testing.assert_close(turned, F.normalize(normal + torch.tensor([0.0, 2.0, 0.0])[:, None, None], dim=1))


def test_every_grid_has_the_camera_of_its_own_pixels() -> None:
    """The steps work at a quarter of the size; pixel 0 of that grid lies at 1.5 of the image."""
    torch.manual_seed(0)
    model = M3Depth(replace(SMALL, fine_width=8)).eval()
    seen = {}
    model.refinement.step.register_forward_hook(lambda _, given, out: seen.update(step=given[-1]))
    model.fine.register_forward_hook(lambda _, given, out: seen.update(fine=given[-1]))
    camera = torch.tensor([[60.0, 55.0, 31.5, 20.0]])
    with torch.inference_mode():
        model(*torch.rand(2, 1, 3, 64, 64), camera)
    torch.testing.assert_close(seen["step"], torch.tensor([[15.0, 13.75, 7.5, 4.625]]))
    torch.testing.assert_close(seen["step"], scale_camera(camera, 4))
    torch.testing.assert_close(seen["fine"], camera)
