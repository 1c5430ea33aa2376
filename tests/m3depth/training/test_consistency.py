"""The consistency loss is zero, within discretisation, on true depth and true normals, and is not for wrong normals.

Planes, where it is exactly zero, are in test_losses.py.
"""

import numpy as np
import pytest
import torch

from m3depth.network.geometry import pixel_rays, unit
from m3depth.training.batch import disparity_edges
from m3depth.training.losses import consistency_loss, consistency_residual, depth_consistency_residual
from marssim.base.camera import NATECAM
from marssim.base.pose import look_pose
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

CENTRE, RADIUS = torch.tensor([0.15, -0.1, 3.0], dtype=torch.float64), 0.8
FB = 100.0


def sphere(size: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Disparity, normals, camera and mask of a ball before the camera; its rim, seen edge-on, is masked."""
    camera = torch.tensor([[1.2 * size, 1.1 * size, size / 2 + 0.3, size / 2 - 2.0]], dtype=torch.float64)
    rays = pixel_rays(camera, size, size)
    across = (rays * CENTRE[:, None, None]).sum(1, keepdim=True)
    square = rays.square().sum(1, keepdim=True)
    under = across**2 - square * (CENTRE.square().sum() - RADIUS**2)
    depth = (across - under.clamp(min=0).sqrt()) / square
    normal = unit(rays * depth - CENTRE[:, None, None])
    cosine = -(normal * unit(rays)).sum(1, keepdim=True)
    mask = torch.nn.functional.max_pool2d(((under <= 0) | (cosine < 0.6)).double(), 3, 1, 1) == 0
    return torch.where(under > 0, size * FB / 64 / depth, 0), normal, camera, mask


@pytest.mark.parametrize("of_depth", [False, True])
def test_residual_on_a_sphere_falls_with_the_square_of_the_pixel(of_depth) -> None:
    means = []
    for size in (64, 128, 256):
        disparity, normal, camera, mask = sphere(size)
        residual, usable = consistency_residual(disparity, normal, camera)
        if of_depth:
            depth = size * FB / 64 / disparity.clamp(min=1e-3)
            residual, usable = depth_consistency_residual(size / 64 * depth, normal, camera)
        inside = (mask & usable).expand_as(residual)
        assert inside.double().mean() > 0.1
        # the slope stays the same as the image grows: comparable between sizes
        means.append(float(residual[inside].abs().mean()))
        assert residual[inside].abs().max() < 0.02
    assert means[2] < 1e-4
    assert means[0] / means[1] > 3 and means[1] / means[2] > 3  # second order: 4


@pytest.mark.parametrize("turn", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)])
def test_wrong_normals_on_a_sphere_cost(turn) -> None:
    disparity, normal, camera, mask = sphere(128)
    right = consistency_loss(disparity, normal, camera, mask)
    wrong = unit(normal + 0.2 * torch.tensor(turn, dtype=torch.float64)[:, None, None])
    assert right < 1e-4
    assert consistency_loss(disparity, wrong, camera, mask) > 0.05
    concave = normal * torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64)[:, None, None]
    assert consistency_loss(disparity, concave, camera, mask) > 0.05


@pytest.fixture(scope="module")
def rendered() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Disparity, normals, camera, mask and rocks of a simulated view of 256 x 256 px."""
    scene = build_scene(SceneConfig(size=10.0, horizon=20.0, rocks=RockConfig(k=0.1)), np.random.default_rng(5))
    rig = NATECAM.resized(256, 256)
    height = float(scene.terrain.height_at(np.array(-3.0), np.array(0.0)))
    renderer = EmbreeRenderer(scene)
    try:
        view = renderer.render(rig.camera, look_pose(np.array([-3.0, 0.0, height + 1.2]), 0.2, np.deg2rad(20)))
    finally:
        renderer.close()
    disparity = torch.from_numpy(rig.depth_to_disparity(view.depth).astype(np.float64))[None, None]
    normal = torch.from_numpy(view.normal.astype(np.float64)).permute(2, 0, 1)[None]
    c = rig.camera
    camera = torch.tensor([[c.fx, c.fy, c.cx, c.cy]], dtype=torch.float64)
    known = torch.from_numpy((view.depth > 0.5) & (view.depth < 15))[None, None]
    rock = torch.from_numpy(view.surface > 0)[None, None]
    return disparity, normal, camera, known & ~disparity_edges(disparity), rock


def test_rendered_ground_truth_is_consistent_within_its_facets(rendered) -> None:
    """What remains is where Sobel's 3 x 3 px reach over an edge between two triangles."""
    disparity, normal, camera, mask, rock = rendered
    residual, usable = consistency_residual(disparity, normal, camera)
    ground = residual[(mask & usable & ~rock).expand_as(residual)].abs()
    assert len(ground) > 20_000
    assert ground.median() < 0.01 and ground.quantile(0.9) < 0.08


@pytest.mark.parametrize("wrong", ["mirrored", "facing", "tilted", "elsewhere"])
def test_wrong_normals_of_a_rendered_view_cost_more(rendered, wrong: str) -> None:
    disparity, normal, camera, mask, _ = rendered
    true = consistency_loss(disparity, normal, camera, mask)
    other = {
        "mirrored": normal * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)[:, None, None],
        "facing": torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)[:, None, None].expand_as(normal),
        "tilted": unit(normal + torch.tensor([0.2, 0.0, 0.0], dtype=torch.float64)[:, None, None]),
        "elsewhere": normal.roll(8, 3),
    }[wrong]
    assert consistency_loss(disparity, other, camera, mask) > 1.8 * true
