import cv2
import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.network.geometry import (
    GRAZING,
    disparity_to_depth,
    face_camera,
    normals_from_disparity,
    pixel_rays,
    relief,
    scale_camera,
    sobel,
    unit,
)
from marssim.base.camera import NATECAM, PinholeCamera

UV = (1, 0), (0, 1)  # orders of the derivatives along u and v
CAMERA = torch.tensor([[60.0, 55.0, 9.3, 5.1]], dtype=torch.float64)


def plane_depth(normal: torch.Tensor, height: int = 12, width: int = 20) -> torch.Tensor:
    return -1.2 / (pixel_rays(CAMERA, height, width) * normal[None, :, None, None]).sum(1, keepdim=True)


def test_rays_are_the_camera_models() -> None:
    rays = pixel_rays(CAMERA, 12, 20)[0].permute(1, 2, 0)
    np.testing.assert_allclose(rays.numpy(), PinholeCamera(20, 12, 60.0, 55.0, 9.3, 5.1).rays(), atol=1e-12)


def test_scaled_camera_is_the_resized_one() -> None:
    small = NATECAM.camera.resized(64, 64)
    full = NATECAM.camera
    scaled = scale_camera(torch.tensor([[full.fx, full.fy, full.cx, full.cy]], dtype=torch.float64), 8)
    np.testing.assert_allclose(scaled[0].numpy(), [small.fx, small.fy, small.cx, small.cy])


def test_depth_is_the_rigs_and_no_match_is_infinite() -> None:
    depth = np.array([0.5, 3.0, 15.0, np.inf])
    disparity = torch.from_numpy(NATECAM.depth_to_disparity(depth))
    np.testing.assert_allclose(disparity_to_depth(disparity, NATECAM.fb).numpy(), depth)
    assert disparity_to_depth(torch.tensor([-1.0, 0.0, 0.01]), NATECAM.fb).isinf().all()
    assert disparity_to_depth(torch.tensor([torch.nan]), NATECAM.fb).isnan().all()  # unknown is not far


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_normals_of_planes_are_exact(nx: float, ny: float) -> None:
    normal = torch.tensor([nx, ny, -1.0], dtype=torch.float64)
    normal = normal / normal.norm()
    depth = plane_depth(normal)
    computed = normals_from_disparity(16.2 / depth, CAMERA)
    expected = normal[:, None, None].expand(3, 10, 18)
    torch.testing.assert_close(computed[0, :, 1:-1, 1:-1], expected, atol=1e-9, rtol=0)


def test_a_level_disparity_has_no_relief_up_to_the_border() -> None:
    assert not relief(torch.full((1, 1, 6, 9), 20.0)).any()


def test_sobel_of_an_affine_map() -> None:
    v, u = torch.meshgrid(torch.arange(5.0), torch.arange(7.0), indexing="ij")
    slope = sobel((0.3 * u - 0.2 * v + 4)[None, None])[0, :, 1:-1, 1:-1]
    torch.testing.assert_close(slope, torch.tensor([0.3, -0.2])[:, None, None].expand(2, 3, 5))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_sobel_is_opencvs(seed: int) -> None:
    x = np.random.default_rng(seed).normal(100, 30, (9, 14))
    expected = [cv2.Sobel(x, cv2.CV_64F, *order, scale=1 / 8, borderType=cv2.BORDER_REPLICATE) for order in UV]
    np.testing.assert_allclose(sobel(torch.from_numpy(x)[None, None])[0].numpy(), expected, atol=1e-12)


def test_slopes_and_normals_keep_their_precision_under_autocast() -> None:
    """bf16 counts in half pixels from 64 px of disparity on."""
    camera = scale_camera(torch.tensor([[595.9, 595.9, 255.5, 255.5]]), 2)
    near = (100 + 0.23 * torch.arange(32.0)[:, None] + 0.01 * torch.arange(48.0))[None, None]
    slopes, normals = sobel(near), normals_from_disparity(near, camera)
    with torch.autocast("cpu", torch.bfloat16):
        torch.testing.assert_close(sobel(near), slopes)
        torch.testing.assert_close(normals_from_disparity(near, camera), normals)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_normals_that_point_away_are_moved_to_the_silhouette_and_others_kept(seed: int) -> None:
    random = torch.Generator().manual_seed(seed)
    normal = unit(torch.randn(1, 3, 6, 9, generator=random, dtype=torch.float64))
    view = unit(pixel_rays(CAMERA, 6, 9))
    computed = face_camera(normal, pixel_rays(CAMERA, 6, 9))
    torch.testing.assert_close(computed.norm(dim=1), torch.ones(1, 6, 9, dtype=torch.float64))
    along, before = ((n * view).sum(1) for n in (computed, normal))
    assert (along < 0).all()
    visible = before < -GRAZING
    assert visible.any() and (~visible).any()
    torch.testing.assert_close(computed.movedim(1, -1)[visible], normal.movedim(1, -1)[visible])
    # the angle that it is moved by is the one that it leant away by, whatever lies across the line of sight
    moved = torch.rad2deg((computed * normal).sum(1).clamp(-1, 1).acos())[~visible]
    away = torch.rad2deg(before.clamp(-1, 1).asin())[~visible]
    steep = away < 60
    torch.testing.assert_close(moved[steep], away[steep], atol=0.2, rtol=0)
