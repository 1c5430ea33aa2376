"""The pixels that may see a part of the sun only, compared with the shares of all pixels."""

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.render.penumbra import penumbra
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.scene.look import SUN_RADIUS, sun_direction
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

CAMERA = PinholeCamera.centred(320, 240, 2000.0)


@pytest.fixture(scope="module", params=[9.0, 14.0])
def scene(request) -> Scene:
    scene = build_scene(SceneConfig(size=8.0, horizon=20.0, rocks=RockConfig(k=0.2)), np.random.default_rng(5))
    return scene.with_sun(request.param, 100.0)


def shadows(scene: Scene, yaw: float) -> tuple[np.ndarray, ...]:
    """Return the pose of a view, its depths, distances to what casts shadows, shares of the sun and cosines to it."""
    eye = np.array([0.0, 0.0, float(scene.terrain.height_at(0.0, 0.0)) + 1.2])
    pose = look_pose(eye, yaw, 0.45)
    renderer = ScanRenderer(scene)
    view = renderer.render(CAMERA, pose, sunlit=False)
    points = view.world(CAMERA, pose)[view.hit]
    facing = np.maximum(view.normal @ pose[:3, :3].T @ scene.look.sun, 0)
    normals = np.where((view.surface == GROUND)[..., None], [0.0, 0.0, 1.0], view.normal @ pose[:3, :3].T)[view.hit]
    distance, share = np.zeros((2, *view.depth.shape), np.float32)
    distance[view.hit] = renderer.shadow_distance(points, normals)
    share[view.hit] = renderer.sun_share(points, normals)
    return pose, view.depth, distance, share, facing


def test_wide_borders_are_found_and_little_else(scene):
    wide, count, partial, left, before = 0, 0, 0, 0.0, 0.0
    for yaw in (0.3, 2.0, 4.0):
        pose, depth, distance, share, facing = shadows(scene, yaw)
        found = penumbra(CAMERA.rays().reshape(-1, 3), pose, depth, distance, scene.look.sun).reshape(depth.shape)
        centre = (distance == np.inf).astype(float)
        facing[:, :24] = facing[:, -24:] = facing[:24] = facing[-24:] = 0  # the change may lie beyond the image
        soft = (share > 0.05) & (share < 0.95) & (facing > 0.05)
        # of borders some pixels wide: pixels on both sides see a part of the sun too
        middle = soft & np.any([np.roll(soft, 1, axis) & np.roll(soft, -1, axis) for axis in (0, 1)], axis=0)
        wide = wide + np.array([middle.sum(), found[middle].sum()])
        count, partial = count + found[facing > 0].sum(), partial + soft.sum()
        left += (np.abs(np.where(found, share, centre) - share) * facing).sum()
        before += (np.abs(centre - share) * facing).sum()
    assert wide[0] > 20 and wide[1] > 0.9 * wide[0]
    assert count < 6 * partial
    assert left < 0.2 * before


def test_without_shadows_nothing_is_softened(scene):
    pose, depth, distance, *_ = shadows(scene, 0.3)
    everywhere = np.where(depth < np.inf, np.inf, 0).astype(np.float32)
    rays = CAMERA.rays().reshape(-1, 3)
    for light in (everywhere, np.zeros_like(distance), np.full_like(distance, 0.5)):
        assert not penumbra(rays, pose, depth, light, scene.look.sun).any()


def test_borders_narrower_than_a_pixel_are_left_alone(scene):
    pose, depth, distance, *_ = shadows(scene, 0.3)
    near = np.where((distance > 0) & (distance < np.inf), np.minimum(distance, 1e-6), distance)
    assert not penumbra(CAMERA.rays().reshape(-1, 3), pose, depth, near, scene.look.sun).any()


DOWN = PinholeCamera.centred(90, 90, 400.0)
FROM_ABOVE = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 4.0], [0, 0, 0, 1]])  # a pixel is 1 cm of level ground


def border(distance: float, elevation_deg: float, azimuth_deg: float, axis: int) -> np.ndarray:
    """Return which pixels (90,) across the straight border of a shadow are softened.

    It lies between pixels 44 and 45 of the rows (axis 0) or of the columns (axis 1); distance: to what casts it [m].
    """
    elevation, azimuth = np.deg2rad([elevation_deg, azimuth_deg])
    depth, shadow = np.full((90, 90), 4.0, np.float32), np.full((90, 90), np.inf, np.float32)
    shadow.swapaxes(0, axis)[:45] = distance
    found = penumbra(DOWN.rays().reshape(-1, 3), FROM_ABOVE, depth, shadow, sun_direction(elevation, azimuth))
    return found.reshape(90, 90).swapaxes(0, axis)[:, 45]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0])
def test_a_straight_border_on_level_ground_is_as_wide_as_the_suns_disc_makes_it(azimuth_deg, axis):
    """Its half width is that of the disc's shadow across the light, stretched along the light by the low sun."""
    stretch = 1 / np.sin(np.deg2rad(30)) if (azimuth_deg == 0) == (axis == 1) else 1.0
    half = 100 * 10.0 * np.tan(SUN_RADIUS) * stretch  # [px]
    off = np.abs(np.arange(90) - 44.5)
    soft = border(10.0, 30.0, azimuth_deg, axis)
    assert soft[off < half].all() and not soft[off > half + 3.5].any()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("distance", "is_wide"), [(1.4, False), (1.9, True)])
def test_borders_are_softened_from_a_width_of_one_pixel_on(distance, is_wide, axis):
    """Under a sun at zenith they are 0.85 and 1.16 px wide."""
    assert border(distance, 90.0, 0.0, axis).any() == is_wide
