"""Does MarsNav-v0 last? Resets and kinematic steps with random actions; minutes to half an hour.

    python tests/benchmarks/soak_envs.py --resets 1000 --steps 100000

Fails on a crash, on an observation outside its space, on a reward that is not finite, and if the resident memory at the
end is more than 10 % above that after the warm-up (a tenth of the resets).
"""

import argparse
import os
import sys
from time import perf_counter

import numpy as np

from envs.mars_nav import MarsNavEnv


def resident() -> float:
    """[MB]; Linux only."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--resets", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--scene", default="gale")
    asked = parser.parse_args()
    env = MarsNavEnv("ground_truth", "kinematic", scene=asked.scene, mast=True, map_observation=True)
    rng, start = np.random.default_rng(0), perf_counter()
    resets = steps = 0
    warm, ends = None, {}
    while resets < asked.resets or steps < asked.steps:
        observation, _ = env.reset(seed=resets, options={"k": float(rng.uniform(0, 0.2))})
        resets += 1
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
        if warm is None and resets >= asked.resets / 10:
            warm = resident()
        if resets % 50 == 0:
            print(f"{resets} resets, {steps} steps, {resident():.0f} MB, {perf_counter() - start:.0f} s", flush=True)
    env.close()
    grown = resident() / warm - 1
    print(f"{resets} resets, {steps} steps: {ends}")
    print(f"memory {warm:.0f} MB after the warm-up, {100 * grown:+.1f} % at the end")
    return int(grown > 0.10)


if __name__ == "__main__":
    sys.exit(main())
