"""Shadows and sub-pixel rays compared with those of Embree, which uses no bins."""

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera
from marssim.base.pose import look_pose
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.geometry.mesh import closed_ground_mesh, scene_mesh
from marssim.render.geometry.visibility import Visibility
from marssim.render.renderers.embree_renderer import EmbreeRenderer, MeshTracer
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

CAMERA = PinholeCamera(120, 90, 130.0, 140.0, 57.2, 47.1)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=8.0, horizon=20.0, rocks=RockConfig(k=0.15)), np.random.default_rng(5))


@pytest.fixture(scope="module")
def caster(scene):
    """What casts shadows: the triangles without fine relief."""
    caster = MeshTracer([scene_mesh(scene)])
    yield caster
    caster.close()


@pytest.fixture(scope="module")
def visibility(scene) -> Visibility:
    return Visibility(scene_mesh(scene), scene.look.sun)


def pose_at(scene: Scene, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-3, 3, 2)
    eye = np.array([x, y, float(scene.terrain.height_at(x, y)) + 1.2])
    return look_pose(eye, rng.uniform(0, 6.3), rng.uniform(-0.1, 1.2), rng.uniform(-0.3, 0.3))


def seen(caster: MeshTracer, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rays = CAMERA.rays().reshape(-1, 3)
    hits = caster.trace(rays, pose)
    hit = np.isfinite(hits.depth)
    points = pose[:3, 3] + hits.depth[hit, None].astype(float) * (rays[hit] @ pose[:3, :3].T)
    return points, hits.normal[hit] @ pose[:3, :3].T


def test_pieces_hold_all_faces_within_their_boxes(scene):
    mesh = scene_mesh(scene)
    assert mesh.start[0] == 0 and mesh.start[-1] == len(mesh.faces) == len(mesh.surface)
    assert len(mesh.faces) == len(closed_ground_mesh(scene.terrain).faces) + len(scene.bodies.faces)
    piece = np.repeat(np.arange(len(mesh.low)), np.diff(mesh.start))
    corner = mesh.vertices[mesh.faces]
    assert (corner >= mesh.low[piece][:, None]).all() and (corner <= mesh.high[piece][:, None]).all()
    assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces)


@pytest.mark.parametrize("seed", range(4))
def test_rays_anywhere_meet_what_embree_says(scene, seed):
    pose = pose_at(scene, seed)
    rays = np.ones((20_000, 3))
    rays[:, :2] = np.random.default_rng(seed).normal(0, 0.6, (20_000, 2))  # crowded in the middle, few beyond
    embree = EmbreeRenderer(scene)
    ours, theirs = (
        each.trace(rays, pose, Footprint.from_camera(CAMERA, pose)) for each in (ScanRenderer(scene), embree)
    )
    embree.close()
    assert (ours.surface == theirs.surface).mean() > 0.9999
    both = np.isfinite(ours.depth) & np.isfinite(theirs.depth)
    assert both.sum() > 2000
    assert (np.abs(ours.depth[both] / theirs.depth[both] - 1) < 1e-5).mean() > 0.9995
    assert (np.einsum("ij,ij->i", ours.normal, theirs.normal)[both] > 0.99999).mean() > 0.9995
    assert (np.abs(ours.detail - theirs.detail)[both].max(axis=1) < 1e-3).mean() > 0.999


@pytest.mark.parametrize("seed", range(4))
def test_shadows_are_those_of_embree(scene, caster, visibility, seed):
    points, normals = seen(caster, pose_at(scene, seed))
    sun = scene.look.sun
    expected = normals @ sun > 0
    at = np.flatnonzero(expected)
    expected[at] = caster.free(points[at], normals[at], np.broadcast_to(sun, (len(at), 3)), None)
    lit = visibility.lit(points, normals)
    assert (lit == expected).mean() > 0.9995
    assert not lit[normals @ sun <= 0].any()


def test_ground_a_little_above_or_below_its_triangles_is_lit_as_they_are(scene, caster, visibility):
    """Rays see the smooth ground, which lies up to some centimetres off the triangles that cast shadows."""
    x, y = np.random.default_rng(0).uniform(-3.5, 3.5, (2, 4000))
    _, gx, gy = scene.terrain.gradient_at(x, y)
    up = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    lit = [
        visibility.lit(np.stack([x, y, scene.terrain.height_at(x, y) + step], axis=1), up) for step in (0, 0.01, -0.01)
    ]
    normals = np.stack([-gx, -gy, np.ones_like(gx)], axis=1) / np.sqrt(1 + gx**2 + gy**2)[:, None]
    facing = normals @ scene.look.sun > 0.2
    assert 0.5 < lit[0][facing].mean() < 0.999
    assert min((other == lit[0])[facing].mean() for other in lit[1:]) > 0.95


def test_an_answer_does_not_depend_on_what_is_asked_with_it(scene, caster, visibility):
    points, normals = seen(caster, pose_at(scene, 1))
    some = np.random.default_rng(0).permutation(len(points))[:500]
    assert np.array_equal(visibility.lit(points, normals)[some], visibility.lit(points[some], normals[some]))


def test_few_points_are_no_error(scene, visibility):
    pose = pose_at(scene, 0)
    up = np.array([[0.0, 0.0, 1.0]])
    for count in (0, 1):
        points = np.tile([0, 0, 5.0], (count, 1))
        assert visibility.lit(points, up[:count]).shape == (count,)
        hits = ScanRenderer(scene).trace(np.ones((count, 3)), pose, Footprint.from_camera(CAMERA, pose))
        assert hits.depth.shape == (count,) and hits.detail.shape == (count, 4)
