"""The rover in view, compared with closed forms and between renderers."""

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.base.dataset.frame import GROUND, ROVER, SKY
from marssim.base.pose import look_pose
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.own_rover.body import DECK_TOP, FRONT_WING, SPEC, WING_HEIGHT, RoverBody
from marssim.render.own_rover.renderer import WithRover
from marssim.render.renderers.by_name import RENDERERS, make_renderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.own_rover import rover_below
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene

RIG = NATECAM.resized(200, 200)
SENSOR = Sensor(exposure=0.5, psf=0.0, full_well=1e12, read_noise=0.0, vignetting=0.0)
YAW = 0.7


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = build_scene(SceneConfig(size=10.0, horizon=20.0, rocks=RockConfig(k=0.1)), np.random.default_rng(11))
    return scene.with_sun(40.0, float(np.rad2deg(YAW)) + 180.0)  # behind the cameras


@pytest.fixture(scope="module")
def pose(scene) -> np.ndarray:
    height = float(scene.terrain.height_at(np.array(0.0), np.array(0.0)))
    return look_pose(np.array([0.0, 0.0, height + 1.2]), YAW, np.deg2rad(20), 0.03)


def taken(scene, pose, pan_deg, name="scan"):
    renderer = make_renderer(name, scene)
    rover = None if pan_deg is None else rover_below(scene, pose, RIG.baseline, np.deg2rad(pan_deg))
    frame = render_stereo(renderer, Shader(scene), RIG, pose, SENSOR, np.random.default_rng(0), rover)
    renderer.close()
    return frame


@pytest.mark.parametrize("eye", ["left", "right"])
@pytest.mark.parametrize(("pan_deg", "height", "low", "high"), [
    (180, DECK_TOP, (-0.54, -0.39), (0.54, 0.39)), (-110, WING_HEIGHT, (-0.25, -1.40), (0.35, -0.50)),
])  # fmt: skip
def test_the_planes_of_deck_and_wings_have_their_depth_and_normal(scene, pose, eye, pan_deg, height, low, high):
    body = rover_below(scene, pose, RIG.baseline, np.deg2rad(pan_deg))
    renderer = make_renderer("scan", scene)
    camera_pose = pose if eye == "left" else RIG.right_pose(pose)
    rover = WithRover(renderer, RoverBody(body, pose, RIG.baseline), scene.look.sun)
    view = rover.render(RIG.camera, camera_pose, Footprint.from_camera(RIG.camera, pose))
    to_body = np.linalg.inv(body) @ camera_pose
    rays = RIG.camera.rays() @ to_body[:3, :3].T
    depth = (height - to_body[2, 3]) / rays[..., 2]
    place = to_body[:3, 3] + depth[..., None] * rays
    inside = (depth > 0) & (place[..., :2] > low).all(axis=-1) & (place[..., :2] < high).all(axis=-1)
    assert inside.sum() > 1000
    assert (view.surface[inside] == ROVER).all()
    assert (view.depth[inside] < depth[inside] * (1 + 1e-6)).all()  # something may stand on the plane
    bare = inside & (view.depth > depth * (1 - 1e-6))
    assert bare.sum() > 0.4 * inside.sum()
    up = to_body[:3, :3].T @ [0, 0, 1]
    assert np.allclose(view.normal[bare], up, atol=1e-5)
    renderer.close()


def test_all_renderers_show_the_same_rover(scene, pose):
    pytest.importorskip("pybullet")
    frames = [taken(scene, pose, -110, name) for name in RENDERERS]
    own = frames[0].surface == ROVER
    assert 0.1 < own.mean() < 0.6
    for frame in frames[1:]:
        assert np.array_equal(frame.surface == ROVER, own)
        for field in ("depth", "normal", "disparity"):
            assert np.array_equal(getattr(frame, field)[own], getattr(frames[0], field)[own])
        assert (frame.occluded != frames[0].occluded).mean() < 1e-3
        assert np.abs(frame.left[own].astype(int) - frames[0].left[own]).mean() < 0.5


def test_disparity_and_occlusion_know_the_rover(scene, pose):
    frame, without = taken(scene, pose, -110), taken(scene, pose, None)
    own = frame.surface == ROVER
    assert frame.disparity[own] == pytest.approx(RIG.fb / frame.depth[own], rel=1e-5)
    # by its definition: the right camera sees something nearer along the ray to the point
    renderer = make_renderer("embree", scene)
    body = RoverBody(rover_below(scene, pose, RIG.baseline, np.deg2rad(-110)), pose, RIG.baseline)
    both, right = WithRover(renderer, body, scene.look.sun), RIG.right_pose(pose)
    rays = RIG.camera.rays().reshape(-1, 3) - np.array([RIG.baseline, 0, 0]) / frame.depth.reshape(-1, 1)
    visible = frame.surface.ravel() != SKY
    seen = both.trace(rays[visible], right, Footprint.from_camera(RIG.camera, pose), sunlit=False).depth
    renderer.close()
    columns = np.arange(RIG.camera.width) - frame.disparity
    expected = np.zeros(own.shape, bool)
    expected[frame.surface != SKY] = seen < frame.depth[frame.surface != SKY] * 0.998
    expected |= (columns < 0) & (frame.surface != SKY)
    assert (frame.occluded != expected).mean() < 0.01
    hidden_ground = frame.occluded & ~without.occluded & (frame.surface == GROUND)
    assert hidden_ground.sum() > 20


def test_the_shadow_lies_on_ground_and_rocks_where_only_it_is_in_view(scene, pose):
    frame, without = taken(scene, pose, 0), taken(scene, pose, None)
    assert not (frame.surface == ROVER).any()
    for field in ("depth", "normal", "surface", "occluded"):
        assert np.array_equal(getattr(frame, field), getattr(without, field))
    # closed form: the sun's rays through the middle of the camera bar end here
    sun = scene.look.sun
    bar = (pose @ [RIG.baseline / 2, 0, -0.07, 1])[:3]
    depth = np.where(frame.surface == SKY, 1000.0, frame.depth)
    points = pose[:3, 3] + (RIG.camera.rays() * depth[..., None]) @ pose[:3, :3].T
    away = np.linalg.norm(np.cross(points - bar, sun), axis=-1)
    within = (away < 0.03) & (frame.surface != SKY)
    renderer = make_renderer("scan", scene)
    lit = renderer.lit(points[within], np.tile([0.0, 0.0, 1.0], (within.sum(), 1)))
    renderer.close()
    assert lit.sum() > 10
    ratio = frame.left[within][lit].astype(float) / without.left[within][lit]
    assert np.median(ratio) < 0.8
    far = frame.depth > 6
    assert np.abs(frame.left[far].astype(int) - without.left[far]).mean() < 3  # but for the exposure


def test_a_shadow_on_the_deck_is_the_mast_s(scene, pose):
    """With the sun in front of a camera that looks back, the mast and its bar shade the deck."""
    low = scene.with_sun(50.0, float(np.rad2deg(YAW)) + 180.0)
    body = RoverBody(rover_below(low, pose, RIG.baseline, np.pi), pose, RIG.baseline)
    renderer = WithRover(make_renderer("scan", low), body, low.look.sun)
    x, y = np.random.default_rng(0).uniform((-0.2, -0.35), (0.5, 0.35), (400, 2)).T
    points = np.column_stack([x, y, np.full(400, DECK_TOP)]) @ body.pose[:3, :3].T + body.pose[:3, 3]
    up = np.tile(body.pose[:3, 2], (400, 1))
    lit = renderer.lit(points, up)
    towards = low.look.sun @ body.pose[:3, :3]
    assert 0.02 < (~lit).mean() < 0.6
    assert np.array_equal(lit, renderer.shadow_distance(points, up) == np.inf)
    bar = np.array([SPEC.mount.x, 0.0, SPEC.mount.height])
    length = (bar[2] - DECK_TOP) / towards[2]
    middle = bar - length * towards
    near = np.hypot(x - middle[0], y - middle[1]) < 0.06
    assert near.sum() > 2 and not lit[near].all()


def test_wings_span_three_metres(scene, pose):
    body = RoverBody(np.eye(4), look_pose(np.array([0.65, 0.1, 1.2]), 0.0, 0.3), RIG.baseline)
    low, high = body.mesh.vertices.min(axis=0), body.mesh.vertices.max(axis=0)
    assert high[1] - low[1] == pytest.approx(3.0) == 2 * FRONT_WING[:, 1].max()
    assert 2.3 < high[0] - low[0] < 2.8
    assert low[2] == pytest.approx(0.0, abs=0.01)
