"""Shadows, occlusion and sub-pixel rays compared with those of Embree, which uses no bins."""

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera
from marssim.base.pose import look_pose
from marssim.render.geometry.mesh import scene_mesh
from marssim.render.geometry.visibility import Visibility
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

CAMERA = PinholeCamera(120, 90, 130.0, 140.0, 57.2, 47.1)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=8.0, horizon=20.0, rocks=RockConfig(k=0.15)), np.random.default_rng(5))


@pytest.fixture(scope="module")
def caster(scene):
    caster = EmbreeRenderer(scene)
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


def seen(caster: EmbreeRenderer, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    view = caster.render(CAMERA, pose)
    return view.world(CAMERA, pose)[view.hit], view.normal[view.hit] @ pose[:3, :3].T


def test_pieces_hold_all_faces_within_their_boxes(scene):
    mesh = scene_mesh(scene)
    assert mesh.start[0] == 0 and mesh.start[-1] == len(mesh.faces) == len(mesh.surface)
    fine, coarse = scene.terrain.fine.heights.shape, scene.terrain.coarse_cells
    ground = 2 * ((fine[0] - 1) * (fine[1] - 1) + coarse.sum())
    assert len(mesh.faces) == ground + len(scene.bodies.faces)
    piece = np.repeat(np.arange(len(mesh.low)), np.diff(mesh.start))
    corner = mesh.vertices[mesh.faces]
    assert (corner >= mesh.low[piece][:, None]).all() and (corner <= mesh.high[piece][:, None]).all()
    assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces)


@pytest.mark.parametrize("seed", range(4))
def test_rays_anywhere_meet_what_embree_says(scene, caster, visibility, seed):
    pose = pose_at(scene, seed)
    rays = np.ones((20_000, 3))
    rays[:, :2] = np.random.default_rng(seed).normal(0, 0.6, (20_000, 2))  # crowded in the middle, few beyond
    ours, theirs = visibility.trace(rays, pose), caster.trace(rays, pose)
    assert (ours[3] == theirs[3]).mean() > 0.9999
    both = np.isfinite(ours[0]) & np.isfinite(theirs[0])
    assert both.sum() > 2000
    assert (np.abs(ours[0][both] / theirs[0][both] - 1) < 1e-5).mean() > 0.9995
    assert (np.einsum("ij,ij->i", ours[1], theirs[1])[both] > 0.99999).mean() > 0.9995


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


@pytest.mark.parametrize("beside", [0.27, -1.5])
def test_occlusion_is_that_of_embree(scene, caster, visibility, beside):
    hidden = 0
    for seed in range(3):
        pose = pose_at(scene, seed)
        points, normals = seen(caster, pose)
        eye = pose[:3, 3] + beside * pose[:3, 0]
        towards = eye - points
        distance = np.linalg.norm(towards, axis=1)
        expected = np.einsum("ij,ij->i", normals, towards) > 0
        at = np.flatnonzero(expected)
        expected[at] = caster.free(points[at], normals[at], towards[at] / distance[at, None], distance[at])
        answer = visibility.visible_from(points, normals, eye)
        assert (answer == expected).mean() > 0.999
        hidden += (~answer).sum()
    assert hidden > 100, "the views hide nothing: they test too little"


def test_an_eye_amid_the_points_sees_all_round(scene, caster, visibility):
    x, y = np.random.default_rng(0).uniform(-3.5, 3.5, (2, 3000))
    points = np.stack([x, y, scene.terrain.height_at(x, y)], axis=1)
    _, gx, gy = scene.terrain.gradient_at(x, y)
    normals = np.stack([-gx, -gy, np.ones_like(gx)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    eye = np.array([0.0, 0.0, points[:, 2].max() + 0.6])
    towards = eye - points
    distance = np.linalg.norm(towards, axis=1)
    expected = np.einsum("ij,ij->i", normals, towards) > 0
    expected &= caster.free(points, normals, towards / distance[:, None], distance)
    assert (visibility.visible_from(points, normals, eye) == expected).mean() > 0.999


def test_an_answer_does_not_depend_on_what_is_asked_with_it(scene, caster, visibility):
    points, normals = seen(caster, pose_at(scene, 1))
    some = np.random.default_rng(0).permutation(len(points))[:500]
    assert np.array_equal(visibility.lit(points, normals)[some], visibility.lit(points[some], normals[some]))
    eye = points.mean(axis=0) + np.array([0, 0, 1.5])
    whole, part = (visibility.visible_from(p, n, eye) for p, n in ((points, normals), (points[some], normals[some])))
    assert (whole[some] == part).mean() > 0.998  # views of another axis round differently at edges


def test_few_points_are_no_error(visibility):
    up = np.array([[0.0, 0.0, 1.0]])
    for count in (0, 1):
        points = np.tile([0, 0, 5.0], (count, 1))
        assert visibility.lit(points, up[:count]).shape == (count,)
        assert visibility.visible_from(points, up[:count], np.array([0.0, 0.0, 9.0])).tolist() == [True] * count
        assert visibility.trace(np.ones((count, 3)), np.eye(4))[0].shape == (count,)
