import copy
import json
import os
import pickle
import subprocess
import sys
import tracemalloc
import warnings
import weakref
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation, TimeLimit
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from envs.courses.course import CourseConfig, NoWayError, draw_course
from envs.drivers.image_observation import ImageObservation
from envs.mars_nav import STEP_SECONDS, MarsNavEnv
from envs.observation.nearest_depth import nearest_depth
from envs.world.eyes import EyesConfig
from envs.world.slip import SlipConfig
from envs.world.user_code import UserCodeError
from m3depth.stereo.prediction import Prediction
from marssim.scene.place_file import save_place

pytestmark = pytest.mark.usefixtures("small_pictures")

AHEAD, LEFT = np.array([1, 0], np.float32), np.array([0.5, 0.3], np.float32)


def same(a, b):
    return set(a) == set(b) and all(np.array_equal(a[key], b[key]) for key in a)


# ------------------------------------------------------------------------------------- the contract


@pytest.fixture
def rockless(small_scene):
    """Bare ground, which checkers reset again and again."""
    bare = dict.fromkeys(("texture_strength", "pebbles", "wind_ripples", "bedrock", "gravel", "drifts"), (0.0, 0.0))
    look, rocks = replace(small_scene.look, **bare), replace(small_scene.rocks, k=0.0)
    return replace(small_scene, look=look, rocks=rocks)


RARELY = {"condition": {"look_every": 1.0, "into_sun": True}, "map_observation": True}
DRAWN = {
    "goal_distance": (3.0, 4.0), "k": (0.0, 0.01), "slope_deg": (0, 5), "sun_elevation_deg": (20, 60),
    "slip": (None, "sand"), "condition": ("clear", {"look_every": 1.0}), "episodes_per_scene": 2,
}  # fmt: skip
FAULTS = {
    "lens_dust": 0.3, "lens_glare": 0.3, "into_sun": True, "temperature": 50.0, "jpeg_quality": 40.0,
    "image_pixels": 64,
}  # fmt: skip
FAULTY = {"perception": "sgbm", "condition": {**FAULTS, "ditch": True, "goal_distance": 12.0}}
NOISY = {"map_observation": True, "disparity_noise": 0.3, "drift": 0.02, "yaw_drift_deg": 1.0}


@pytest.mark.parametrize(
    "settings",
    [
        {"mast": True, "render_mode": "rgb_array", **NOISY}, {"slip": SlipConfig("sand", 0.5), "dynamics": "physics"},
        {"slip": "scene", **RARELY}, DRAWN, FAULTY,
    ],
)  # fmt: skip
def test_the_checker_of_gymnasium_accepts_the_environment(make_env, rockless, monkeypatch, settings):
    env = make_env(**{"goal_distance": 3.0, "scene": rockless, **settings})
    told = env._info
    monkeypatch.setattr(env, "_info", lambda: told() | {"perception_seconds": 0.0})  # which no seed can repeat
    check_env(env, skip_render_check="render_mode" not in settings)


@pytest.mark.parametrize(
    ("settings", "wrap"),
    [
        ({"mast": True, **NOISY}, False), ({"mast": True, **NOISY}, True),
        ({"slip": "sand"}, False), ({"slip": "scene", **RARELY}, False), (DRAWN, False), (FAULTY, False),
    ],
)  # fmt: skip
def test_the_checker_of_stable_baselines_accepts_the_environment(make_env, rockless, settings, wrap):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = make_env(**{"goal_distance": 3.0, "scene": rockless, **settings})
    checker.check_env(ImageObservation(env) if wrap else env, warn=False)


def test_gymnasium_makes_the_environment_by_its_name(small_scene):
    env = gymnasium.make("envs:MarsNav-v0", perception="ground_truth", dynamics="physics", scene=small_scene)
    assert isinstance(env.unwrapped, MarsNavEnv) and env.unwrapped.dynamics == "physics"
    observation, info = env.reset(seed=1, options={"goal_distance": 5})
    assert observation in env.observation_space and info["distance"] == pytest.approx(5.0, abs=0.05)
    env.close()


def test_importing_loads_neither_torch_nor_pybullet():
    code = "import sys, envs, envs.evaluate, envs.mars_nav; print(*sorted({'torch', 'pybullet'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"


def test_importing_needs_neither_embree_nor_pybullet():
    """trimesh loads Embree where it is there, so it is taken away."""
    code = "import sys; sys.modules.update(embreex=None, pybullet=None); import envs.evaluate, envs.mars_nav, "
    code += "marssim.abundance, marssim.generate, marssim.physics.support, marssim.verify, nav"
    subprocess.run([sys.executable, "-c", code], check=True)


def vector_of(mode, **settings):
    settings = {"perception": "ground_truth", "dynamics": "kinematic", "goal_distance": 3.0, **settings}
    return gymnasium.make_vec("envs:MarsNav-v0", num_envs=2, vectorization_mode=mode, **settings)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_the_environment_runs_in_vectors_of_gymnasium(rockless, mode):
    vector = vector_of(mode, scene=rockless)
    try:
        observation, _ = vector.reset(seed=3)
        assert observation["depth"].shape == (2, 64, 64)
        assert not np.array_equal(observation["goal"][0], observation["goal"][1])
        observation, reward, *_ = vector.step(np.stack([AHEAD, LEFT]))
        assert observation in vector.observation_space and reward.shape == (2,)
    finally:
        vector.close()


def test_autoresets_draw_the_same_in_any_vector_of_gymnasium(rockless):
    """Each environment draws from its own stream, in its own process or not."""
    drawn = []
    for mode in ("sync", "async"):
        vector = vector_of(mode, scene=rockless, k=(0.0, 0.01), condition=("clear", "low_sun"))
        infos, ended = [vector.reset(seed=3)[1]], 0
        while ended < 2:  # at the goal or out of bounds
            _, _, terminated, truncated, info = vector.step(np.stack([AHEAD, AHEAD]))
            ended += int((terminated | truncated).sum())
            infos.append(info)
        vector.close()
        drawn.append([[*each["drawn"]["k"], *each["drawn"]["condition"], *each["distance"]] for each in infos])
    assert drawn[0] == drawn[1]
    assert len({k for row in drawn[0] for k in row[:2]}) > 2  # each environment draws other values at each autoreset


def test_conditions_by_name_and_by_values_are_drawn_in_a_vector_of_gymnasium(rockless):
    """gymnasium gives the entries of info one type, that of the first environment."""
    vector = vector_of("sync", scene=rockless, condition=("clear", {"look_every": 1.0}))
    try:
        conditions = vector.reset(seed=0)[1]["drawn"]["condition"]
    finally:
        vector.close()
    assert list(conditions) == ["clear", '{"look_every": 1.0}']


def test_wrappers_of_gymnasium_work_on_the_environment(make_env, rockless, tmp_path):
    env = TimeLimit(FlattenObservation(make_env(scene=rockless, goal_distance=3.0)), 2)
    flat, _ = env.reset(seed=0)
    assert flat.shape == (64 * 64 + 3 + 6,) and flat in env.observation_space
    assert [env.step(LEFT)[3] for _ in range(2)] == [False, True]
    pytest.importorskip("moviepy")
    from gymnasium.wrappers import RecordVideo

    inner = TimeLimit(make_env(scene=rockless, goal_distance=3.0, render_mode="rgb_array"), 2)
    film = RecordVideo(inner, str(tmp_path), lambda episode: True, disable_logger=True)
    film.reset(seed=0)
    film.step(LEFT)
    film.step(LEFT)
    film.close()
    assert [file.stat().st_size > 1000 for file in tmp_path.glob("*.mp4")] == [True]


def drive(env, seed, actions):
    """Every number that an episode shows."""
    observation, _ = env.reset(seed=seed)
    seen = [observation]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append({**observation, "reward": reward, "ends": (terminated, truncated), "way": info["path_length"]})
    return seen


def test_a_seed_is_an_episode(make_env):
    env, other = make_env(), make_env()
    first = drive(env, 4, [AHEAD, LEFT, LEFT])
    drive(env, 5, [LEFT])  # nothing of it stays
    for again in (drive(env, 4, [AHEAD, LEFT, LEFT]), drive(other, 4, [AHEAD, LEFT, LEFT])):
        assert all(same(a, b) for a, b in zip(first, again))
    different = drive(env, 6, [])[0]
    assert not np.array_equal(first[0]["depth"], different["depth"])
    without_seed, _ = env.reset()
    assert not np.array_equal(without_seed["depth"], different["depth"])


def test_physics_is_a_function_of_the_seed_too(make_env):
    env = make_env(dynamics="physics", goal_distance=5.0)
    first, again = drive(env, 2, [AHEAD, LEFT]), drive(env, 2, [AHEAD, LEFT])
    assert all(same(a, b) for a, b in zip(first, again))


CHILD = """
import hashlib
from dataclasses import replace
import numpy as np
from envs.mars_nav import MarsNavEnv
from marssim.scene.presets import preset
scene = preset("utopia", size=12.0, horizon=14.0)
scene = replace(scene, rocks=replace(scene.rocks, min_diameter=0.2))
env = MarsNavEnv("ground_truth", "kinematic", scene=scene, goal_distance=4.0)
digest = hashlib.sha256()
env.reset(seed=9)
for action in ((1, 0), (0.5, 0.6)):
    observation, reward, *_ = env.step(np.array(action, np.float32))
    for key in sorted(observation):
        digest.update(observation[key].tobytes())
    digest.update(np.float64(reward).tobytes())
print(digest.hexdigest())
"""


def test_another_process_drives_the_same_episode(capsys):
    exec(CHILD, {})
    environment = {**os.environ, "PYTHONHASHSEED": "1"}
    run = subprocess.run([sys.executable, "-c", CHILD], env=environment, capture_output=True, text=True, check=True)
    assert len(run.stdout) == 65 and run.stdout == capsys.readouterr().out


def test_observations_stay_in_their_space(make_env):
    env = make_env(mast=True)
    rng = np.random.default_rng(0)
    observation, _ = env.reset(seed=1)
    for _ in range(15):
        assert observation in env.observation_space
        assert np.isfinite(observation["state"]).all()
        observation, _, terminated, _, _ = env.step(rng.uniform(-1, 1, 3).astype(np.float32))
        if terminated:
            observation, _ = env.reset()


def test_the_goal_is_seen_from_the_rover(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(), start=(0.0, 0.0, np.pi / 2), goal=(3.0, 3.0)))
    goal = env.step(np.zeros(2))[0]["goal"]
    np.testing.assert_allclose(goal, [np.hypot(3, 3), -np.sqrt(0.5), np.sqrt(0.5)], atol=1e-3)  # 45 deg to the right
    state = env.step(LEFT)[0]["state"]
    np.testing.assert_allclose(state[:2], 0, atol=1e-3)
    np.testing.assert_allclose(state[2:], [0.5 * 0.2, 0.3 * 0.25, *LEFT], atol=1e-2)


def test_the_mast_turns_the_next_look_and_takes_its_time(make_env):
    """30 deg/s: 60 deg in the 2 s of a step, and the rest in the next one."""
    env = make_env(mast=True)
    start, _ = env.reset(seed=3)
    left, _, _, _, info = env.step(np.array([0, 0, 1.0]))
    assert info["pan"] == env.sight.pan == pytest.approx(np.pi / 3)
    assert not np.array_equal(left["depth"], start["depth"])
    assert env.step(np.array([0, 0, 1.0]))[4]["pan"] == pytest.approx(np.pi / 2)
    assert env.step(np.zeros(3))[4]["pan"] == pytest.approx(np.pi / 6)
    np.testing.assert_array_equal(env.step(np.zeros(3))[0]["depth"], start["depth"])


def test_the_map_shows_what_was_seen(on_course, make_scene, make_course):
    scene = make_scene(rocks=[(0.0, 1.0, 1.2, 0.7)])
    env = on_course(make_course(scene, start=(-4.0, 0.0, 0.0), goal=(4.0, 0.0)), map_observation=True)
    seen = env.step(np.array([0.5, 0.0]))[0]["map"]
    assert seen in env.observation_space["map"]
    x = env.vehicle.state().position[0]
    row, column = int((6.4 - (0.0 - 0.5 - x)) / 0.2), int((6.4 - 1.0) / 0.2)  # the face of the rock: ahead, to the left
    around = np.s_[row - 2 : row + 3, column - 2 : column + 3]
    assert seen[0][around].max() > 0.2 and seen[1][around].max() == 1.0 and seen[2][around].max() == 1.0
    assert seen[1][row, 64 - column] < 0.5 and seen[2][60:, 5].max() == 0  # free on the right, unseen behind
    turned = env.step(np.array([0.0, -1.0]))[0]["map"]  # to the right: the rock moves to the left
    assert np.argwhere(turned[1] == 1.0)[:, 1].mean() < np.argwhere(seen[1] == 1.0)[:, 1].mean() - 3


def test_noise_is_on_the_depth_and_follows_from_the_seed(make_env):
    clean, _ = make_env().reset(seed=3)
    noisy, again = (make_env(disparity_noise=0.5).reset(seed=3)[0] for _ in range(2))
    assert same(noisy, again)
    near = (clean["depth"] > 1) & (clean["depth"] < 3)
    difference = np.abs(noisy["depth"] - clean["depth"])
    assert 0 < difference[near].mean() < 0.1
    assert difference[(clean["depth"] > 6) & (clean["depth"] < 14)].mean() > 3 * difference[near].mean()


def test_odometry_drifts_from_the_truth(on_course, make_scene, make_course):
    course = make_course(make_scene(), start=(-6.0, 0.0, 0.0), goal=(6.0, 0.0))
    env = on_course(course, drift=0.05, yaw_drift_deg=2.0)
    errors = [env.step(AHEAD)[4]["position_error"] for _ in range(20)]
    assert errors[0] > 0 and 0.02 < errors[-1] < 2.0
    observation, _, _, _, info = env.step(np.zeros(2))
    assert info["position_error"] == errors[-1]  # what stands does not drift
    believed = env.course.goal - env.believed_pose[:2, 3]
    assert observation["goal"][0] == pytest.approx(np.hypot(*believed), rel=1e-5)
    assert info["distance"] == pytest.approx(np.hypot(*(env.course.goal - env.vehicle.state().position[:2])))
    assert on_course(course).step(AHEAD)[4]["position_error"] == 0


# ------------------------------------------------------------------------------------- options and mistakes


def test_options_change_the_course(make_env):
    env = make_env()
    env.reset(seed=1, options={"k": 0.0})
    assert len(env.course.scene.rocks) == 0
    few = reset_rocks(env, k=0.03)
    assert reset_rocks(env, k=0.2) > 2 * few > 0
    _, info = env.reset(seed=1, options={"goal_distance": 4, "sun_elevation_deg": 33})
    assert info["distance"] == pytest.approx(4) and env.referee.time_limit == 60
    assert np.rad2deg(env.course.scene.look.sun_elevation) == pytest.approx(33)
    _, info = env.reset(seed=1)
    assert info["distance"] == pytest.approx(6)  # options hold for one reset
    grid = env.course.scene.terrain.coarse.heights
    env.reset(seed=1, options={"slope_deg": 15.0})
    steep = env.course.scene.terrain.coarse.heights
    assert plane_slope_deg(steep) == pytest.approx(15, abs=2.5) and plane_slope_deg(grid) < 5


def reset_rocks(env, k):
    env.reset(seed=1, options={"k": k})
    return len(env.course.scene.rocks)


def plane_slope_deg(heights):
    """Of the plane that fits a grid of 1 m best."""
    y, x = np.indices(heights.shape).reshape(2, -1)
    gradient = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], 1), heights.ravel(), rcond=None)[0][:2]
    return np.rad2deg(np.arctan(np.hypot(*gradient)))


# ------------------------------------------------------------------------------------- draws and kept scenes


def test_the_course_of_a_seed_is_that_of_0_2_0(make_env, small_scene):
    """Which numbers are taken from the stream of a seed, and in which order, must not change."""
    env = make_env()
    env.reset(seed=4)
    env.reset()
    rng = gymnasium.utils.seeding.np_random(4)[0]
    for _ in range(2):
        course = draw_course(small_scene, CourseConfig(goal_distance=6.0), env.rover_spec, rng)
        rng.integers(2**63), rng.integers(2**63)  # of the detector and of the odometry
    np.testing.assert_array_equal(env.course.start, course.start)
    np.testing.assert_array_equal(env.course.scene.terrain.fine.heights, course.scene.terrain.fine.heights)
    np.testing.assert_array_equal(env.course.scene.bodies.vertices, course.scene.bodies.vertices)
    assert env.np_random.bit_generator.state == rng.bit_generator.state


def test_info_has_the_same_keys_in_all_episodes_whatever_is_drawn(make_env):
    """A wrapper that reads a key would else fail in some of them."""
    env = make_env(goal_distance=3.0, slip=("sand", None), condition=("clear", {"look_every": 1.0}))
    keys, slips, rare = [], set(), set()
    for seed in range(12):
        infos = [env.reset(seed=seed)[1], env.step(AHEAD)[4]]
        keys += [tuple(info) for info in infos]
        slips.add((infos[1]["drawn"]["slip"] is not None, infos[1]["energy"] > 0))
        rare.add((env.gaze.every > 0, infos[1]["looked"]))
    assert len(set(keys)) == 1 and {"slip", "sideways", "sinkage", "energy", "drive_seconds"} < set(keys[0])
    assert slips == {(True, True), (False, False)} and rare == {(True, False), (False, True)}
    assert "slip" not in make_env().reset(seed=1)[1]


def test_what_is_drawn_is_a_course_that_options_can_repeat(make_env):
    env, plain = make_env(k=(0.0, 0.2), goal_distance=(3.0, 6.0), slip=("sand", None)), make_env()
    _, info = env.reset(seed=8)
    drawn = dict(info["drawn"])
    assert set(drawn) == {"goal_distance", "k", "slip"} and info["distance"] == pytest.approx(drawn["goal_distance"])
    drawn.pop("slip")
    assert info["drawn"] == env.step(AHEAD)[4]["drawn"]
    _, again = plain.reset(seed=8, options=drawn)
    np.testing.assert_array_equal(env.course.start, plain.course.start)
    np.testing.assert_array_equal(env.course.scene.bodies.centre, plain.course.scene.bodies.centre)
    assert "drawn" not in again and again["shortest"] == info["shortest"]
    assert env.reset()[1]["drawn"] != info["drawn"]  # as a vector environment resets
    assert env.reset(options={"k": 0.01, "goal_distance": 4})[1]["drawn"]["k"] == 0.01
    assert env.reset(seed=8)[1] == info


def test_a_scene_is_kept_for_some_episodes(make_env):
    env = make_env(episodes_per_scene=3, map_observation=True, render_mode="rgb_array")
    seen = []
    for seed in (5, None, None, None, 5, None):
        observation, info = env.reset(seed=seed)
        seen.append((env.course.scene, env.course.start, observation, info, env.perception.renderer))
        assert observation in env.observation_space and info["outcome"] == "driving" and info["path_length"] == 0
        assert info["distance"] == pytest.approx(observation["goal"][0]) == pytest.approx(6.0)
        assert 0.3 < env.step(AHEAD)[4]["path_length"] < 0.41
        env.render()
    scenes, starts, observations, infos, renderers = zip(*seen)
    assert scenes[0] is scenes[1] is scenes[2] is not scenes[3] and renderers[0] is renderers[2] is not renderers[3]
    assert len({tuple(start) for start in starts[:4]}) == 4
    assert same(observations[4], observations[0]) and same(observations[5], observations[1])  # as the seed has it
    assert infos[4:] == infos[:2]


def test_options_leave_a_kept_scene(make_env):
    env = make_env(episodes_per_scene=3)
    env.reset(seed=5)
    scene = env.course.scene
    env.reset(options={"k": 0.0})
    bare = env.course.scene
    assert bare is not scene and len(bare.rocks) == 0
    env.reset()
    assert env.course.scene is not bare


def test_scene_seed_is_the_course_whatever_the_seed(make_env):
    env = make_env()
    a, _ = env.reset(seed=1, options={"scene_seed": 7})
    b, _ = env.reset(seed=2, options={"scene_seed": 7})
    c, _ = env.reset(seed=1, options={"scene_seed": 8})
    assert same(a, b) and not same(a, c)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"rocks": 3}, "rocks"), ({"k": 2.0}, "k"), ({"k": "many"}, "k"), ({"goal_distance": None}, "goal_distance"),
        ({"slope_deg": 40}, "slope_deg"), ({"sun_elevation_deg": [3]}, "sun_elevation_deg"),
        ({"scene_seed": 0.5}, "scene_seed"), ("k", "options"), ({1: 2}, "1"),
    ],
)  # fmt: skip
def test_bad_options_are_named(make_env, options, named):
    with pytest.raises(ValueError, match=rf"\b{named}\b") as error:
        make_env().reset(seed=0, options=options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"dynamics": "magic"}, "dynamics"), ({"renderer": "magic"}, "renderer"), ({"scene": "magic"}, "scene"),
        ({"scene": 3}, "scene"), ({"render_mode": "human"}, "render_mode"),
        ({"disparity_noise": -1.0}, "disparity_noise"), ({"drift": float("nan")}, "drift"),
        ({"yaw_drift_deg": "much"}, "yaw_drift_deg"),
        ({"mast": "no"}, "mast must be True or False, got 'no'"), ({"map_observation": 1}, "map_observation must be"),
        ({"align_rows": None}, "align_rows must be True or False, got None"),
        ({"goal_distance": 0.0}, "goal_distance"), ({"k": (0.2, 0.1)}, "^k must have the lower end of its range first"),
        ({"episodes_per_scene": 0}, "^episodes_per_scene must be a whole number of 1 or more, got 0"),
        ({"episodes_per_scene": True}, "^episodes_per_scene must be"),
        ({"eyes": 0}, "^eyes must be an EyesConfig of envs.world.eyes, got 0"),
        ({"runtime": "magic"}, "^`runtime` 'magic' is unknown; choose from auto, pytorch, openvino$"),
        ({"eyes": "storm"}, "^eyes must be an EyesConfig of envs.world.eyes, got 'storm'"),
        ({"perception": 5}, "`perception` 5 has no method infer"),
        (
            {"perception": "magic"},
            "^`perception` 'magic' is unknown; choose from ground_truth, m3depth, sgbm, m3depth:WEIGHTS, "
            r"package\.module:Class, sgbm-hh, ssd, sad, ncc, ssd-sgm, sad-sgm, ncc-sgm, mccnn$",
        ),
    ],
)  # fmt: skip
def test_bad_arguments_are_named(make_env, settings, named):
    with pytest.raises(ValueError, match=named) as error:
        make_env(**settings)
    assert "\n" not in str(error.value)


def test_a_place_of_the_users_own_comes_from_a_file(make_env, small_scene, tmp_path):
    file = tmp_path / "my_place.json"
    save_place(small_scene, file)
    ours, theirs = (make_env(scene=scene).reset(seed=4)[0] for scene in (str(file), file))
    expected = make_env(scene=small_scene).reset(seed=4)[0]
    assert all(np.array_equal(ours[key], expected[key]) and np.array_equal(theirs[key], expected[key]) for key in ours)


def test_a_heightmap_of_a_place_in_a_file_is_the_ground_of_the_course(make_env, tmp_path):
    columns = np.mgrid[:80, :80][1]
    np.save(tmp_path / "heights.npy", 0.05 * columns.astype(np.float32))  # rises by 1 m in 10 m to the east
    place = {"rocks": {"k": 0}, "relief": {"heightmap": "heights.npy", "heightmap_scale": 0.5}, "horizon": 18}
    (tmp_path / "place.json").write_text(json.dumps(place))
    env = make_env(scene=tmp_path / "place.json")
    env.reset(seed=1)
    east, west = (env.course.scene.terrain.height_at(np.array(x), np.array(0.0)) for x in (4.0, -4.0))
    assert east - west == pytest.approx(0.8, abs=0.05)


def test_without_pybullet_the_default_is_kinematic_and_physics_by_name_is_refused(small_scene, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)  # as if it were not installed
    settings = {"perception": "ground_truth", "scene": small_scene, "goal_distance": 4.0, "disable_env_checker": True}
    with pytest.warns(UserWarning, match="PyBullet is not installed") as caught:
        env = gymnasium.make("envs:MarsNav-v0", **settings)
    assert sum("PyBullet" in str(warning.message) for warning in caught) == 1
    env.reset(seed=1)
    env.step(np.ones(2, np.float32))
    assert env.unwrapped.dynamics == "kinematic"
    env.close()
    message = "^`dynamics` physics needs PyBullet, which is not installed; choose kinematic instead$"
    with pytest.raises(ImportError, match=message):
        gymnasium.make("envs:MarsNav-v0", dynamics="physics", **settings)


def test_bad_actions_are_refused(make_env):
    env = make_env()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(AHEAD)
    env.reset(seed=0)
    for action, message in (
        (np.array([np.nan, 0]), "finite"), (np.array([0, np.inf]), "finite"), (np.zeros(3), "shape"),
        (np.float32(1), "shape"), ([10**400, 0], "numbers"), ([1e300, 0], "finite"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            env.step(action)
    position = env.vehicle.state().position
    env.step([9.0, 0])  # as far as the rover goes, no farther
    assert np.hypot(*(env.vehicle.state().position - position)[:2]) == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_a_copied_or_unpickled_environment_needs_a_reset(make_env, dynamics):
    env = make_env(dynamics=dynamics, map_observation=True)
    env.reset(seed=0)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env)), copy.copy(env)):
        with pytest.raises(gymnasium.error.ResetNeeded):
            twin.step(AHEAD)
        twin.close()
    env.step(AHEAD)
    twin = copy.deepcopy(env)
    assert twin.reset(seed=3)[1]["distance"] == pytest.approx(env.reset(seed=3)[1]["distance"])
    twin.close()


def test_a_closed_environment_can_be_closed_again_and_needs_a_reset(make_env):
    env = make_env(render_mode="rgb_array")
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(AHEAD)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    env.reset(seed=0)
    env.step(AHEAD)


@pytest.mark.parametrize("settings", [{}, {"condition": {"look_every": 4.0}}, {"episodes_per_scene": 3}])
def test_after_a_reset_in_which_the_perception_raised_another_one_is_needed(make_env, settings):
    class Blind:
        looks = 0

        def infer(self, left, right, rig):
            self.looks += 1
            if self.looks == 2:
                raise RuntimeError("no light")
            depth = np.full(left.shape[:2], 4.0, np.float32)
            return Prediction(depth, rig.fb / depth, None, np.ones_like(depth))

    env = make_env(perception=Blind(), **settings)
    env.reset(seed=0)
    with pytest.raises(UserCodeError, match="no light"):
        env.reset()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(AHEAD)
    env.reset()
    env.step(AHEAD)


def test_after_a_reset_with_a_wrong_option_another_one_is_needed(make_env):
    env = make_env(goal_distance=3.0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="k must"):
        env.reset(seed=1, options={"k": 9})
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(AHEAD)
    env.reset(seed=0)
    env.step(AHEAD)


def test_a_reset_after_one_that_found_no_way_draws_other_settings(make_env, monkeypatch):
    tried = []

    def no_way(scene, course, *_):
        tried.append(course.k)
        raise NoWayError("no way")

    monkeypatch.setattr("envs.suites.drawn_course.draw_course", no_way)
    env = make_env(k=(0.0, 0.4))
    for seed in (3, None, None):
        with pytest.raises(NoWayError):
            env.reset(seed=seed)
    assert len(set(tried)) == len(tried) > 3


def test_after_a_reset_with_a_wrong_seed_another_one_is_needed(make_env):
    env = make_env(goal_distance=3.0)
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.Error):
        env.reset(seed=-1)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(AHEAD)


def test_either_renderer_can_be_seen_from_outside(make_env):
    env = make_env(renderer="pybullet", render_mode="rgb_array", goal_distance=3.0)
    env.reset(seed=0)
    picture = env.render()
    assert picture.ndim == 3 and picture.dtype == np.uint8 and picture.std() > 5
    env.reset(seed=1)
    assert not np.array_equal(env.render(), picture)  # of this course, not of the one before


def test_a_second_picture_of_the_same_step_is_the_same(make_env):
    env = make_env(render_mode="rgb_array", goal_distance=3.0)
    env.reset(seed=0)
    env.render()
    env.step(np.array([0, 1], np.float32))
    picture = env.render()
    np.testing.assert_array_equal(env.render(), picture)


@pytest.mark.parametrize(("perception", "dynamics"), [("ground_truth", "kinematic"), ("sgbm", "physics")])
def test_a_scene_is_forgotten_before_the_next_one_is_made_and_at_the_end(make_env, monkeypatch, perception, dynamics):
    """But for a scene that is kept."""
    env = make_env(
        perception=perception, dynamics=dynamics, eyes=EyesConfig(64, 64), render_mode="rgb_array", episodes_per_scene=2
    )
    scenes, kept = [], []

    def drawn(*arguments):
        kept.extend(scene() is not None for scene in scenes)
        return draw_course(*arguments)

    monkeypatch.setattr("envs.suites.drawn_course.draw_course", drawn)
    for seed in (0, None, 1):
        env.reset(seed=seed)
        env.render()
        scenes.append(weakref.ref(env.course.scene))
    assert kept == [False, False] and scenes[2]() is not None
    env.close()
    assert scenes[2]() is None


def resident_memory():
    """[MB]"""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="reads Linux's /proc")
def test_resets_keep_no_memory(make_env):
    env = make_env(goal_distance=(3.0, 3.5), slip=(None, "sand"), condition=("clear", "storm"), episodes_per_scene=2)
    env.reset(seed=0)
    for _ in range(12):  # until every setting has been drawn, and all is made that scenes share
        env.reset()
    before = resident_memory()
    for _ in range(20):
        env.reset()
    assert resident_memory() - before < 20


def test_looks_at_faulty_images_keep_no_memory(make_env):
    """Images are small, and resident memory grows by pages: this counts the bytes that Python and NumPy hold."""
    condition = FAULTS | {"optical_depth": 3.0}
    eyes = EyesConfig(image_pixels=128, ground_truth_pixels=64)  # the condition halves the images
    env = make_env(perception="sgbm", goal_distance=3.0, condition=condition, episodes_per_scene=99, eyes=eyes)
    env.reset(seed=0)

    def drive():
        env.reset()  # in the kept scene
        for _ in range(3):
            env.step(LEFT)
        env.reset()
        return tracemalloc.get_traced_memory()[0]

    drive()
    tracemalloc.start()
    try:
        before, after = [drive() for _ in range(5)][2::2]  # what is new in Python settles first
    finally:
        tracemalloc.stop()
    assert after - before < 10 * env.sight.left.nbytes / 2  # half an image a look


@pytest.mark.parametrize("measured", [0.0, 0.5, 1.0])
def test_the_speed_that_is_seen_is_that_of_the_odometry(on_course, make_scene, make_course, measured):
    course = make_course(make_scene(lambda x, y: np.tan(np.deg2rad(14)) * x))
    env = on_course(course, slip=SlipConfig("sand", measured))
    for _ in range(3):
        before = env.believed_pose[:2, 3]
        seen, *_, info = env.step(AHEAD)
    counted = np.hypot(*(env.believed_pose[:2, 3] - before)) / STEP_SECONDS
    assert info["slip"] > 0.2 and seen["state"][2] == pytest.approx(counted, abs=0.005)
    true = env.vehicle.state().velocity[0]
    assert (seen["state"][2] > true + 0.02) == (measured < 1)


def test_a_step_after_the_end_warns(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(), start=(-0.5, 0.0, 0.0), goal=(1.0, 0.0)))
    env.step(AHEAD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert env.step(AHEAD)[2]
    with pytest.warns(UserWarning, match=r"step was called after the episode ended \(goal\): call reset first"):
        env.step(AHEAD)


# ------------------------------------------------------------------------------------- rewards


def test_progress_is_rewarded_and_the_goal_ends_it(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(), start=(-1.0, 0.0, 0.0), goal=(1.0, 0.0)))
    _, reward, terminated, truncated, info = env.step(AHEAD)
    assert reward == pytest.approx(0.4 - 0.01, abs=0.02)
    assert (terminated, truncated, info["outcome"], info["is_success"]) == (False, False, "driving", False)
    assert env.step(-AHEAD)[1] == pytest.approx(-0.4 - 0.01, abs=0.02)
    for _ in range(2):
        env.step(AHEAD)
    _, reward, terminated, truncated, info = env.step(AHEAD)
    assert (terminated, truncated, info["outcome"], info["is_success"]) == (True, False, "goal", True)
    assert reward == pytest.approx(10 + 0.4 - 0.01, abs=0.02)
    assert info["distance"] <= 1 and info["shortest"] == pytest.approx(2.0, abs=0.06)
    assert info["path_length"] == pytest.approx(5 * 0.4, abs=0.01)


# ------------------------------------------------------------------------------------- the depth that is seen


def test_one_near_pixel_survives():
    depth = np.full((128, 128), 9.0, np.float32)
    depth[77, 30] = 1.5
    small = nearest_depth(depth, 64)
    assert small[38, 15] == 1.5 and (small == 9).sum() == 64 * 64 - 1 and small.dtype == np.float32


def test_unknown_sky_and_far():
    depth = np.full((4, 4), np.nan)
    depth[0, 0], depth[0, 1] = 3.0, np.inf  # known beside unknown
    depth[0, 2] = np.inf  # sky
    depth[2:, :2] = 40.0
    np.testing.assert_array_equal(nearest_depth(depth, 2), [[3, 15], [15, 0]])


@pytest.mark.parametrize("bad", [0.0, -2.0, -np.inf])
def test_depth_that_cannot_be_is_unknown(bad):
    depth = np.full((4, 4), bad)
    depth[0, 0] = 6.0
    np.testing.assert_array_equal(nearest_depth(depth, 2), [[6, 0], [0, 0]])


@pytest.mark.parametrize("shape", [(100, 128), (128, 100), (32, 32)])
def test_sizes_that_do_not_divide_are_refused(shape):
    with pytest.raises(ValueError, match=str(shape[0])):
        nearest_depth(np.ones(shape), 64)


@given(arrays(np.float32, (6, 9), elements=st.floats(allow_nan=True, allow_infinity=True, width=32)))
def test_any_depth_is_in_the_space(depth):
    small = nearest_depth(depth, 3)
    assert ((small >= 0) & (small <= 15)).all()


def test_true_depth_is_of_the_scene(on_course, make_scene, make_course):
    """On level ground each row's depth follows from the camera's height and pitch."""
    scene = make_scene()
    smooth = replace(scene, look=replace(scene.look, texture_strength=0.0, pebbles=0.0))
    env = on_course(make_course(smooth), eyes=EyesConfig())
    depth, rig, mount = env.sight.depth, env.sight.rig, env.rover_spec.mount
    row = 120
    down = np.arctan((row + 0.5 - rig.camera.height / 2) / rig.camera.fy) + mount.pitch
    ray = mount.height / np.sin(down)
    np.testing.assert_allclose(depth[row], ray * np.cos(down - mount.pitch), rtol=1e-3)
