from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from marssim.base.rover_spec import ZHURONG
from marssim.scene import trajectory
from marssim.scene.own_rover import rover_below
from marssim.scene.relief import ReliefConfig
from marssim.scene.rocks.population import CAMERA_EXTENT, RockConfig
from marssim.scene.scene import Scene, SceneConfig, build_scene
from marssim.scene.trajectory import MastState, TrajectoryConfig, draw_trajectory, stand_on, tum_lines
from marssim.scene.viewpoint import ViewConfig

VIEW = ViewConfig(height=(1.2, 1.2), pitch_deg=(20.0, 20.0))
COUNT = 25


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(rocks=RockConfig(k=0.1, min_diameter=0.1)), np.random.default_rng(3))


@pytest.fixture(scope="module")
def tilted() -> Scene:
    """A scene whose ground is a plane that rises by 10 deg towards the north."""
    relief = ReliefConfig(
        rms_slope_deg=0.0, regional_slope_deg=10.0, regional_azimuth_deg=90.0, crater_density=0.0, ripple_amplitude=0.0
    )
    return build_scene(SceneConfig(relief=relief, rocks=RockConfig(k=0.0)), np.random.default_rng(0))


def drive(scene: Scene, seed: int, step: float = 0.4, count: int = COUNT) -> np.ndarray:
    return draw_trajectory(scene, VIEW, TrajectoryConfig(step=step), count, np.random.default_rng(seed))[0]


def room(scene: Scene, poses: np.ndarray) -> float:
    """Return the distance from the rover's middle to the nearest corner above ground of an obstacle rock."""
    up = -poses[:, :3, 1] * np.cos(np.deg2rad(20)) - poses[:, :3, 2] * np.sin(np.deg2rad(20))
    middle = poses[:, :3, 3] - 1.2 * up
    rocks = scene.bodies
    tall = rocks.height[rocks.face_rock] > ZHURONG.obstacle_height
    corners = rocks.vertices[np.unique(rocks.faces[tall])]
    corners = corners[corners[:, 2] > scene.terrain.height_at(corners[:, 0], corners[:, 1])]
    return float(np.hypot(*(middle[:, None, :2] - corners[:, :2]).T).min())


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 1000), step=st.sampled_from([0.15, 0.4]))
def test_a_drive_is_smooth_and_passes_the_rocks(scene, seed, step):
    poses = drive(scene, seed, step)
    assert np.allclose(poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.eye(3), atol=1e-9)
    assert np.allclose(np.linalg.det(poses[:, :3, :3]), 1)
    # the camera is carried 1.2 m above the ground, square to it: it sways a little about the way that is driven
    ways = np.linalg.norm(np.diff(poses[:, :2, 3], axis=0), axis=1)
    assert abs(np.median(ways) - step) < 0.1 * step + 0.02
    heading = np.unwrap(np.arctan2(poses[:, 1, 2], poses[:, 0, 2]))
    assert np.abs(np.diff(heading)).max() < 0.5 * step + 0.1  # no turn tighter than 2 m
    assert np.abs(poses[:, :2, 3]).max() < CAMERA_EXTENT * scene.half + 0.5
    assert room(scene, poses) >= ZHURONG.width / 2


@pytest.mark.parametrize("seed", [5, 11])
def test_a_drive_keeps_half_the_rovers_width_off_the_corners_of_rocks(seed):
    """If rocks were discs of their diameter, corners would come as near as 0.66 and 0.45 m on these drives."""
    rocky = build_scene(SceneConfig(rocks=RockConfig(k=0.2, min_diameter=0.4)), np.random.default_rng(3))
    assert ZHURONG.width / 2 <= room(rocky, drive(rocky, seed)) < 1.0


def test_a_drive_goes_past_ditches():
    relief = ReliefConfig(ditch_density=0.01, ditch_depth=(0.8, 1.2))
    ditched = build_scene(SceneConfig(relief=relief, rocks=RockConfig(k=0.0)), np.random.default_rng(1))
    for seed in range(3):
        poses = drive(ditched, seed)
        upright = np.rad2deg(np.arccos(-poses[:, 2, 1]))  # of the camera, which looks down by 20 deg
        assert np.abs(upright - 20).max() < 20
        around = poses[:, :2, 3, None] + 0.5 * np.array([np.cos(np.arange(6)), np.sin(np.arange(6))])
        beside = ditched.terrain.height_at(around[:, 0], around[:, 1])
        assert np.ptp(beside, axis=1).max() < 0.5


def test_a_drive_follows_the_seed_and_its_start_does_not_depend_on_its_length(tilted):
    assert np.array_equal(drive(tilted, 4), drive(tilted, 4))
    assert not np.array_equal(drive(tilted, 4), drive(tilted, 5))
    assert np.array_equal(drive(tilted, 4, count=6), drive(tilted, 4)[:6])


@given(yaw=st.floats(-4, 4))
def test_the_rover_stands_on_the_plane(tilted, yaw):
    body = stand_on(tilted, 1.0, 2.0, yaw)
    assert np.allclose(body[:3, 2], [0, -np.sin(np.deg2rad(10)), np.cos(np.deg2rad(10))], atol=1e-3)
    assert np.arctan2(body[1, 0], body[0, 0]) == pytest.approx(np.arctan2(np.sin(yaw), np.cos(yaw)), abs=1e-6)
    assert body[2, 3] == pytest.approx(float(tilted.terrain.height_at(1.0, 2.0)), abs=1e-3)
    assert np.allclose(np.cross(body[:3, 0], body[:3, 1]), body[:3, 2])


def test_the_camera_looks_down_from_the_plane_it_is_carried_over(tilted):
    for pose in drive(tilted, 1):
        up = np.array([0, -np.sin(np.deg2rad(10)), np.cos(np.deg2rad(10))])
        assert np.arcsin(-pose[:3, 2] @ up) == pytest.approx(np.deg2rad(20), abs=2e-3)
        assert pose[:3, 0] @ up == pytest.approx(0, abs=2e-3)  # not rolled against it
        foot = pose[:3, 3] - 1.2 * up
        assert foot[2] == pytest.approx(float(tilted.terrain.height_at(foot[0], foot[1])), abs=2e-3)


def test_tum_format_is_read_back_by_another_hand():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = Rotation.random(3, random_state=1).as_matrix()
    poses[:, :3, 3] = np.random.default_rng(2).normal(size=(3, 3))
    table = np.loadtxt(tum_lines([0.0, 1.5, 3.0], poses).splitlines())  # '#' begins a comment there as in TUM's tools
    assert table.shape == (3, 8) and np.allclose(table[:, 0], [0, 1.5, 3])
    assert np.allclose(table[:, 1:4], poses[:, :3, 3], atol=1e-8)
    for (x, y, z, w), pose in zip(table[:, 4:], poses):
        rotation = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        assert np.allclose(rotation, pose[:3, :3], atol=1e-7)


def test_rocks_that_leave_no_path_are_an_error():
    config = SceneConfig(size=16.0, horizon=20.0, rocks=RockConfig(k=0.2, min_diameter=0.1))
    rocky = build_scene(config, np.random.default_rng(0))
    low, tall = (replace(rocky, rocks=replace(rocky.rocks, height=np.full(len(rocky.rocks), h))) for h in (0.1, 1.0))
    assert len(drive(low, 0, count=9)) == 9
    with pytest.raises(ValueError, match=r"no path of 3\.2 m past the rocks .* `rocks\.k`"):
        drive(tall, 0, count=9)


def test_a_scene_too_small_for_the_drive_is_an_error():
    small = build_scene(SceneConfig(size=8.0, horizon=12.0, rocks=RockConfig(k=0.0)), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"no path of 195 m .* `drive.step`"):
        draw_trajectory(small, VIEW, TrajectoryConfig(step=5.0), 40, np.random.default_rng(0))
    with pytest.raises(
        ValueError, match=r"square is too small for a drive whose left eye is \d\.\d\d m .* `size` or a"
    ):
        draw_trajectory(small, VIEW, TrajectoryConfig(), 2, np.random.default_rng(0), MastState(8.0, 0.0))


@pytest.mark.parametrize(
    "change",
    [
        {"step": 0.0},
        {"step": float("nan")},
        {"speed": 0.0},
        {"speed": 1e-11},
        {"speed": float("inf")},
        {"speed": 1e300},
    ],
)
def test_bad_values_are_named(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        TrajectoryConfig(**change)


def test_the_place_of_the_camera_on_the_rover_puts_the_rover_on_the_ground(tilted):
    for mast in (None, MastState(0.27, 0.7)):
        poses, mount = draw_trajectory(tilted, VIEW, TrajectoryConfig(), COUNT, np.random.default_rng(4), mast)
        bodies = poses @ np.linalg.inv(mount)
        up = np.array([0, -np.sin(np.deg2rad(10)), np.cos(np.deg2rad(10))])
        np.testing.assert_allclose(bodies[:, :3, 2], np.broadcast_to(up, (COUNT, 3)), atol=1e-3)
        np.testing.assert_allclose(bodies[:, 2, 3], tilted.terrain.height_at(*bodies[:, :2, 3].T), atol=1e-3)


def test_with_a_mast_the_rovers_middle_drives_along_the_path(tilted):
    """The camera stands where the turned mast carries it, so its own steps are others."""
    for pan in (2.2, -1.8):
        mast, config, rng = MastState(0.27, pan), TrajectoryConfig(step=0.4), np.random.default_rng(3)
        poses, _ = draw_trajectory(tilted, VIEW, config, COUNT, rng, mast)
        middles = np.array([rover_below(tilted, pose, mast.baseline, pan) for pose in poses])
        steps = np.diff(middles[:, :2, 3], axis=0)
        assert np.abs(np.hypot(*steps.T) - 0.4).max() < 0.02
        ahead = np.arctan2(middles[:-1, 1, 0], middles[:-1, 0, 0]) - np.arctan2(steps[:, 1], steps[:, 0])
        assert np.abs((ahead + np.pi) % (2 * np.pi) - np.pi).max() < 0.2
        assert np.abs(poses[:, :2, 3]).max() < CAMERA_EXTENT * tilted.half + 0.3  # but for the lean of the rover


def test_places_ahead_are_tested_at_centimetres_where_strides_are_millimetres(scene, monkeypatch):
    tested = []
    plain = trajectory._free

    def counting(obstacles, x, y):
        tested.append(np.size(x))
        return plain(obstacles, x, y)

    monkeypatch.setattr(trajectory, "_free", counting)
    poses = drive(scene, 5, 0.002, 4)
    assert len(poses) == 4 and max(tested) <= 11 * (5 / 0.05 + 1)
