import numpy as np
import pytest

from envs.drivers import NavigatorDriver
from envs.mars_nav import MarsNavEnv

pytestmark = pytest.mark.benchmark


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_reset_and_step_with_ground_truth(clock, dynamics):
    env = MarsNavEnv("ground_truth", dynamics)
    seed = iter(range(1000))
    clock(f"reset, ground truth, {dynamics}", lambda: env.reset(seed=next(seed)), 3)
    env.reset(seed=1)
    action = np.array([0.2, 0.1], dtype=np.float32)
    assert clock(f"step, ground truth, {dynamics}", lambda: env.step(action), 10) > 0
    env.close()


def test_step_and_navigator_cycle_with_m3depth_and_physics(clock):
    env = MarsNavEnv("m3depth", "physics", mast=True)
    observation, _ = env.reset(seed=1)
    driver = NavigatorDriver()
    driver.reset(env, 0)
    action = np.array([0.2, 0.1, 0.0], dtype=np.float32)
    clock("step, M3Depth, physics, Embree", lambda: env.step(action), 5)
    assert clock("navigator cycle, 512 x 512 depth", lambda: driver.act(env, observation), 10) > 0
    env.close()
