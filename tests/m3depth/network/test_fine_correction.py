"""The last correction compares what the disparity points to, and is no correction at first."""

from dataclasses import replace

import pytest
import torch
from plane_target import CAMERA, plane

from m3depth.network.config import M3DepthConfig
from m3depth.network.fine_correction import MAPS, MATCHED, FineCorrection, warp_right
from m3depth.network.model import M3Depth


def test_warping_against_loops() -> None:
    """Linear between pixels, 0 outside the image."""
    torch.manual_seed(0)
    right = torch.randn(1, 3, 2, 8)
    disparity = torch.tensor([0.0, 0.25, 1.0, 2.5, 7.0, 20.0, -3.0, 3.75]).expand(1, 1, 2, 8)
    warped = warp_right(right, disparity)
    for x in range(8):
        place = x - float(disparity[0, 0, 0, x])
        low = int(place // 1)
        share = place - low
        near, far = (right[0, :, :, i] if 0 <= i < 8 else torch.zeros(3, 2) for i in (low, low + 1))
        torch.testing.assert_close(warped[0, :, :, x], near * (1 - share) + far * share)


def test_the_true_disparity_matches_best() -> None:
    torch.manual_seed(0)
    right = torch.randn(1, 8, 4, 40)
    left = torch.roll(right, 5, 3)
    scores = [float((left * warp_right(right, torch.full((1, 1, 4, 40), d)))[..., 10:].mean()) for d in (4.0, 5.0, 6.0)]
    assert scores[1] > 0.8 and max(scores[0], scores[2]) < 0.3


def test_pixels_of_the_image_are_matched_on_a_grid_of_half_its_size() -> None:
    torch.manual_seed(0)
    fine = FineCorrection(features=8, hidden=8, width=8)
    right = torch.randn(1, MATCHED, 4, 40)
    scores = fine._scores(torch.cat([torch.roll(right, 5, 3), right]), torch.full((1, 1, 4, 40), 10.0))
    mean = scores[..., 10:-2].mean((0, 2, 3))
    assert mean.argmax() == fine.radius and mean[fine.radius] > 0.8


def test_the_normals_that_the_disparity_implies_are_those_of_the_plane() -> None:
    torch.manual_seed(0)
    fine = FineCorrection(features=8, hidden=8, width=8)
    seen: list[torch.Tensor] = []
    fine.first.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    disparity, normal = (x.float() for x in plane((0.2, -0.5, -1.0), 32, 48))
    maps = torch.cat([disparity, normal, torch.zeros(1, 2, 32, 48)], 1)
    left, right = torch.randn(2, 1, 8, 16, 24)
    fine(left, right, torch.randn(1, 8, 8, 12), maps, CAMERA.float())
    given, implied = seen[0][:, -8:-5], seen[0][:, -5:-2]
    torch.testing.assert_close(given, normal[..., ::2, ::2])
    torch.testing.assert_close(implied[..., 1:-1, 1:-1], given[..., 1:-1, 1:-1], atol=1e-3, rtol=0)


def test_a_new_correction_corrects_nothing_and_learns() -> None:
    torch.manual_seed(0)
    fine = FineCorrection(features=8, hidden=8, width=8)
    left, right = torch.randn(2, 2, 8, 16, 24)
    hidden, maps = torch.randn(2, 8, 8, 12), torch.randn(2, MAPS, 32, 48)
    camera = torch.tensor([[60.0, 60, 24, 16]] * 2)
    out = fine(left, right, hidden, maps, camera)
    assert out.shape == maps.shape and not out.any()
    out.sum().backward()
    assert fine.last.weight.grad is not None and fine.last.weight.grad.abs().max() > 0


def test_weights_without_the_fine_part_load_without_it() -> None:
    """JSON that was written before the part existed is of a network without it."""
    config = M3DepthConfig()
    old = {"hidden": 32}
    assert config.fine_width > 0
    assert M3DepthConfig.from_dict(old).fine_width == 0


@pytest.mark.parametrize("size", [(64, 64), (50, 75)])
def test_the_network_corrects_at_any_size(size: tuple[int, int]) -> None:
    torch.manual_seed(0)
    with_it = M3Depth(M3DepthConfig()).eval()
    without = M3Depth(replace(M3DepthConfig(), fine_width=0)).eval()
    without.load_state_dict({k: v for k, v in with_it.state_dict().items() if not k.startswith("fine.")})
    left, right = torch.rand(2, 1, 3, *size)
    camera = torch.tensor([[60.0, 60, size[1] / 2, size[0] / 2]])
    with torch.no_grad():
        torch.testing.assert_close(with_it(left, right, camera), without(left, right, camera))
        with_it.fine.last.get_parameter("bias").fill_(0.5)  # type: ignore[union-attr]
        moved = with_it(left, right, camera).disparity - without(left, right, camera).disparity
    torch.testing.assert_close(moved, torch.full((1, 1, *size), 0.5))
