"""Does MarsNav-v0 last? Resets and kinematic steps with random actions, under conditions and slip drawn at random.

    python tests/benchmarks/soak_envs.py --resets 1000 --steps 100000
    python tests/benchmarks/soak_envs.py --resets 200 --steps 5000 --perception sgbm --pixels 64

Fails on a crash, on an observation outside its space, on a reward that is not finite, and if the resident memory at the
end is more than 10 % above that after the warm-up (a fifth of the resets). Scenes differ in size by condition, so
memory is the median of the last tenth of the resets until then.
"""

import argparse
import os
import sys
from statistics import median
from time import perf_counter

import numpy as np

from envs.mars_nav import MarsNavEnv
from envs.suites.conditions import CONDITIONS
from envs.world.eyes import EyesConfig
from marssim.physics.soil.soil_map import GROUND_NAMES

MOST_GROWTH = 0.10


def resident() -> float:
    """[MB]; Linux only."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--resets", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--perception", default="ground_truth")
    parser.add_argument("--pixels", type=int, default=512, help="width of the images that a perception sees [px]")
    asked = parser.parse_args()
    env = MarsNavEnv(
        asked.perception, "kinematic", mast=True, map_observation=True, eyes=EyesConfig(image_pixels=asked.pixels),
        condition=tuple(CONDITIONS), slip=(None, *GROUND_NAMES), k=(0.0, 0.2), slope_deg=(0.0, 10.0),
    )  # fmt: skip
    rng, start = np.random.default_rng(0), perf_counter()
    resets = steps = 0
    memory: list[float] = []
    ends: dict[str, int] = {}
    drawn: set[tuple[object, object]] = set()
    while resets < asked.resets or steps < asked.steps:
        observation, _ = env.reset(seed=None if resets else 0)  # later ones draw on, as those of vectors do
        resets += 1
        assert env.settings is not None
        drawn.add((env.settings.condition, env.settings.slip and env.settings.slip.ground))
        # episodes as long as it takes for both counts to end together
        left = max(1, round((asked.steps - steps) / max(asked.resets - resets + 1, 1)))
        for _ in range(left):
            if observation not in env.observation_space:
                raise ValueError(f"reset {resets}, step {steps}: an observation outside its space")
            observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 3).astype(np.float32))
            steps += 1
            if not np.isfinite(reward):
                raise ValueError(f"reset {resets}, step {steps}: reward {reward}")
            if terminated or truncated:
                break
        ends[info["outcome"]] = ends.get(info["outcome"], 0) + 1
        memory.append(resident())
        if resets % 50 == 0:
            print(f"{resets} resets, {steps} steps, {memory[-1]:.0f} MB, {perf_counter() - start:.0f} s", flush=True)
    env.close()
    tenth = max(1, len(memory) // 10)
    warm, last = median(memory[tenth : 2 * tenth]), median(memory[-tenth:])
    grown = last / warm - 1
    print(f"{resets} resets, {steps} steps, {len(drawn)} pairs of condition and slip: {ends}")
    print(f"memory {warm:.0f} MB after the warm-up, {last:.0f} MB at the end, {100 * grown:+.1f} %")
    return int(grown > MOST_GROWTH)


if __name__ == "__main__":
    sys.exit(main())
