"""The measure of agreement finds the shift of a renderer that is wrong on purpose."""

import json

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera
from marssim.base.pose import look_pose
from marssim.inspection.agreement import Agreement, ShiftFit, agreements
from marssim.inspection.tilted_planes import plane, plane_shift
from marssim.render.geometry.gbuffer import Footprint, GBuffer
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

CAMERA = PinholeCamera(144, 128, 160.0, 175.0, 60.3, 71.7)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.15)), np.random.default_rng(5))


class SingleRays(EmbreeRenderer):
    """A renderer whose images are of single rays: those of an image begin later, and miss a few crests."""

    def render(self, camera, pose, footprint=None, sunlit=True):
        rays, footprint = camera.rays().reshape(-1, 3), footprint or Footprint.from_camera(camera, pose)
        return GBuffer.of_hits(self.trace(rays, pose, footprint, sunlit), (camera.height, camera.width))


@pytest.fixture(scope="module")
def tracer(scene):
    renderer = SingleRays(scene)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def poses(scene) -> list[np.ndarray]:
    places = [(-2.0, -1.0, 0.5, 10), (1.0, 0.5, 2.0, 25), (0.0, 2.0, 4.0, 35)]
    heights = [float(scene.terrain.height_at(np.array(x), np.array(y))) + 1.2 for x, y, _, _ in places]
    return [
        look_pose(np.array([x, y, z]), yaw, np.deg2rad(pitch), 0.1) for (x, y, yaw, pitch), z in zip(places, heights)
    ]


def agreement(renderer, tracer, camera, poses) -> Agreement:
    return agreements({"it": renderer}, tracer, camera, poses)["it"]


class OffCentre:
    """A renderer that samples (du, dv) [px] beside the pixel centres, and scales depth by a factor."""

    def __init__(self, tracer: EmbreeRenderer, du: float = 0.0, dv: float = 0.0, factor: float = 1.0) -> None:
        self.tracer, self.du, self.dv, self.factor = tracer, du, dv, factor

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        rays = camera.rays() + np.array([self.du / camera.fx, self.dv / camera.fy, 0])
        hits = self.tracer.trace(rays.reshape(-1, 3), pose, Footprint.from_camera(camera, pose), sunlit=False)
        return GBuffer.of_hits(hits._replace(depth=hits.depth * self.factor), (camera.height, camera.width))


def test_a_renderer_agrees_with_itself(tracer, poses):
    result = agreement(tracer, tracer, CAMERA, poses)
    assert (result.views, result.surface, result.depth) == (3, 1.0, 1.0) and result.good
    assert np.abs([result.smooth, result.silhouette]).max() < 1e-5


@pytest.mark.parametrize(("du", "dv"), [(0.1, 0.0), (0.0, 0.1), (-0.3, 0.2), (0.06, -0.06)])
def test_a_shift_is_found_by_planes_and_by_silhouettes(tracer, poses, du, dv):
    result = agreement(OffCentre(tracer, du, dv), tracer, CAMERA, poses)
    assert result.smooth == pytest.approx([du, dv], abs=0.02)
    # rocks of a few pixels bend the indicator, the more the larger the shift; up to 0.1 px it is exact enough
    assert result.silhouette == pytest.approx([du, dv], abs=0.02 + 0.25 * np.hypot(du, dv))
    assert not result.good


def test_half_a_pixel_hides_in_the_depths_but_not_in_the_shift(tracer, poses):
    result = agreement(OffCentre(tracer, 0.5), tracer, CAMERA, poses)
    assert result.surface > 0.95 and result.smooth[0] == pytest.approx(0.5, abs=0.05) and not result.good


def test_wrong_depth_is_found(tracer, poses):
    assert agreement(OffCentre(tracer, factor=1.004), tracer, CAMERA, poses).depth == 1
    assert agreement(OffCentre(tracer, factor=1.006), tracer, CAMERA, poses).depth == 0


def test_an_undetermined_shift_is_no_agreement():
    fit = ShiftFit()
    fit.add(np.ones((4, 4)), lambda du, dv: np.ones((4, 4)), np.ones((4, 4), bool))
    assert np.isnan(fit.shift).all()
    result = Agreement(1, 1.0, 1.0, fit.shift, np.zeros(2))
    assert not result.good
    assert json.loads(json.dumps(result.report(), allow_nan=False))["smooth_px"] == [None, None]


def test_the_view_that_agrees_least_counts(tracer, poses):
    class OnceWrong(OffCentre):
        def render(self, camera, pose):
            self.factor = 1.01 if pose is poses[1] else 1.0
            return super().render(camera, pose)

    result = agreement(OnceWrong(tracer), tracer, CAMERA, poses)
    assert result.depth == 0.0 and result.surface == 1.0 and not result.good


def test_on_planes_a_drawn_picture_is_compared_before_it_is_corrected():
    """An exact G-buffer would hide that the drawn picture is shifted."""

    class DrawnBeside(EmbreeRenderer):
        def drawn(self, camera, pose):
            view = OffCentre(self, 0.06, -0.03).render(camera, pose)
            return view.depth.astype(float), view.surface

    assert plane_shift(DrawnBeside, CAMERA) == pytest.approx([0.06, -0.03], abs=1e-3)


def test_shifts_are_found_on_tilted_planes():
    assert np.abs(plane_shift(EmbreeRenderer, CAMERA)).max() < 1e-4

    class Off(EmbreeRenderer):
        def render(self, camera, pose):
            return OffCentre(self, 0.06, -0.03).render(camera, pose)

    assert plane_shift(Off, CAMERA) == pytest.approx([0.06, -0.03], abs=1e-3)
    assert np.isnan(plane_shift(EmbreeRenderer, CAMERA, azimuths_deg=(0.0,))).all()  # level across u


def test_a_plane_is_the_one_that_is_asked_for():
    terrain, at = plane(np.array([0.2, -0.1])).terrain, np.array([[-3.0, 2.0], [0.3, 0.1], [7.0, -9.0]])
    assert terrain.height_at(*at.T) == pytest.approx(at @ [0.2, -0.1], abs=1e-9)
