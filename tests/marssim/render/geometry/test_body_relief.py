"""The relief on the faces of rocks, compared with the faces themselves."""

from dataclasses import replace

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.render.geometry.gbuffer import GBuffer
from marssim.render.geometry.mesh import body_mesh
from marssim.render.renderers.embree_renderer import MeshTracer
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

CAMERA = PinholeCamera.centred(128, 96, 150.0)
SCENE = build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.2)), np.random.default_rng(5))
POSE = look_pose(np.array([0.0, 0.0, float(SCENE.terrain.height_at(0.0, 0.0)) + 1.2]), 0.6, 0.35, 0.1)


@pytest.fixture(scope="module")
def faces():
    tracer = MeshTracer([body_mesh(SCENE)])
    yield tracer.trace(CAMERA.rays().reshape(-1, 3), POSE)
    tracer.close()


def seen(strength: float) -> GBuffer:
    scene = replace(SCENE, look=replace(SCENE.look, texture_strength=strength, bedding=0.5))
    return ScanRenderer(scene).render(CAMERA, POSE)


def test_rocks_without_relief_are_their_faces(faces):
    view = seen(0.0)
    rock = view.surface.ravel() > GROUND
    assert rock.sum() > 500
    assert np.allclose(view.depth.ravel()[rock], faces.depth[rock], rtol=1e-4)
    assert np.allclose(view.normal.reshape(-1, 3)[rock], faces.normal[rock], atol=1e-3)


def test_relief_moves_hits_by_millimetres_and_grows_with_its_strength(faces):
    moved = []
    for strength in (0.5, 1.0, 2.0):
        view = seen(strength)
        rock = view.surface.ravel() > GROUND
        same = rock & (view.surface.ravel() == faces.surface)
        moved.append(np.abs(view.depth.ravel()[same] - faces.depth[same]).mean())
        assert np.abs(np.linalg.norm(view.normal[view.surface > GROUND], axis=-1) - 1).max() < 1e-5
        assert (np.sum(view.normal * CAMERA.rays(), axis=-1)[view.surface > GROUND] < 0).all()
    assert 2e-4 < moved[0] < moved[1] < moved[2] < 0.03
    assert moved[2] == pytest.approx(4 * moved[0], rel=0.3)


def test_what_is_seen_of_relief_is_not_shaded_as_a_side_that_looks_away():
    """Such pixels, turned away from the camera and often from the sun, were black specks along edges and beds."""
    bare, rough = seen(0.0), seen(2.0)
    rays = CAMERA.rays() @ POSE[:3, :3].T
    towards = [np.sum(view.shading_normal * rays, axis=-1) < 0 for view in (bare, rough)]
    rock = (rough.surface > GROUND) & (rough.surface == bare.surface)
    assert (rock & towards[0]).sum() > 500
    assert towards[1][rock & towards[0]].all()
