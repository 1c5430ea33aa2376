import numpy as np
import pytest

from envs.drivers.builtin import NavigatorDriver
from envs.world.eyes import EyesConfig
from envs.world.perception import Perception
from envs.world.user_code import UserCodeError
from m3depth.checked_inference import EstimatorError
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.rows import row_misalignment
from marssim.base.camera import NATECAM
from marssim.base.rover_spec import ZHURONG
from marssim.render.renderers.by_name import RENDERERS

POSE = ZHURONG.mount.left_eye(NATECAM.baseline)


class Everywhere:
    """An estimator that says one depth everywhere, and remembers what it was shown."""

    def __init__(self, depth=7.0):
        self.depth = depth
        self.shown = []

    def infer(self, left, right, rig):
        self.shown.append((left, right, rig))
        flat = np.full(left.shape[:2], self.depth, np.float32)
        return Prediction(flat, rig.fb / flat, None, np.ones_like(flat))


class Blind(Everywhere):
    def __init__(self):
        super().__init__(np.nan)


@pytest.fixture
def scene(make_scene):
    return make_scene(rocks=[(4.0, 0.0, 0.8, 0.6)])


def opened(perception, scene, seed=0):
    perception.open(scene, np.random.default_rng(seed))
    return perception


def test_true_depth_is_the_same_by_every_renderer(scene):
    seen = {}
    for renderer in RENDERERS:
        perception = opened(Perception("ground_truth", renderer), scene)
        sight = perception.look(POSE, 0.0)
        perception.close()
        assert sight.depth.shape == (128, 128)
        assert sight.left is None and sight.seconds == 0 and (sight.confidence == 1).all()
        seen[renderer] = sight.depth
    for depth in seen.values():
        near = (depth < 15) & (seen["embree"] < 15)
        assert near.mean() > 0.5
        assert np.median(np.abs(depth[near] - seen["embree"][near])) < 0.01


def test_noise_is_in_pixels_of_the_full_image(scene):
    """True depth comes at a quarter of the size; 0.5 px of 512 are 0.5 px of Z = f B / d all the same."""
    clean, noisy = (
        opened(Perception("ground_truth", "embree", disparity_noise=noise), scene).look(POSE, 0.0).depth
        for noise in (0.0, 0.5)
    )
    near = clean < 8  # 20 px and more: none becomes negative
    error = NATECAM.fb / noisy[near] - NATECAM.fb / clean[near]
    assert near.sum() > 3000 and error.std() == pytest.approx(0.5, rel=0.05) and abs(error.mean()) < 0.05
    assert (noisy[np.isinf(clean)] == np.inf).all()  # the sky stays


def test_an_estimator_sees_rectified_pairs(scene):
    estimator = Everywhere()
    perception = opened(Perception(estimator, "embree"), scene)
    sight = perception.look(POSE, 0.3)
    left, right, rig = estimator.shown[0]
    assert left.shape == right.shape == (512, 512, 3) and left.dtype == np.uint8 and rig is NATECAM
    assert (sight.depth == 7).all() and sight.rig is rig and sight.pan == 0.3 and sight.seconds >= 0
    np.testing.assert_array_equal(sight.left, left)
    assert not np.array_equal(left, right) and left.std() > 5
    other = opened(Perception(Everywhere(), "embree"), scene, seed=1).look(POSE, 0.0)
    assert not np.array_equal(other.left, left)  # another detector, other noise
    again = opened(Perception(Everywhere(), "embree"), scene).look(POSE, 0.0)
    np.testing.assert_array_equal(again.left, left)


def test_rows_that_lie_apart_are_aligned_before_the_estimator_sees_them(scene):
    eyes = EyesConfig(temperature=80.0)
    fits = []
    for align in (True, False):
        estimator = Everywhere()
        sight = opened(Perception(estimator, "embree", eyes, align_rows=align), scene).look(POSE, 0.0)
        left, right, rig = estimator.shown[0]
        fits.append(row_misalignment(left, right, rig))
        assert np.array_equal(sight.right, right) != align  # films show what the cameras took
    assert fits[0].size < 0.1 and fits[1].offset == pytest.approx(
        1.12, abs=0.2
    )  # 0.014 px a K, and up to 0.15 px of any rig


def test_looking_needs_a_scene(scene):
    perception = Perception("ground_truth", "embree")
    with pytest.raises(RuntimeError, match="open"):
        perception.look(POSE, 0.0)
    opened(perception, scene).close()
    perception.close()
    with pytest.raises(RuntimeError, match="open"):
        perception.picture(POSE)


def test_an_object_or_a_class_path_is_a_perception(make_env):
    env = make_env(perception=Everywhere(6.0), goal_distance=4.0)
    observation, info = env.reset(seed=0)
    assert (observation["depth"] == 6).all() and info["perception_seconds"] > 0
    env = make_env(perception="m3depth.stereo.classical:SGBM")
    assert type(env.perception.estimator).__name__ == "SGBM"


class Halved(Everywhere):
    """Works at half the size, and leaves it at that."""

    def infer(self, left, right, rig):
        return super().infer(left[::2, ::2], right[::2, ::2], rig)


class BareDepth(Everywhere):
    def infer(self, left, right, rig):
        return super().infer(left, right, rig).depth


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (Halved(), r"^Halved\.infer returned depth of shape \(32, 32\): it must be \(64, 64\) here$"),
        (BareDepth(), r"^BareDepth\.infer returned an array of shape \(64, 64\): it must be a Prediction"),
    ],
)
def test_what_is_no_prediction_is_named_at_the_first_look(make_env, estimator, message):
    with pytest.raises(EstimatorError, match=message):
        make_env(perception=estimator, goal_distance=4.0).reset(seed=0)


def test_sgbm_sees_enough_to_drive(make_env):
    env = make_env(perception="sgbm", goal_distance=4.0, eyes=EyesConfig())
    observation, _ = env.reset(seed=0)
    for _ in range(2):
        assert observation in env.observation_space
        truth = env.sight.true_depth
        near = (truth > 2) & (truth < 6) & np.isfinite(env.sight.depth)
        assert near.sum() > 1000
        assert np.median(np.abs(env.sight.depth - truth)[near] / truth[near]) < 0.05
        observation, _, terminated, _, info = env.step(np.array([0.5, 0.0]))
        assert not terminated and info["perception_seconds"] > 0


def test_the_blind_navigator_stands(make_env):
    env = make_env(perception=Blind(), goal_distance=4.0, mast=True)
    driver = NavigatorDriver()
    observation, _ = env.reset(seed=0)
    driver.reset(env, 0)
    for _ in range(2):
        assert (observation["depth"] == 0).all()
        action = driver.act(env, observation)
        np.testing.assert_array_equal(action, 0)
        observation, *_, info = env.step(action)
    assert info["path_length"] == 0


def test_an_estimator_forgets_the_last_drive_where_it_can(scene):
    class Remembering(Everywhere):
        def begin_drive(self):
            self.shown.clear()

    perception = Perception(Remembering(), "embree", EyesConfig(image_pixels=64))
    for _ in range(2):
        opened(perception, scene).look(POSE, 0.0)
        assert len(perception.estimator.shown) == 1

    class Failing(Everywhere):
        def begin_drive(self):
            raise OSError("no memory of it")

    with pytest.raises(UserCodeError, match="Failing raised OSError: no memory of it"):
        opened(Perception(Failing(), "embree"), scene)
