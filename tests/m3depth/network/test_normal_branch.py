import torch

from m3depth.network.config import M3DepthConfig
from m3depth.network.geometry import pixel_rays
from m3depth.network.normal_branch import SNNet, hypothesis_points

CAMERA = torch.tensor([[60.0, 60.0, 9.0, 5.0], [40.0, 45.0, 2.0, 7.0]])


def test_normals_are_unit() -> None:
    torch.manual_seed(0)
    net = SNNet(M3DepthConfig(channels=(8, 8, 8), groups=8, normal_widths=(8, 8, 8), normal_context=4))
    normal = net(torch.randn(2, 8, 16, 8, 12), torch.randn(2, 8, 8, 12), pixel_rays(CAMERA, 8, 12))
    torch.testing.assert_close(normal.norm(dim=1), torch.ones(2, 8, 12))
    assert (normal[:, 0] < 0).any(), "components of both signs must be possible"
    assert (normal[:, 0] > 0).any()


def test_hypothesis_points_lie_on_the_rays_at_inverse_disparity() -> None:
    rays = pixel_rays(CAMERA, 8, 12).requires_grad_()
    points = hypothesis_points(rays, 8)
    assert not points.requires_grad
    assert points.abs().max() <= 1
    torch.testing.assert_close(points[:, :, 4], rays.detach() * 0.125)
    torch.testing.assert_close(points[:, 2, 1] / points[:, 2, 2], torch.full((2, 8, 12), 2.0))


def test_hypothesis_points_of_a_wide_camera_lie_on_its_rays_too() -> None:
    """130 deg: X would be 2.1 where Z is 1."""
    rays = pixel_rays(torch.tensor([[2.8, 2.8, 5.5, 3.5]]), 8, 12)
    assert rays.abs().max() > 1.9
    points = hypothesis_points(rays, 8)
    assert points.abs().max() == 1
    torch.testing.assert_close(points / points[:, 2:], rays[:, :, None].expand_as(points))
