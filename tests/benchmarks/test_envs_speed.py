from collections import defaultdict
from time import perf_counter, process_time

import gymnasium
import numpy as np
import pytest

from envs.drivers.builtin import NavigatorDriver
from envs.mars_nav import MarsNavEnv
from m3depth.runtimes.choice import openvino_is_installed

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


@pytest.mark.parametrize("with_map", [False, True])
def test_resets_in_new_and_in_kept_scenes(capsys, with_map):
    """Processor time, medians: of resets with a seed, which make a new scene, of others in it, and of steps."""
    env = MarsNavEnv(
        "ground_truth", "kinematic", map_observation=with_map, goal_distance=10, k=(0.1, 0.2), episodes_per_scene=8
    )
    env.reset(seed=0)
    action, spent = np.array([0.3, 0.1], np.float32), defaultdict(list)

    def timed(name, call):
        start = process_time()
        call()
        spent[name].append(process_time() - start)

    for seed in range(1, 9):
        timed("new scene", lambda seed=seed: env.reset(seed=seed))
        for _ in range(3):
            timed("kept scene", env.reset)
            for _ in range(6):
                timed("step", lambda: env.step(action))
    env.close()
    with capsys.disabled():
        print(f"\nmap_observation={with_map}:", *(f"{name} {np.median(t):.3f} s" for name, t in spent.items()), end="")
    assert np.median(spent["kept scene"]) < np.median(spent["new scene"])


@pytest.mark.parametrize("runtime", ["pytorch", "openvino"])
def test_step_and_navigator_cycle_with_m3depth_and_physics(clock, runtime, monkeypatch):
    if runtime == "openvino" and not openvino_is_installed():
        pytest.skip("needs the extra fast")
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: runtime == "openvino")
    env = MarsNavEnv("m3depth", "physics", mast=True, runtime=runtime)
    observation, _ = env.reset(seed=1)
    driver = NavigatorDriver()
    driver.reset(env, 0)
    action = np.array([0.2, 0.1, 0.0], dtype=np.float32)
    clock(f"step, M3Depth in {runtime}, physics, Embree", lambda: env.step(action), 5)
    assert clock("navigator cycle, 512 x 512 depth", lambda: driver.act(env, observation), 10) > 0
    env.close()


def test_two_workers_of_make_vec_against_one(capsys):
    """Steps a second of an asynchronous vector of one and of two environments; the best of three runs each."""
    rates = []
    for count in (1, 2):
        vector = gymnasium.make_vec(
            "envs:MarsNav-v0",
            num_envs=count,
            vectorization_mode="async",
            perception="ground_truth",
            dynamics="kinematic",
        )
        vector.reset(seed=1)
        actions, best = np.zeros((count, 2), np.float32), np.inf
        for _ in range(3):
            start = perf_counter()
            for _ in range(40):
                vector.step(actions)
            best = min(best, perf_counter() - start)
        vector.close()
        rates.append(40 * count / best)
    with capsys.disabled():
        print(f"\nmake_vec, kinematic: {rates[0]:.0f} steps/s with one, {rates[1]:.0f} with two workers "
              f"({rates[1] / rates[0]:.2f} times)", end="")  # fmt: skip
    assert rates[1] > rates[0]
