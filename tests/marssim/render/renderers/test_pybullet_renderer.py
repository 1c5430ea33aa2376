"""The rasteriser compared with ray casting of the same scene, and with planes whose depth has a closed form."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet")

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.base.pose import look_pose
from marssim.inspection.agreement import BesideCentres, ShiftFit
from marssim.inspection.tilted_planes import plane, plane_shift
from marssim.render.geometry.gbuffer import Footprint, Hits
from marssim.render.geometry.mesh import scene_mesh
from marssim.render.renderers.embree_renderer import EmbreeRenderer, MeshTracer
from marssim.render.renderers.pybullet_renderer import PyBulletRenderer
from marssim.scene.outcrop.config import OutcropConfig
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

LEVEL = PinholeCamera.centred(192, 192, 223.5)
SKEWED = PinholeCamera(200, 150, 180.0, 210.0, 80.3, 91.7)  # principal point off the middle, fx != fy


@pytest.fixture(scope="module")
def scene() -> Scene:
    outcrop = OutcropConfig(slabs=(0.5, 0.5), ledges=(10.0, 10.0), fragments=(1.0, 1.0))
    place = SceneConfig(size=12.0, horizon=24.0, rocks=RockConfig(k=0.1), outcrop=outcrop)
    return build_scene(place, np.random.default_rng(3))


@pytest.fixture(scope="module")
def rasterizer(scene):
    renderer = PyBulletRenderer(scene)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def raycaster(scene):
    renderer = EmbreeRenderer(scene)
    yield renderer
    renderer.close()


def pose_over(scene: Scene, x: float, y: float, yaw: float, pitch_deg: float = 20.0, roll: float = 0.05) -> np.ndarray:
    height = float(scene.terrain.height_at(np.array(x), np.array(y)))
    return look_pose(np.array([x, y, height + 1.2]), yaw, np.deg2rad(pitch_deg), roll)


VIEWS = [(LEVEL, (0.0, 0.0, 0.3)), (LEVEL, (-3.1, 2.2, 4.0)), (SKEWED, (2.0, -4.0, 2.1))]


def within(a: np.ndarray, b: np.ndarray, degrees: float) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b) > np.cos(np.deg2rad(degrees))


@pytest.mark.parametrize(("camera", "place"), VIEWS)
def test_gbuffer_is_that_of_ray_casting(scene, rasterizer, raycaster, camera, place):
    pose = pose_over(scene, *place)
    drawn, shot = rasterizer.render(camera, pose), raycaster.render(camera, pose)
    assert (shot.surface > GROUND).mean() > 0.02, "the view shows no rocks: it tests too little"
    assert (shot.surface > len(scene.rocks)).mean() > 0.02, "the view shows no slabs"
    assert (drawn.surface == shot.surface).mean() > 0.999
    both = drawn.hit & shot.hit
    off = np.abs(drawn.depth[both] / shot.depth[both] - 1)
    assert (off < 5e-3).mean() > 0.999
    assert (off < 1e-5).mean() > 0.998
    assert within(drawn.normal[both], shot.normal[both], 0.1).mean() > 0.998
    assert within(drawn.shading_normal[both], shot.shading_normal[both], 0.1).mean() > 0.998


class Facets:
    """Rays through the triangles that PyBullet draws, without fine relief."""

    def __init__(self, scene: Scene) -> None:
        self._tracer = MeshTracer([scene_mesh(scene)])

    def trace(self, rays: np.ndarray, pose: np.ndarray, footprint: Footprint, sunlit: bool = True) -> Hits:
        return self._tracer.trace(rays, pose)


@pytest.mark.parametrize(("camera", "place"), VIEWS)
def test_pixel_centres_lie_where_the_rays_go(scene, rasterizer, camera, place):
    """The image shift of what PyBullet drew, before its depth is made exact: on smooth ground, and at silhouettes."""
    pose = pose_over(scene, *place)
    raw, surface = rasterizer.drawn(camera, pose)
    beside = BesideCentres(Facets(scene), camera, pose)
    smooth = beside.smooth() & (surface == GROUND)
    assert smooth.sum() > 5000
    ground, silhouette = ShiftFit(), ShiftFit()
    ground.add(1 / raw, beside.inverse_depth, smooth)
    assert np.abs(ground.shift).max() < 0.05
    silhouette.add((surface > GROUND).astype(float), beside.rock, np.ones(raw.shape, dtype=bool))
    silhouette.add((surface == SKY).astype(float), beside.sky, np.ones(raw.shape, dtype=bool))
    assert np.abs(silhouette.shift).max() < 0.05


@pytest.mark.parametrize("azimuths_deg", [(45, 135), (225, 315), (0, 90), (180, 270)])
def test_planes_tilted_in_each_axis_are_not_shifted(azimuths_deg):
    """The drawn depth, before it is made exact, is compared with the closed form."""
    assert np.abs(plane_shift(PyBulletRenderer, SKEWED, azimuths_deg)).max() < 0.05


def test_normals_are_unit_and_face_the_camera(scene, rasterizer):
    view = rasterizer.render(LEVEL, pose_over(scene, 1.0, 1.0, 5.0))
    hit = view.hit
    assert np.allclose(np.linalg.norm(view.normal[hit], axis=1), 1, atol=1e-5)
    assert np.allclose(np.linalg.norm(view.shading_normal[hit], axis=1), 1, atol=1e-5)
    assert (np.einsum("ij,ij->i", view.normal[hit], LEVEL.rays()[hit]) <= 1e-6).mean() > 0.9999
    assert np.isinf(view.depth[~hit]).all() and not view.normal[~hit].any() and not view.shading_normal[~hit].any()
    assert (view.surface[~hit] == SKY).all() and (~hit).any()


def test_a_view_of_the_sky_alone(scene, rasterizer):
    view = rasterizer.render(LEVEL, pose_over(scene, 0.0, 0.0, 0.0, pitch_deg=-60.0))
    assert not view.hit.any()


def test_a_view_does_not_depend_on_those_before_it(scene):
    """A run that continues skips the complete views, and must write the same bytes."""
    poses = [pose_over(scene, *place) for place in ((0.0, 0.0, 0.3), (0.12, 0.05, 0.32), (0, -1, 0.2))]
    through, visible = PyBulletRenderer(scene), []
    for pose in poses:
        visible.append(visible_surfaces(through, pose))
    through.close()
    for pose, expected in zip(poses[1:], visible[1:]):
        alone = PyBulletRenderer(scene)
        for ours, theirs in zip(visible_surfaces(alone, pose), expected):
            assert np.array_equal(ours, theirs)
        alone.close()


def visible_surfaces(renderer: PyBulletRenderer, pose: np.ndarray) -> list[np.ndarray]:
    view = renderer.render(LEVEL, pose)
    points, normals = view.world(LEVEL, pose)[view.hit], view.normal[view.hit] @ pose[:3, :3].T
    hits = renderer.trace(LEVEL.rays().reshape(-1, 3), pose, Footprint.from_camera(LEVEL, pose))
    return [
        view.depth,
        view.normal,
        view.shading_normal,
        view.surface,
        view.detail,
        renderer.lit(points, normals),
        *hits,
    ]


def test_no_points_are_no_error(rasterizer):
    none = np.zeros((0, 3))
    assert rasterizer.lit(none, none).shape == (0,)
    assert rasterizer.trace(none, np.eye(4), Footprint(np.zeros(3), 100.0)).depth.shape == (0,)


def test_a_plane_without_rocks_has_its_closed_form():
    renderer = PyBulletRenderer(plane(np.zeros(2)))
    pose = look_pose(np.array([0.0, 0.0, 1.2]), 0.4, np.deg2rad(30))
    view = renderer.render(SKEWED, pose)
    down = SKEWED.rays() @ pose[:3, :3].T
    hit = view.hit
    assert hit.mean() > 0.5
    assert np.allclose(view.depth[hit], (-1.2 / down[..., 2])[hit], rtol=1e-6)
    assert renderer.lit(view.world(SKEWED, pose)[hit], np.tile([0.0, 0.0, 1.0], (int(hit.sum()), 1))).all()
    renderer.close()


def test_a_renderer_can_be_closed_twice_and_refuses_views_then():
    renderer = PyBulletRenderer(build_scene(SceneConfig(size=4.0, horizon=6.0), np.random.default_rng(0)))
    renderer.close()
    renderer.close()
    with pytest.raises(RuntimeError, match="closed"):
        renderer.render(LEVEL, np.eye(4))


def resident() -> int:
    """[bytes]"""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's /proc")
def test_scenes_one_after_another_take_no_more_memory(scene):
    """The test measures the memory that is held, not the peak, which may be that of an earlier test."""
    held = []
    for _ in range(6):
        renderer = PyBulletRenderer(scene)
        renderer.render(LEVEL, pose_over(scene, 0.0, 0.0, 0.0))
        renderer.lit(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))  # builds every tile
        renderer.close()
        held.append(resident())
    built = len(scene.rocks.vertices) + scene.terrain.fine.heights.size
    assert held[-1] - held[2] < 3 * 150 * built  # kept rows are about 600 bytes a vertex and scene
