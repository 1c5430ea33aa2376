from dataclasses import fields

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.base.dataset.frame import StereoFrame
from marssim.base.files.json_file import as_json, write_json
from marssim.generation import scene_views
from marssim.generation.config import GenerateConfig
from marssim.render.sensor import Sensor
from marssim.render.view import SceneRenderer, _of_rover, render_view
from marssim.scene.presets import preset
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import build_scene

RIG = NATECAM.resized(96, 96)
SMALL = {"size": 12.0, "horizon": 16.0}


@pytest.fixture(scope="module")
def scene():
    return build_scene(preset("gale", **SMALL), 7)


def assert_same(one: StereoFrame, other: StereoFrame) -> None:
    for field in fields(StereoFrame):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name == "rig":
            assert a == b
        else:
            assert a.dtype == b.dtype and a.tobytes() == b.tobytes(), field.name


def written_by_generate(config: GenerateConfig, monkeypatch) -> StereoFrame:
    """Return the frame that marssim.generate writes for the first view of the first scene."""
    frames: list[StereoFrame] = []
    monkeypatch.setattr(scene_views, "write_sample", lambda folder, frame, meta, raw, replace: frames.append(frame))
    config.out.mkdir()
    write_json(config.out / scene_views.SETTINGS, as_json(config.content()))
    scene_views.generate_scene(config, 0, [0])
    return frames[0]


def test_a_drawn_frame_is_that_of_generate_bit_for_bit(tmp_path, monkeypatch):
    config = GenerateConfig(out=tmp_path / "set", seed=5, renderer="scan", scenes=(preset("gale", **SMALL),), rig=RIG)
    expected = written_by_generate(config, monkeypatch)
    with SceneRenderer(build_scene(config.scenes[0], np.random.default_rng((5, 0))), rig=RIG) as renderer:
        assert_same(renderer.draw(np.random.default_rng((5, 0, 1))), expected)


def test_a_frame_from_a_chosen_place_is_that_of_generate_bit_for_bit(tmp_path, monkeypatch):
    config = GenerateConfig(out=tmp_path / "set", seed=5, renderer="scan", scenes=(preset("gale", **SMALL),), rig=RIG)
    expected = written_by_generate(config, monkeypatch)
    scene = build_scene(config.scenes[0], np.random.default_rng((5, 0)))
    rng = np.random.default_rng((5, 0, 1))
    pose, rng = scene_views.draw_view(config, scene, 0, 0)
    sensor = Sensor.draw(config.sensor, rng)
    with SceneRenderer(scene, rig=RIG) as renderer:
        assert_same(renderer.render_from(pose, sensor, rng), expected)


def test_the_rig_stands_on_the_ground_and_looks_where_it_is_turned(scene):
    frame = render_view(scene, x=1.5, y=-2.0, yaw_deg=90, pitch_deg=30, height=1.3, rig=RIG)
    x, y, z = frame.pose[:3, 3]
    assert (x, y) == (1.5, -2.0)
    assert z - float(scene.terrain.height_at(x, y)) == pytest.approx(1.3)
    assert frame.pose[:3, 2] == pytest.approx([0.0, np.cos(np.pi / 6), -0.5])
    assert frame.left.shape == (96, 96, 3) and frame.rig == RIG


def test_the_same_seed_gives_the_same_frame_and_another_only_other_noise(scene):
    with SceneRenderer(scene, rig=RIG) as renderer:
        first, again, other = (renderer.render(0.0, 0.0, 45.0, rng=seed) for seed in (1, 1, 2))
    assert_same(first, again)
    assert np.array_equal(first.depth, other.depth) and not np.array_equal(first.left, other.left)


def test_another_sun_changes_the_light_and_leaves_the_place_as_it_is(scene):
    drawn = render_view(scene, 0.0, 0.0, 45.0, rig=RIG)
    low = render_view(scene, 0.0, 0.0, 45.0, sun_elevation_deg=8.0, sun_azimuth_deg=200.0, rig=RIG)
    assert np.array_equal(drawn.depth, low.depth) and np.array_equal(drawn.surface, low.surface)
    assert not np.array_equal(drawn.left, low.left)
    with SceneRenderer(scene.with_sun(8.0, 200.0), rig=RIG) as renderer:
        assert_same(renderer.render(0.0, 0.0, 45.0), low)


def test_one_angle_of_the_sun_may_be_given_alone(scene):
    drawn = np.rad2deg(np.arctan2(*scene.look.sun[1::-1]))
    raised = render_view(scene, 0.0, 0.0, 45.0, sun_elevation_deg=60.0, rig=RIG)
    assert_same(raised, render_view(scene, 0.0, 0.0, 45.0, sun_elevation_deg=60.0, sun_azimuth_deg=drawn, rig=RIG))


def test_the_renderers_render_the_same_view(scene):
    views = [render_view(scene, 0.5, 0.5, 10.0, rig=RIG, renderer=name) for name in ("scan", "embree")]
    assert np.mean(views[0].surface == views[1].surface) > 0.999
    assert np.abs(views[0].left.astype(int) - views[1].left).mean() < 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x": 17.0}, "x=17, y=0 is outside the scene, which reaches 16 m each way"),
        ({"sun_elevation_deg": 0.0}, "sun_elevation_deg must be above 0"),
        ({"sun_elevation_deg": 91.0}, "sun_elevation_deg must be within 0 and 90, got 91"),
        ({"renderer": "scam"}, "renderer 'scam' is unknown"),
    ],
)
def test_what_cannot_be_rendered_is_refused_in_one_line(scene, arguments, message):
    with pytest.raises(ValueError, match=message):
        render_view(**{"scene": scene, "x": 0.0, "y": 0.0, "yaw_deg": 0.0, "rig": RIG, **arguments})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"yaw_deg": np.nan}, "yaw_deg must be finite, got nan"), ({"roll_deg": np.inf}, "roll_deg must be finite"),
        ({"height": -1.0}, "height must be above 0 m and finite, got -1"),
        ({"height": np.nan}, "height must be above 0"),
        ({"rover_pan_deg": np.nan}, "rover_pan_deg must be finite"),
    ],
)  # fmt: skip
def test_what_no_camera_has_is_refused(scene, change, message):
    with SceneRenderer(scene, rig=RIG) as renderer, pytest.raises(ValueError, match=f"^{message}"):
        renderer.render(**{"x": 0.0, "y": 0.0, "yaw_deg": 0.0, **change})


@pytest.mark.parametrize("pose", [np.eye(4) * np.nan, np.eye(4) * 2, np.diag([1.0, 1, -1, 1]), np.eye(3)])
def test_what_is_no_pose_is_refused(scene, pose):
    with SceneRenderer(scene, rig=RIG) as renderer, pytest.raises(ValueError, match=r"^pose must be "):
        renderer.render_from(pose)


def test_a_closed_scene_renderer_says_so(scene):
    renderer = SceneRenderer(scene, rig=RIG)
    renderer.close()
    renderer.close()
    with pytest.raises(RuntimeError, match="closed"):
        renderer.render(0.0, 0.0, 0.0)


def test_a_seed_builds_the_scene_of_its_generator():
    config = preset("utopia", size=4.0, horizon=6.0, rocks=RockConfig(k=0.02))
    one, other = build_scene(config, 3), build_scene(config, np.random.default_rng(3))
    assert np.array_equal(one.terrain.fine.heights, other.terrain.fine.heights)
    assert np.array_equal(one.look.sun, other.look.sun)


def test_the_rovers_draws_are_not_those_of_a_scene_of_the_same_seed():
    """A scene spawns its generators from its seed, as the draws of a frame do."""
    of_scene = [rng.random() for rng in np.random.default_rng(7).spawn(8)]
    frame = np.random.default_rng(7)
    of_rover = [_of_rover(frame).random() for _ in range(8)]
    assert len({*of_scene, *of_rover}) == 16
    assert of_rover[0] == _of_rover(np.random.default_rng(7)).random()


def test_a_frame_keeps_the_pose_that_it_was_rendered_from(scene):
    with SceneRenderer(scene, rig=NATECAM.resized(32, 32)) as renderer:
        pose = renderer.render(0.0, 0.0, 0.0).pose.copy()
        frame = renderer.render_from(pose)
        before = pose.copy()
        pose[0, 3] += 1.0  # the caller goes on with the array
    assert np.array_equal(frame.pose, before)
