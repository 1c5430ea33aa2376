"""Scan conversion compared with Embree's rays, near the ground and far from it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND
from marssim.base.pose import look_pose
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.geometry.mesh import ground_mesh, scene_mesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.raster import first_faces, matching_faces
from marssim.render.geometry.scan import nearest_faces
from marssim.render.renderers.embree_renderer import EmbreeRenderer, MeshTracer
from marssim.render.renderers.scan_renderer import ScanRenderer
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

CAMERA = PinholeCamera(140, 100, 150.0, 135.0, 61.2, 53.7)  # principal point off the middle, fx != fy


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=8.0, horizon=20.0, rocks=RockConfig(k=0.2)), np.random.default_rng(5))


@pytest.fixture(scope="module")
def scanner(scene) -> ScanRenderer:
    return ScanRenderer(scene)


@pytest.fixture(scope="module")
def caster(scene):
    caster = EmbreeRenderer(scene)
    yield caster
    caster.close()


def pose_at(scene, x, y, above, yaw, pitch, roll) -> np.ndarray:
    return look_pose(np.array([x, y, float(scene.terrain.height_at(x, y)) + above]), yaw, pitch, roll)


@settings(max_examples=25)
@given(
    place=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    above=st.sampled_from([0.35, 1.2, 1.2, 6.0]),  # low down triangles reach behind the eye
    yaw=st.floats(0, 6.28),
    pitch=st.floats(-0.3, 1.55),
    roll=st.floats(-0.6, 0.6),
)
def test_scanning_agrees_with_embree(scene, scanner, caster, place, above, yaw, pitch, roll):
    pose = pose_at(scene, *place, above, yaw, pitch, roll)
    scanned, shot = scanner.render(CAMERA, pose), caster.render(CAMERA, pose)
    # Embree works in float32: at silhouettes a ray may pass on the other side
    assert (scanned.surface == shot.surface).mean() > 0.999
    both = scanned.hit & shot.hit
    if not both.any():
        return
    off = np.abs(scanned.depth[both] / shot.depth[both] - 1)
    assert (off < 1e-5).mean() > 0.998 and np.median(off) < 1e-6
    turn = np.einsum("ij,ij->i", scanned.normal[both], shot.normal[both])
    assert (turn > 0.99999).mean() > 0.998


def test_scanning_agrees_with_rays_between_the_pixels(scene, scanner):
    """The same rays are cast as scattered points, which are sorted into bins."""
    mesh = scene_mesh(scene)
    rays = CAMERA.rays().reshape(-1, 3)
    x, y = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
    for n, above in enumerate((0.4, 1.2, 3.0)):
        pose = pose_at(scene, n - 1.0, 0.5, above, 2.0 * n, 0.25 * n, 0.1)
        face = first_faces(mesh, CAMERA, pose)
        assert (face >= 0).mean() > 0.4
        assert (face == nearest_faces(mesh, Projection.of_eye(pose), x, y)).mean() > 0.9999


def test_a_part_of_the_image_is_that_part_of_the_whole(scene, scanner):
    pose = pose_at(scene, 1.0, -1.0, 1.2, 0.7, 0.3, -0.1)
    footprint = Footprint.from_camera(CAMERA, pose)
    whole, part = (
        scanner.render(camera, pose, footprint) for camera in (CAMERA, CAMERA.cropped(30, 20, 64, 48))
    )  # fmt: skip
    assert np.array_equal(part.surface, whole.surface[20:68, 30:94])
    assert np.allclose(part.depth, whole.depth[20:68, 30:94], rtol=1e-6)


def test_matching_finds_the_face_of_the_surface_that_is_asked_for(scene):
    """Also if another surface hides it."""
    mesh = scene_mesh(scene)
    pose = pose_at(scene, 0.0, 0.0, 1.2, 1.0, 0.4, 0.0)
    first = first_faces(mesh, CAMERA, pose)
    shape = (CAMERA.height, CAMERA.width)
    surface = np.where(first >= 0, mesh.surface[first], -1).reshape(shape)
    tracer = MeshTracer([mesh])
    depth = tracer.trace(CAMERA.rays().reshape(-1, 3), pose).depth.reshape(shape)
    tracer.close()
    at = first >= 0
    assert (
        matching_faces(mesh, mesh.surface, CAMERA, pose, depth, surface.astype(np.int32))[at] == first[at]
    ).mean() > 0.9999
    behind = matching_faces(mesh, mesh.surface, CAMERA, pose, depth, np.full(shape, GROUND, dtype=np.int32))
    rock = surface.ravel() > GROUND
    assert (mesh.surface[behind[behind >= 0]] == GROUND).all()
    ground = MeshTracer([ground_mesh(scene.terrain)])
    bare = ground.trace(CAMERA.rays().reshape(-1, 3), pose).depth
    ground.close()
    in_front = rock & np.isfinite(bare)  # the others stand before the sky
    assert in_front.mean() > 0.05 and (behind[in_front] >= 0).mean() > 0.999
    seen = rock & (behind >= 0)
    corners = mesh.vertices[mesh.faces[behind[seen]]]
    rays = CAMERA.rays().reshape(-1, 3)[seen] @ pose[:3, :3].T
    ground = pose[:3, 3] + bare[seen, None] * rays
    assert (ground[:, None, :2] >= corners[..., :2].min(axis=1, keepdims=True) - 1e-3).all(axis=(1, 2)).mean() > 0.98
    assert (ground[:, None, :2] <= corners[..., :2].max(axis=1, keepdims=True) + 1e-3).all(axis=(1, 2)).mean() > 0.98


def test_rays_and_points_that_no_query_can_take_are_named(scene, scanner):
    pose = pose_at(scene, 0.0, 0.0, 1.2, 0.0, 0.3, 0.0)
    footprint = Footprint.from_camera(PinholeCamera.centred(8, 8, 8.0), pose)
    for rays in (np.full((10, 3), np.nan), np.ones((4, 2))):
        with pytest.raises(ValueError, match=r"^rays must be finite numbers of shape"):
            scanner.trace(rays, pose, footprint)
    with pytest.raises(ValueError, match=r"^pose must be"):
        scanner.trace(np.ones((4, 3)), np.full((4, 4), np.nan), footprint)
    for begin in (np.zeros(3), np.full(4, np.nan)):
        for trace in (
            scanner.trace_ground,
            lambda rays, pose, begin, seen: scanner.trace(rays, pose, seen, begin=begin),
        ):
            with pytest.raises(ValueError, match=r"^begin must be one number for each of 4 rays"):
                trace(np.ones((4, 3)), pose, begin, footprint)
    up = [[0.0, 0.0, 1.0]]
    assert scanner.lit([[0.0, 0.0, 50.0]], up).shape == (1,)
    for query in (scanner.lit, scanner.shadow_distance, scanner.sun_share):
        with pytest.raises(ValueError, match=r"^points must be finite numbers"):
            query(np.full((10, 3), np.nan), np.tile(up, (10, 1)))
        with pytest.raises(ValueError, match=r"^points and normals must both have shape"):
            query(np.zeros((10, 3)), np.array([[0.0, 0.0, 1.0]]))
