import numpy as np
import pytest

from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene
from marssim.scene.viewpoint import ViewConfig, draw_pose


def test_cameras_stand_where_they_were_asked_to():
    scene = build_scene(SceneConfig(size=12.0, horizon=16.0, rocks=RockConfig(k=0.1)), np.random.default_rng(0))
    view = ViewConfig(height=(1.1, 1.3), pitch_deg=(10.0, 30.0), roll_deg=(-3.0, 3.0))
    rng = np.random.default_rng(1)
    for _ in range(50):
        pose = draw_pose(scene, view, rng)
        x, y, z = pose[:3, 3]
        assert 1.1 <= z - scene.terrain.height_at(x, y) <= 1.3
        assert 10 <= np.rad2deg(-np.arcsin(pose[2, 2])) <= 30
        roll = np.rad2deg(np.arctan2(pose[2, 0], -pose[2, 1]))
        assert abs(roll) <= 3 + 1e-6
        to_disc = np.hypot(*(scene.bodies.centre[:, :2] - [x, y]).T) - scene.bodies.diameter / 2  # of the area
        assert to_disc[scene.bodies.height > 0.15].min() >= 0.6


def test_a_scene_without_a_place_to_stand_is_refused():
    scene = build_scene(SceneConfig(size=4.0, horizon=6.0, rocks=RockConfig(k=0.1)), np.random.default_rng(0))
    scene.rocks.diameter[0], scene.rocks.height[0] = 100.0, 1.0
    with pytest.raises(ValueError, match="no place") as refused:
        draw_pose(scene, ViewConfig(), np.random.default_rng(1))
    assert "`rocks.k`" in str(refused.value) and "\n" not in str(refused.value)


def test_a_right_camera_stands_above_the_ground_too():
    scene = build_scene(SceneConfig(size=12.0, horizon=16.0, rocks=RockConfig(k=0.0)), np.random.default_rng(0))
    view, rng = ViewConfig(roll_deg=(-15.0, 15.0)), np.random.default_rng(1)
    for _ in range(20):
        pose = draw_pose(scene, view, rng, 5.0)
        x, y, z = pose[:3, 3] + 5.0 * pose[:3, 0]
        assert z - scene.terrain.height_at(x, y) >= 0.2
    with pytest.raises(ValueError, match=r"the right camera, 9 m beside the left one, was nowhere above the ground"):
        draw_pose(scene, ViewConfig(roll_deg=(15.0, 15.0)), rng, 9.0)
