from contextlib import nullcontext
from decimal import Decimal
from fractions import Fraction
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from envs.drivers.builtin import NavigatorDriver, StraightDriver
from envs.drivers.driver import Stop
from envs.drives.episodes import Cell, _check_condition, course_options, run_episode
from envs.world.action import ActionError, checked_action
from envs.world.eyes import EyesConfig
from envs.world.user_code import UserCodeError
from m3depth.evaluation.scores import ScoredPair, Scores
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import NATECAM
from marssim.base.command.run import MISTAKES


class Standing:
    """A driver that lets the time run out."""

    def reset(self, env, seed):
        self.seed = seed

    def act(self, env, observation):
        return np.zeros(3, np.float32)


class Wavering(Standing):
    """A driver that gives up after two steps."""

    steps = 0

    def act(self, env, observation):
        self.steps += 1
        return super().act(env, observation) if self.steps <= 2 else Stop.NO_PATH


@pytest.fixture(scope="module")
def env(small_scene):
    from envs.mars_nav import MarsNavEnv

    env = MarsNavEnv("ground_truth", "kinematic", scene=small_scene, goal_distance=3.0, mast=True)
    yield env
    env.close()


def test_the_record_tells_the_drive(env):
    seen = []
    driver = StraightDriver()
    record = run_episode(
        env, driver, Cell(), 5, 2, ("straight", "truth"), lambda e, d, step: seen.append((e is env, d is driver, step))
    )
    assert (record.driver, record.perception, record.cell) == ("straight", "truth", Cell().name)
    assert record.episode == 2 and record.outcome == env.outcome != "driving"
    assert seen == [(True, True, step) for step in range(record.steps + 1)]
    track = np.array(record.track)
    assert track.shape == (record.steps + 1, 2)
    np.testing.assert_allclose(track[0], env.course.start[:2])
    assert len(record.headings) == len(track)
    assert np.exp(1j * record.headings[0]) == pytest.approx(np.exp(1j * env.course.start[2]), abs=1e-3)
    way = np.array(record.shortest_path)
    assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(record.shortest, abs=0.05)
    relief, scene = np.array(record.relief), env.course.scene
    assert record.half == scene.half and relief.shape == (round(2 * scene.half) + 1,) * 2
    assert relief[0, -1] == pytest.approx(scene.terrain.height_at(scene.half, -scene.half), abs=0.006)
    assert record.path_length == pytest.approx(np.hypot(*np.diff(track, axis=0).T).sum())
    assert record.distance == pytest.approx(np.hypot(*(np.array(record.goal) - track[-1])))
    assert record.start_distance == pytest.approx(3.0) and record.shortest == env.course.shortest >= 3.0
    assert record.step_seconds > 0 and record.max_tilt_deg < 30 and record.min_clearance > 0


def test_the_state_of_the_code_is_that_before_the_drive(env, monkeypatch):
    """Who edits the sources meanwhile does not change what drives."""
    state = ["before"]
    monkeypatch.setattr("envs.drives.episodes.code_digest", lambda: state[0])
    record = run_episode(env, StraightDriver(), Cell(), 5, 2, watch=lambda *_: state.__setitem__(0, "edited"))
    assert record.code == "before" and state == ["edited"]


def test_the_course_follows_from_seed_and_episode_alone(env):
    def goal(seed, episode, cell=None, driver=None):
        record = run_episode(env, driver or StraightDriver(), cell or Cell(), seed, episode)
        return tuple(record.goal), record.track

    first = goal(1, 0)
    assert goal(1, 1)[0] != first[0] != goal(2, 0)[0]
    assert goal(1, 0) == first


def test_frozen_courses_stay_what_they_are():
    """Of figures that were published: numpy keeps what a SeedSequence makes of its entropy."""
    assert course_options(Cell(), 5, 2) == {"scene_seed": 3226123765}
    assert course_options(Cell(0.0, 10.0), 5, 2) == {"scene_seed": 3226123765, "k": 0.0, "slope_deg": 10.0}


def test_a_cell_sets_rocks_and_slope(env):
    record = run_episode(env, Standing(), Cell(k=0.0, slope_deg=12.0), 1, 0)
    assert len(env.course.scene.rocks) == 0
    assert env.course.scene.config.relief.regional_slope_deg == 12.0
    assert record.cell == "k=0, slope=12"
    assert record.outcome == "time" and record.steps == 45 and record.path_length < 1e-6
    assert record.reward == pytest.approx(-0.45)


def test_the_slip_of_a_drive_is_that_of_the_steps_in_which_it_was_to_drive(env, monkeypatch):
    class HalfStanding(Standing):
        steps = 0

        def act(self, env, observation):
            self.steps += 1
            return np.float32([self.steps % 2, 0, 0]) if self.steps <= 6 else Stop.NO_PATH

    step = env.step
    slips = iter([0.2, 0.0, 0.4, 0.0, 0.6, 0.0])

    def slipping(action):
        *rest, info = step(action)
        return *rest, {**info, "slip": next(slips)}

    monkeypatch.setattr(env, "step", slipping)
    assert run_episode(env, HalfStanding(), Cell(), 5, 0).slip == pytest.approx(0.4)


def test_names_of_cells():
    assert Cell().name == "k=preset, slope=preset" and Cell(0.05, 10.0).name == "k=0.05, slope=10"


def test_a_driver_that_gives_up_ends_the_episode(env):
    record = run_episode(env, Wavering(), Cell(), 5, 0)
    assert (record.outcome, record.steps, len(record.track)) == ("no_path", 2, 3)


def test_the_times_of_a_drive_are_those_of_a_step_and_every_look_counts(make_env, monkeypatch):
    env = make_env(goal_distance=3.0, mast=True)
    step = env.step

    def timed(action):
        *rest, info = step(action)
        return *rest, {**info, "perception_seconds": 0.2}

    monkeypatch.setattr(env, "step", timed)
    monkeypatch.setattr("envs.drives.episodes.perf_counter", count(0, 0.5).__next__)
    record = run_episode(env, Wavering(), Cell(k=0.0), 5, 0)
    assert (record.steps, record.looks, record.blind) == (2, 3, 0)
    assert record.step_seconds == pytest.approx(0.5) and record.perception_seconds == pytest.approx(0.2)


def test_a_driver_may_give_up_at_once(env):
    class Quitter(Standing):
        def act(self, env, observation):
            return Stop.NO_PATH

    record = run_episode(env, Quitter(), Cell(), 5, 0)
    assert (record.outcome, record.steps, record.step_seconds) == ("no_path", 0, 0.0)


@pytest.mark.parametrize("driver", [NavigatorDriver, StraightDriver])
def test_a_driver_led_astray_by_its_odometry_ends_elsewhere_and_at_once(on_course, make_scene, make_course, driver):
    """Its odometry says 1.2 m too much to the left: it stops as far to the right of the goal."""
    env = on_course(make_course(make_scene(), start=(-3.0, 0.0, 0.0), goal=(3.0, 0.0)), mast=True)

    class Astray:
        drift = yaw_drift = 0.0

        def update(self, pose, slipped=None):
            believed = pose.copy()
            believed[1, 3] += 1.2
            return believed

    reset = env.reset

    def astray(**options):
        reset(**options)
        env._odometry = Astray()
        env.believed_pose = env._odometry.update(env.vehicle.state().pose)
        return env._observation(), env._info()

    env.reset = astray
    record = run_episode(env, driver(), Cell(), 0, 0)
    assert record.outcome == "elsewhere" and record.steps < 25
    assert 1.0 < record.distance < 1.8


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (np.array([0.5, 0.25, 0], object), (0.5, 0.25, 0)), ([10**20, -1, True], (1, -1, 1)),
        (np.ma.array([1, 0, 0], mask=False), (1, 0, 0)), (torch.tensor([0.5, 0, 0]), (0.5, 0, 0)),
        ([Decimal("0.5"), Fraction(1, 4), 0], (0.5, 0.25, 0)),
    ],
)  # fmt: skip
def test_numbers_of_any_type_are_an_action(answer, expected):
    np.testing.assert_array_equal(checked_action(answer, (3,)), np.array(expected, np.float32))


class Unreadable:
    def __array__(self, *args, **kwargs):
        raise RuntimeError("no array here\nfor two reasons")

    def __repr__(self):
        raise RuntimeError("no text here")


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, r"action must be of shape \(3,\), got None$"),
        ([1.0, 0.0], r"action must be of shape \(3,\), got \[1\.0, 0\.0\]$"),
        (
            "left",
            r"action must be numbers of shape \(3,\), got 'left': its numbers are of type <U4$",
        ),
        ([np.nan, 0.0, 0.0], r"action must be finite, got \[nan, 0\.0, 0\.0\]$"),
        (
            ["1", "0", "0"],
            r"action must be numbers .*, got \['1', '0', '0'\]: its numbers are of type <U1$",
        ),
        (
            [1j, 0, 0],
            r"action must be numbers .*, got \[1j, 0, 0\]: its numbers are of type complex128$",
        ),
        (
            np.ma.masked_invalid([np.nan, 0, 0]),
            r"action must be finite, got masked_array",
        ),
        (
            torch.ones(3, requires_grad=True),
            r"action must be numbers .* got tensor.*: Can't call numpy",
        ),
        (
            Unreadable(),
            r"action must be numbers of shape \(3,\), got Unreadable: no array here$",
        ),
    ],
)
def test_an_answer_that_is_no_action_names_driver_step_and_course(env, answer, message):
    class Mine(Standing):
        def act(self, env, observation):
            return answer

    with pytest.raises(ActionError, match=rf"^driver 'mine', step 1 of course 0, k=preset, \S+: {message}"):
        run_episode(env, Mine(), Cell(), 5, 0, ("mine", ""))


@pytest.mark.parametrize("place", ["reset", "act", "infer"])
def test_what_the_users_own_code_raises_is_reported_with_its_course_and_its_cause(make_env, place):
    """A ValueError of that code is no mistake on the command line, whose one line would hide where it is."""

    class Mine(Standing):
        def act(self, env, observation):
            if place == "act" and self.steps == 2:
                raise ValueError("cannot broadcast")
            self.steps += 1
            return super().act(env, observation)

        def reset(self, env, seed):
            if place == "reset":
                raise ValueError("cannot broadcast")
            self.steps = 0

        def infer(self, left, right, rig):
            raise ValueError("cannot broadcast")

    env = make_env(perception=Mine() if place == "infer" else "ground_truth", goal_distance=3.0, mast=True)
    step = {"reset": 0, "act": 3, "infer": 0}[place]
    message = (
        rf"^step {step} of course 4, k=0, slope=preset, by mine and sgbm: \S*:\S*Mine raised ValueError: cannot broad"
    )
    with pytest.raises(UserCodeError, match=message) as raised:
        run_episode(env, Mine(), Cell(k=0.0), 5, 4, ("mine", "sgbm"))
    assert isinstance(raised.value.__cause__, ValueError) and not isinstance(raised.value, MISTAKES)


def test_a_mistake_in_what_was_asked_for_is_still_reported_in_one_line(env, monkeypatch):
    monkeypatch.setattr("envs.courses.course.REDRAWS", 0)
    with pytest.raises(ValueError, match=r"^no goal can be reached"):
        run_episode(env, Standing(), Cell(), 5, 0)


def test_a_perception_that_sees_nothing_is_noted(make_env):
    class Blind:
        def infer(self, left, right, rig):
            nothing = np.full(left.shape[:2], np.nan, np.float32)
            return Prediction(nothing, nothing, None, np.zeros_like(nothing))

    class Ending(NavigatorDriver):
        def act(self, env, observation):
            self.looks = getattr(self, "looks", 0) + 1
            return Stop.NO_PATH if self.looks > 3 else super().act(env, observation)

    env = make_env(perception=Blind(), goal_distance=3.0, mast=True)
    record = run_episode(env, Ending(), Cell(k=0.0), 5, 0)
    assert record.blind == record.steps + 1 == 4 and record.abs_rel > 4  # 80 m for 15 m or less
    assert run_episode(make_env(goal_distance=3.0, mast=True), StraightDriver(), Cell(k=0.0), 5, 0).blind == 0


@pytest.mark.parametrize(("aside", "near"), [(1.34, True), (1.7, False)])
def test_what_happened_on_the_way_is_in_the_record(on_course, make_scene, make_course, aside, near):
    """Past a rock of 1.2 m, its side 4 cm or 40 cm from it, then up a slope of 10 deg, with depth that errs."""

    def ramp(x, y):
        return np.tan(np.deg2rad(10)) * np.maximum(0, x)

    scene = make_scene(ramp, cell=0.1, rocks=[(-1.4, aside, 1.2, 0.6)])
    env = on_course(make_course(scene, start=(-2.6, 0.0, 0.0)), disparity_noise=0.5, mast=True)
    record = run_episode(env, StraightDriver(), Cell(), 0, 0)
    assert record.outcome == "goal" and record.near_miss == near
    assert record.max_tilt_deg == pytest.approx(10, abs=1)
    assert 0 < record.abs_rel < 0.05
    assert record.obstacles == [[-1.4, aside, 1.2]]


def test_a_collision_is_no_near_miss(on_course, make_scene, make_course):
    env = on_course(make_course(make_scene(rocks=[(0.0, 0.0, 1.2, 0.9)])), mast=True)
    record = run_episode(env, StraightDriver(), Cell(), 0, 0)
    assert record.outcome == "collision" and record.min_clearance < 0.1 and not record.near_miss


def test_the_error_on_the_way_is_that_of_the_test_set(on_course, make_scene, make_course):
    """m3depth's own scores of the same looks; a third of each is unknown, and a rock stands nearer than 192 px."""

    class Halting(Standing):
        def act(self, env, observation):
            return Stop.NO_PATH if len(errors) > 2 else super().act(env, observation)

    class Squinting:
        def infer(self, left, right, rig):
            depth = np.full(left.shape[:2], 4.0, np.float32)
            depth[::3] = np.nan
            depth[1::3] = np.inf
            return Prediction(depth, rig.depth_to_disparity(depth), None, np.ones_like(depth))

    scene = make_scene(rocks=[(-1.6, 0.0, 0.6, 1.1)])
    env = on_course(make_course(scene), perception=Squinting(), mast=True, eyes=EyesConfig())
    near, errors, as_sky = [], [], []

    def look(env, driver, step):
        if env.outcome != "driving":  # the driver has stopped, and nothing new was seen
            return
        true = env.sight.true_depth
        nothing = np.zeros(true.shape, int)
        disparity = NATECAM.depth_to_disparity(true)
        known = (true >= 0.5) & (true <= 15)
        near.append((known & (disparity > 192)).sum())
        truth = SimpleNamespace(
            left=env.sight.left, depth=true, disparity=disparity, normal=np.zeros((*true.shape, 3)), valid=known,
            occluded=nothing > 0, rock=nothing, rig=NATECAM, meta={},
        )  # fmt: skip
        seen = Squinting().infer(env.sight.left, env.sight.right, NATECAM)
        scores = Scores().add(seen, ScoredPair(truth))
        errors.append(scores["abs_rel"])
        as_sky.append(scores["counts"]["sky"])

    record = run_episode(env, Halting(), Cell(), 0, 0, watch=look)
    assert len(errors) == 3 and min(near) > 100
    assert record.abs_rel == pytest.approx(np.mean(errors), rel=1e-5) and record.blind == 0
    counted = (record.near_ground, record.near_ground_as_sky)
    assert counted == tuple(sum(sky[name] for sky in as_sky) for name in ("ground", "ground_as_sky"))
    assert 0 < counted[1] < counted[0]


def test_a_condition_that_the_environment_does_not_have_is_refused(env, small_scene):
    with pytest.raises(ValueError, match=r"^cell has the condition low_sun, .*MarsNavEnv\(condition='low_sun'\)$"):
        run_episode(env, Wavering(), Cell(condition="low_sun"), 5, 0)
    with pytest.raises(ValueError, match=r"^cell has the condition lowsun, and the environment has none"):
        run_episode(env, Wavering(), Cell(condition="lowsun"), 5, 0)
    assert run_episode(env, Wavering(), Cell(condition="clear"), 5, 0).cell == "condition=clear"
    for driven, named, fits in (("low_sun", "low_sun", True), ("low_sun", "storm", False), ("low_sun", "clear", False),
                                ({"ditch": True}, "mine", True)):  # fmt: skip
        with nullcontext() if fits else pytest.raises(ValueError, match=f"has the condition {driven}; make it by"):
            _check_condition(Cell(condition=named), driven)
