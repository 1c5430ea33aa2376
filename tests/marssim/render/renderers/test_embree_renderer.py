"""Embree's rays and scan conversion, compared with closed forms (plane, sphere) and brute-force ray casting."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.base.pose import look_pose
from marssim.inspection.tilted_planes import BARE
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.geometry.mesh import Mesh, closed_ground_mesh, scene_mesh
from marssim.render.geometry.visibility import SELF_GAP
from marssim.render.renderers.by_name import make_renderer
from marssim.render.renderers.embree_renderer import MeshTracer
from marssim.render.renderers.renderer import Renderer
from marssim.scene.look import draw_look
from marssim.scene.rocks.population import RockConfig
from marssim.scene.rocks.shapes import icosphere
from marssim.scene.scene import Scene, SceneConfig, build_scene
from marssim.scene.terrain import HeightGrid, Terrain

CAMERA = PinholeCamera(96, 80, 110.0, 125.0, 40.3, 44.7)  # principal point off the middle, fx != fy
SPHERE = icosphere(6)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.15)), np.random.default_rng(5))


@pytest.fixture(scope="module", params=["embree", "scan"])
def raycaster(request, scene):
    renderer = make_renderer(request.param, scene)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def facets(scene):
    """The triangles of the scene, without fine relief."""
    tracer = MeshTracer([scene_mesh(scene)])
    yield tracer
    tracer.close()


@pytest.fixture(scope="module")
def pose(scene):
    height = float(scene.terrain.height_at(np.array(-2.0), np.array(-1.0)))
    return look_pose(np.array([-2.0, -1.0, height + 1.2]), 0.5, np.deg2rad(20), 0.05)


@pytest.fixture(scope="module")
def bare() -> Scene:
    config = SceneConfig(size=4.0, horizon=12.0, cell=0.25, rocks=RockConfig(k=0.0), look=BARE)
    return build_scene(config, np.random.default_rng(0))


def plane_terrain(slope_x: float, slope_y: float) -> Terrain:
    def grid(half: float, cell: float) -> HeightGrid:
        axis = np.linspace(-half, half, round(2 * half / cell) + 1)
        return HeightGrid(slope_x * axis[None, :] + slope_y * axis[:, None], -half, -half, cell)

    return Terrain(grid(2.0, 0.25), grid(20.0, 1.0))


def nearest_hit(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> float:
    """Smallest t > 0 at which origin + t direction meets a triangle of corners (F, 3, 3): Moeller and Trumbore."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(direction, second)
    determinant = (first * across).sum(axis=1)
    inverse = 1 / np.where(determinant == 0, np.nan, determinant)
    offset = origin - corners[:, 0]
    u = (offset * across).sum(axis=1) * inverse
    over = np.cross(offset, first)
    v = over @ direction * inverse
    t = (second * over).sum(axis=1) * inverse
    meets = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9)
    return float(t[meets].min(initial=np.inf))


@pytest.fixture(scope="module")
def corners(scene) -> np.ndarray:
    ground, bodies = closed_ground_mesh(scene.terrain), scene.bodies
    return np.concatenate([mesh.vertices[mesh.faces] for mesh in (ground, bodies)])


@pytest.mark.parametrize("name", ["embree", "scan"])
@settings(max_examples=20)
@given(
    slope=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    yaw=st.floats(0, 6.28),
    pitch=st.floats(-0.2, 1.5),
    roll=st.floats(-0.5, 0.5),
)
def test_a_tilted_plane_has_its_closed_form(bare, name, slope, yaw, pitch, roll):
    renderer = make_renderer(name, replace(bare, terrain=plane_terrain(*slope)))
    eye = np.array([0.3, -0.2, 0.3 * slope[0] - 0.2 * slope[1] + 1.2])
    pose = look_pose(eye, yaw, pitch, roll)
    view = renderer.render(CAMERA, pose)
    up = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    rays = CAMERA.rays() @ pose[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -(eye @ up) / (rays @ up)
        place = np.abs(eye + depth[..., None] * rays)[..., :2].max(axis=-1)
    within_reach = (depth > 0) & (place < 12)  # about the edge at 20 m the smooth surface is no plane
    nothing = ~(depth > 0) | (place > 22)
    assert (view.surface[within_reach] == GROUND).all()
    assert np.allclose(view.depth[within_reach], depth[within_reach], rtol=1e-4)
    assert np.allclose(view.normal[within_reach], pose[:3, :3].T @ up, atol=3e-4)
    assert np.allclose(view.shading_normal[within_reach], up, atol=3e-4)
    assert (view.surface[nothing] == SKY).all() and np.isinf(view.depth[nothing]).all()


def sphere_caster(centre: np.ndarray, radius: float) -> MeshTracer:
    direction, faces = SPHERE
    return MeshTracer(
        [Mesh(centre + radius * direction, faces, np.full(len(faces), 7, np.int32), direction.astype(np.float32))]
    )


@pytest.mark.parametrize("distance", [3.0, 0.4])  # from outside, and from within the sphere
def test_a_sphere_has_its_closed_form(distance):
    pose = look_pose(np.array([0.5, 0.2, 1.0]), 2.0, 0.3, 0.1)
    centre, radius = pose[:3, 3] + distance * pose[:3, 2], 1.0
    rays = CAMERA.rays().reshape(-1, 3)
    depth, normal, shading, surface, _ = sphere_caster(centre, radius).trace(rays, pose)
    # |t r - (0, 0, distance)| = radius in the camera frame
    a, b, c = (rays**2).sum(axis=1), -2 * distance * rays[:, 2], distance**2 - radius**2
    root = b * b - 4 * a * c
    side = -1 if distance > radius else 1
    expected = (-b + side * np.sqrt(np.maximum(root, 0))) / (2 * a)
    outward = (rays * expected[:, None] - [0, 0, distance]) / radius * -side
    facing = -np.einsum("ij,ij->i", outward, rays / np.sqrt(a)[:, None])
    clear = (root > 0) & (facing > 0.35)  # a faceted silhouette is not that of the sphere
    assert clear.sum() > 1000
    assert (surface[clear] == 7).all() and (surface[root < -0.01] == SKY).all()
    assert np.allclose(depth[clear], expected[clear], rtol=1e-4)
    direction, faces = SPHERE
    facet = np.cross(direction[faces[:, 1]] - direction[faces[:, 0]], direction[faces[:, 2]] - direction[faces[:, 0]])
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    steepest = np.einsum("fi,fvi->fv", facet, direction[faces]).min()  # cos of a facet's normal to its corners'
    assert np.einsum("ij,ij->i", normal[clear], outward[clear]).min() > steepest - 1e-5
    inward = 1 if distance > radius else -1  # vertex normals point out of the sphere and are not turned
    assert np.allclose(shading[clear] @ pose[:3, :3] * inward, outward[clear], atol=2e-3)


def test_normals_are_unit_and_face_the_camera(raycaster, pose):
    view = raycaster.render(CAMERA, pose)
    hit = view.hit
    assert 0.3 < hit.mean() < 1
    assert np.allclose(np.linalg.norm(view.normal[hit], axis=1), 1, atol=1e-5)
    assert np.allclose(np.linalg.norm(view.shading_normal[hit], axis=1), 1, atol=1e-5)
    slant = np.einsum("ij,ij->i", view.normal[hit], CAMERA.rays()[hit])
    assert (slant[view.surface[hit] > GROUND] <= 1e-6).all()
    assert slant.max() < 0.05 and (slant <= 1e-6).mean() > 0.999  # on ground, a ray may end a little behind a crest
    assert np.isinf(view.depth[~hit]).all() and not view.normal[~hit].any() and not view.shading_normal[~hit].any()


def test_a_view_of_the_sky_alone(raycaster, pose):
    view = raycaster.render(CAMERA, look_pose(pose[:3, 3], 0.0, np.deg2rad(-70)))
    assert (view.surface == SKY).all() and np.isinf(view.depth).all()


@pytest.mark.parametrize("name", ["embree", "scan"])
def test_surface_ids_name_what_stands_there(scene, name, pose):
    plain = replace(scene, look=draw_look(BARE, np.random.default_rng(0)))
    renderer = make_renderer(name, plain)
    view = renderer.render(CAMERA, pose)
    renderer.close()
    points = view.world(CAMERA, pose)
    assert not view.hit.all() and np.array_equal(np.isinf(points).all(axis=-1), ~view.hit)
    ground = points[(view.surface == GROUND) & (view.detail[..., 0] < 0)]  # not on the fragments about rocks
    ground = ground[(np.abs(ground[:, :2]) < 12).all(axis=1)]
    inside = scene.terrain.fine.contains(ground[:, 0], ground[:, 1])
    assert 0.2 < inside.mean() < 1
    for grid, part in ((scene.terrain.fine, ground[inside]), (scene.terrain.coarse, ground[~inside])):
        off = np.abs(part[:, 2] - grid.smooth_heights(part[:, 0], part[:, 1]))
        assert (off < 1e-4).mean() > 0.98 and off.max() < 5e-3
    rock = view.surface > GROUND
    assert len(np.unique(view.surface[rock])) > 10
    for surface in np.unique(view.surface[rock]):
        corner = scene.bodies.vertices[scene.bodies.faces[scene.bodies.face_rock == surface - 1]].reshape(-1, 3)
        visible = points[view.surface == surface]
        assert (visible >= corner.min(axis=0) - 1e-4).all() and (visible <= corner.max(axis=0) + 1e-4).all()


def test_rays_are_those_of_brute_force(facets, pose, corners):
    rays = CAMERA.rays().reshape(-1, 3)[np.random.default_rng(0).choice(96 * 80, 30, replace=False)]
    depth = facets.trace(rays, pose).depth
    expected = [nearest_hit(pose[:3, 3], pose[:3, :3] @ ray, corners) for ray in rays]
    assert np.isinf(expected).any() and np.isfinite(expected).sum() > 15
    assert np.allclose(depth, expected, rtol=1e-5)


@pytest.mark.parametrize("name", ["embree", "scan"])
def test_rocks_are_hit_where_brute_force_says(scene, name, pose):
    """A rock is in front of the ground, or the ground in front of all rocks."""
    corners = scene.bodies.vertices[scene.bodies.faces]
    rays = CAMERA.rays().reshape(-1, 3)
    renderer = make_renderer(name, replace(scene, look=draw_look(BARE, np.random.default_rng(0))))
    hits = renderer.trace(rays, pose, Footprint.from_camera(CAMERA, pose))
    renderer.close()
    rng = np.random.default_rng(0)
    for rock in (True, False):
        for n in rng.choice(np.flatnonzero((hits.surface > GROUND) == rock), 20, replace=False):
            expected = nearest_hit(pose[:3, 3], pose[:3, :3] @ rays[n], corners)
            if rock:
                assert hits.depth[n] == pytest.approx(expected, rel=1e-5)
            else:
                assert hits.depth[n] <= expected * (1 + 1e-5)


def balanced(answer: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the indices of 25 true and 25 false values."""
    return np.concatenate([rng.choice(np.flatnonzero(answer == value), 25, replace=False) for value in (True, False)])


def test_shadows_are_those_of_brute_force(scene, facets, raycaster, pose, corners):
    rays = CAMERA.rays().reshape(-1, 3)
    hits = facets.trace(rays, pose)
    hit = hits.surface != SKY
    points = pose[:3, 3] + hits.depth[hit, None].astype(float) * (rays[hit] @ pose[:3, :3].T)
    normals = hits.normal[hit] @ pose[:3, :3].T
    facing = normals @ scene.look.sun > 0
    lit = raycaster.lit(points, normals)
    assert not lit[~facing].any()
    points, normals, lit = points[facing], normals[facing], lit[facing]
    for n in balanced(lit, np.random.default_rng(0)):
        blocked = np.isfinite(nearest_hit(points[n] + SELF_GAP * normals[n], scene.look.sun, corners))
        assert lit[n] != blocked


def test_what_stands_behind_the_eye_hides_nothing():
    sphere = sphere_caster(np.array([0.0, 0.0, 5.0]), 1.0)
    start, up = np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0]] * 2)
    assert sphere.free(start, up, up, np.array([3.9, 4.1])).tolist() == [True, False]
    assert not sphere.free(start, up, up, None).any()


def test_rays_between_pixels_are_those_of_a_shifted_camera(raycaster, pose):
    shifted = replace(CAMERA, cx=CAMERA.cx - 0.25, cy=CAMERA.cy + 0.5)
    step = np.array([0.25 / CAMERA.fx, -0.5 / CAMERA.fy, 0])
    # what shows is filtered for the same camera
    hits = raycaster.trace(CAMERA.rays().reshape(-1, 3) + step, pose, Footprint.from_camera(CAMERA, pose))
    view = raycaster.render(shifted, pose)
    assert (hits.surface.reshape(view.surface.shape) == view.surface).mean() > 0.999
    assert np.isclose(hits.depth.reshape(view.depth.shape), view.depth, rtol=1e-5).mean() > 0.998


def test_a_view_is_that_of_its_rays(raycaster, pose):
    view = raycaster.render(CAMERA, pose)
    hits = raycaster.trace(CAMERA.rays().reshape(-1, 3), pose, Footprint.from_camera(CAMERA, pose))
    for one, other in zip(view.pixels, hits):
        assert np.isclose(one, other, atol=1e-4).mean() > 0.9995


@pytest.mark.parametrize("name", ["embree", "scan"])
def test_without_the_share_of_sunlight_the_geometry_is_the_same(scene, name, pose):
    camera = PinholeCamera(96, 80, 500.0, 500.0, 40.3, 44.7)
    renderer = make_renderer(name, scene.with_sun(8.0, 200.0))
    lit, dark = (renderer.render(camera, pose, sunlit=sunlit).pixels for sunlit in (True, False))
    renderer.close()
    for name in ("depth", "normal", "shading_normal", "surface"):
        assert np.array_equal(getattr(lit, name), getattr(dark, name))
    assert np.array_equal(lit.detail[:, :3], dark.detail[:, :3])
    assert (dark.detail[:, 3] == 1).all() and 0 < (lit.detail[:, 3] < 1).mean() < 0.5


def test_rays_that_begin_shortly_before_the_ground_meet_it_where_whole_rays_do(raycaster, pose):
    rays, footprint = CAMERA.rays().reshape(-1, 3), Footprint.from_camera(CAMERA, pose)
    whole = raycaster.trace(rays, pose, footprint)
    rays, depth = rays[whole.surface == GROUND], whole.depth[whole.surface == GROUND].astype(float)
    again = raycaster.trace_ground(rays, pose, 0.995 * depth, footprint)
    off = np.abs(again.depth / depth - 1)
    # crests far away are a little uncertain
    assert (again.surface == GROUND).mean() > 0.995 and (off[depth < 15] < 1e-3).mean() > 0.99


def test_an_embree_renderer_answers_queries_without_points(raycaster, pose):
    renderer: Renderer = raycaster
    none = np.zeros((0, 3))
    assert renderer.lit(none, none).shape == (0,)
    assert renderer.trace(none, pose, Footprint.from_camera(CAMERA, pose)).depth.shape == (0,)
    assert renderer.trace_ground(none, pose, np.zeros(0), Footprint.from_camera(CAMERA, pose)).depth.shape == (0,)


@pytest.mark.parametrize("name", ["embree", "scan"])
def test_a_renderer_can_be_closed_twice_and_refuses_views_then(bare, name):
    renderer = make_renderer(name, bare)
    renderer.close()
    renderer.close()
    point = np.array([[0.0, 0.0, 0.0]])
    up = np.array([[0.0, 0.0, 1.0]])
    for use in (
        lambda: renderer.render(CAMERA, np.eye(4)),
        lambda: renderer.lit(point, up),
        lambda: renderer.trace(up, np.eye(4), Footprint.from_camera(CAMERA, np.eye(4))),
        lambda: renderer.trace_ground(up, np.eye(4), np.zeros(1), Footprint.from_camera(CAMERA, np.eye(4))),
    ):
        with pytest.raises(RuntimeError, match="closed"):
            use()
