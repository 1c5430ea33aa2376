import numpy as np
import pytest

from envs.world.eyes import EyesConfig
from envs.world.gaze import Gaze
from envs.world.perception import Sight
from marssim.base.camera import NATECAM
from marssim.base.rover_spec import ZHURONG
from marssim.physics.state import RoverState


class Camera:
    rig = NATECAM

    def __init__(self):
        self.pans = []

    def look(self, pose, pan):
        self.pans.append(pan)
        depth = np.full((4, 4), 5.0, np.float32)
        return Sight(depth, np.ones_like(depth), NATECAM, pose, pan)


@pytest.fixture
def state():
    return RoverState(np.zeros(3), np.eye(4), 0.0, 0.0, 0.0, np.zeros(3), 0.0)


def looks_after(ways, state, every):
    camera = Camera()
    gaze = Gaze(camera, ZHURONG, every)
    gaze.begin(state)
    fresh = []
    for way in ways:
        gaze.after_step(state, way, stands=way == 0)
        fresh.append(gaze.fresh)
    assert len(camera.pans) == 1 + sum(fresh)
    return fresh


def test_without_a_distance_every_step_ends_with_a_look(state):
    assert looks_after([0.4, 0.1, 0.0], state, 0.0) == [True, True, True]


def test_the_rover_looks_after_the_way_and_whenever_it_stands(state):
    assert looks_after([0.4, 0.4, 0.4, 0.4, 0.0, 0.4], state, 1.0) == [False, False, True, False, True, False]


def test_between_looks_the_observed_depth_is_unknown(state):
    gaze = Gaze(Camera(), ZHURONG, 1.0)
    gaze.begin(state)
    assert (gaze.observed() == 5).all()
    gaze.after_step(state, 0.4, stands=False)
    assert np.isnan(gaze.observed()).all() and gaze.sight is not None


def test_the_mast_turns_no_further_than_there_is_time(state):
    gaze = Gaze(Camera(), ZHURONG)
    gaze.turn_mast(1.0, 1.0)
    assert gaze.pan == pytest.approx(ZHURONG.mount.pan_rate)
    gaze.begin(state)
    assert gaze.pan == 0


def test_an_environment_that_looks_rarely_tells_when_it_looked(make_env):
    env = make_env(eyes=EyesConfig(look_every=1.0), map_observation=True)
    observation, info = env.reset(seed=1)
    assert info["looked"] and observation["depth"].any()
    for step, looked in enumerate([False, False, True]):
        observation, _, terminated, _, info = env.step(np.array([1, 0], np.float32))
        assert not terminated and info["looked"] == looked, step
        assert observation["depth"].any() == looked and observation["map"][2].any()
        assert observation in env.observation_space
    always = make_env()
    assert always.reset(seed=1)[1]["looked"] and always.step(np.array([1, 0], np.float32))[4]["looked"]
