"""Differentiable geometry of rectified stereo.

Convention: camera frame x right, y down, z forward; pixel centres are integers; a camera is the row fx, fy, cx, cy
[px]. Maps are (B, C, H, W). Disparity [px] is x_left - x_right, depth [m] is z. Normals face the camera.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

GRAZING = 1e-3  # least cosine between the line of sight and the normal of a visible surface
MIN_DISPARITY = 0.05  # [px] a smaller disparity cannot be distinguished from infinitely far


def unit(x: Tensor) -> Tensor:
    """Scale vectors to length 1; zero vectors stay (nearly) zero.

    Several times faster on a CPU than functional.normalize, whose norm is slow along a strided dimension.

    Args:
        x: (B, C, ...), vectors along dimension 1.

    Returns:
        (B, C, ...).
    """
    return x * (x * x).sum(1, keepdim=True).clamp(min=1e-12).rsqrt()


def disparity_to_depth(disparity: Tensor, fb: Tensor | float) -> Tensor:
    """Convert disparity to depth, Z = f B / d (paper, Eq. 1).

    Args:
        disparity: (...) [px].
        fb: Focal length times baseline [px m].

    Returns:
        (...) [m]; inf where d < MIN_DISPARITY, NaN where d is NaN.
    """
    far = disparity < MIN_DISPARITY
    depth = fb / torch.where(far, torch.ones_like(disparity), disparity)
    return torch.where(far, torch.full_like(disparity, torch.inf), depth)


def scale_camera(camera: Tensor, factor: int) -> Tensor:
    """Return the camera of the grid that has one cell for factor x factor pixels: (B, 4) -> (B, 4)."""
    focal, centre = camera[:, :2], camera[:, 2:]
    return torch.cat([focal / factor, (centre + 0.5) / factor - 0.5], 1)


def pixel_rays(camera: Tensor, height: int, width: int) -> Tensor:
    """Return the direction of each pixel centre, scaled to z = 1.

    Args:
        camera: (B, 4).
        height, width: Of the grid [px].

    Returns:
        (B, 3, height, width).
    """
    u = torch.arange(width, dtype=camera.dtype, device=camera.device)
    v = torch.arange(height, dtype=camera.dtype, device=camera.device)
    fx, fy, cx, cy = camera[:, :, None].unbind(1)  # (B, 1) each
    x = ((u - cx) / fx)[:, None, :].expand(-1, height, -1)
    y = ((v - cy) / fy)[:, :, None].expand(-1, -1, width)
    return torch.stack([x, y, torch.ones_like(x)], 1)


def resize(maps: Tensor, size: torch.Size) -> Tensor:
    """Resample maps to a grid whose size is a multiple or a part of theirs: bilinear, or the mean of each cell.

    Args:
        maps: (B, C, H, W).
        size: (h, w) of the new grid.

    Returns:
        (B, C, h, w).
    """
    # An exported graph keeps the size variable, but would fix a factor.
    if maps.shape[-1] > size[-1]:
        return F.avg_pool2d(maps, maps.shape[-1] // size[-1])
    return maps if maps.shape[-1] == size[-1] else F.interpolate(maps, size, mode="bilinear")


def relief(disparity: Tensor) -> Tensor:
    """Return how far a disparity map stands out from its 5 x 5 px surroundings, at most 8 px: (B, 1, H, W) [px]."""
    return (disparity - F.avg_pool2d(disparity, 5, 1, 2, count_include_pad=False)).clamp(-8, 8)


def sobel(x: Tensor) -> Tensor:
    """Return the derivatives along u and v by the Sobel filter, per pixel; exact for affine maps inside the border.

    Args:
        x: (B, 1, H, W).

    Returns:
        (B, 2, H, W). At the border, the nearest pixel is repeated, so the derivative is too small there.
    """
    # Not a convolution: autocast would round it to bf16, which is half a pixel at 100 px.
    padded = F.pad(x, (1, 1, 1, 1), mode="replicate")
    across, down = padded[..., 2:] - padded[..., :-2], padded[..., 2:, :] - padded[..., :-2, :]
    along_u = across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]
    along_v = down[..., :-2] + 2 * down[..., 1:-1] + down[..., 2:]
    return torch.cat([along_u, along_v], 1) / 8


def face_camera(normal: Tensor, rays: Tensor) -> Tensor:
    """Return the nearest unit normals that a camera can see, n . ray < 0.

    A normal that points away is moved to the silhouette, where the surface is seen edge-on. Ground near the horizon
    whose predicted normal leans a degree too far thus changes by that degree only.

    Args:
        normal: (B, 3, H, W), unit length.
        rays: (B, 3, H, W), of any length.

    Returns:
        (B, 3, H, W), unit length.
    """
    view = unit(rays)
    away = (normal * view).sum(1, keepdim=True)
    return unit(normal - (away + GRAZING).clamp(min=0) * view)


def facing_normals(normal: Tensor, rays: Tensor) -> Tensor:
    """Return normals (B, 3, H, W) with unit length and facing the camera, along rays (B, 3, H, W)."""
    return face_camera(unit(normal), rays)


def normals_from_disparity(disparity: Tensor, camera: Tensor) -> Tensor:
    """Return the unit normals of the surface that a disparity map describes.

    On a plane n . X = -h, disparity is f B / Z = -(f B / h) n . r, affine in the pixel: its slopes are n_x / fx and n_y
    / fy, and n_z is what remains, up to one common negative factor. The baseline does not matter.

    Args:
        disparity: (B, 1, H, W) [px].
        camera: (B, 4) of this grid.

    Returns:
        (B, 3, H, W), facing the camera.
    """
    rays = pixel_rays(camera, disparity.shape[-2], disparity.shape[-1])  # (B, 3, H, W)
    slope = sobel(disparity) * camera[:, :2, None, None]  # (B, 2, H, W)
    z = disparity - (slope * rays[:, :2]).sum(1, keepdim=True)  # (B, 1, H, W)
    return unit(-torch.cat([slope, z], 1))
