"""Where the rover stands below its cameras."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from marssim.scene.own_rover import draw_pan, draw_pose_of_rover, rover_below
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene
from marssim.scene.trajectory import MastState
from marssim.scene.viewpoint import ViewConfig, pose_on_ground

SCENE = build_scene(SceneConfig(size=10.0, horizon=20.0, rocks=RockConfig(k=0.05)), np.random.default_rng(1))
ROCKY = build_scene(SceneConfig(size=16.0, horizon=20.0, rocks=RockConfig(k=0.2)), np.random.default_rng(2))


@given(st.floats(-3, 3), st.floats(0, 6.2), st.floats(-0.2, 1.2), st.floats(-3.1, 3.1), st.floats(-0.3, 0.3))
def test_the_cameras_stand_where_its_mast_carries_them(x, yaw, pitch, pan, roll):
    pose = pose_on_ground(SCENE, x, -x / 2, yaw, pitch, roll)
    body = rover_below(SCENE, pose, 0.27, pan)
    eye = body @ ZHURONG.mount.left_eye(0.27, pan)
    assert eye[:3, 3] == pytest.approx(pose[:3, 3], abs=1e-9)
    assert body[:3, :3] @ body[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
    heading = np.arctan2(body[1, 0], body[0, 0])
    assert np.angle(np.exp(1j * (heading - (yaw - pan)))) == pytest.approx(0, abs=1e-6)
    wheels = body[:3, 3] + ZHURONG.wheel_positions @ body[:3, :3].T
    clear = wheels[:, 2] - ZHURONG.wheel_radius - SCENE.terrain.height_at(wheels[:, 0], wheels[:, 1])
    assert np.abs(clear).mean() < 0.25


def test_straight_down_the_upper_side_of_the_image_is_ahead():
    level, down = (pose_on_ground(SCENE, 0.0, 0.0, 0.8, pitch) for pitch in (0.3, np.pi / 2))
    first, second = (rover_below(SCENE, pose, 0.27, 0.4)[:3, :3] for pose in (level, down))
    assert first == pytest.approx(second, abs=1e-6)


def test_the_chance_is_that_of_its_range():
    rng = np.random.default_rng(0)
    view = ViewConfig(rover=(0.2, 0.6), rover_pan_deg=(-30.0, 90.0))
    pans = [draw_pan(view, rng) for _ in range(3000)]
    some = np.rad2deg([pan for pan in pans if pan is not None])
    assert len(some) / len(pans) == pytest.approx(0.4, abs=0.03)
    assert -30 <= some.min() < -25 and 85 < some.max() <= 90
    assert all(draw_pan(ViewConfig(), rng) is None for _ in range(20))


@pytest.mark.parametrize(("values", "message"), [
    ({"rover": (0.5, 1.5)}, "rover must be a range LOW HIGH within 0 and 1, got 0.5 1.5"),
    ({"rover": (0.6, 0.5)}, "rover must be a range"), ({"rover_pan_deg": (-400.0, 0.0)}, "rover_pan_deg must be"),
    ({"rover": (0.0, 0.1), "height": (1.2, 3.0)}, "height must lie within 0.9 and 1.5 m where rover is above 0"),
])  # fmt: skip
def test_impossible_ranges_are_refused_in_one_line(values, message):
    with pytest.raises(ValueError) as caught:
        ViewConfig(**values)
    assert str(caught.value).startswith(message) and "\n" not in str(caught.value)


@given(st.integers(0, 10_000), st.floats(-3, 3))
@settings(max_examples=15)
def test_a_rover_that_is_drawn_stands_in_no_rock(seed, pan):
    pose = draw_pose_of_rover(ROCKY, ViewConfig(), np.random.default_rng(seed), MastState(0.27, pan))
    body = rover_below(ROCKY, pose, 0.27, pan)
    tall = ROCKY.bodies.height[ROCKY.bodies.face_rock] > ZHURONG.obstacle_height
    corners = ROCKY.bodies.vertices[np.unique(ROCKY.bodies.faces[tall])]
    corners = corners[corners[:, 2] > ROCKY.terrain.height_at(corners[:, 0], corners[:, 1])]
    assert len(corners) > 100
    forward = body[:2, 0] / np.hypot(*body[:2, 0])
    offset = corners[:, :2] - body[:2, 3]
    ahead, left = offset @ forward, offset @ [-forward[1], forward[0]]
    assert not ((np.abs(ahead) < ZHURONG.length / 2) & (np.abs(left) < ZHURONG.width / 2)).any()


def test_with_a_long_baseline_the_right_camera_is_above_the_ground_too():
    rng = np.random.default_rng(0)
    for _ in range(8):
        pose = draw_pose_of_rover(SCENE, ViewConfig(roll_deg=(-10.0, 10.0)), rng, MastState(8.0, 0.0))
        right = pose[:3, 3] + 8.0 * pose[:3, 0]
        assert right[2] >= SCENE.terrain.height_at(right[0], right[1]) + 0.2
