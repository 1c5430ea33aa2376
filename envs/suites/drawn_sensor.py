"""The rig and the lenses that an episode drew, as a suite records them for each episode."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from envs.world.eyes import EyesConfig
from envs.world.perception import rng_of_perception
from marssim.render.sensor import ABSENT, ALWAYS, FAULTS, Sensor

DIGITS = 6  # to which values are rounded
SAME_SENSOR = 1e-4  # relative difference of values that count as the same
SMALLEST = 1e-6  # absolute difference that counts as none

SensorValues = Mapping[str, float]


def draw_sensor(eyes: EyesConfig, seed: int) -> Sensor:
    """Return the detectors that an episode of MarsNav-v0 draws.

    Args:
        eyes: The cameras under the episode's condition.
        seed: Seed of the episode, which is also that of its scene.
    """
    return Sensor.draw(eyes.sensor(), rng_of_perception(np.random.default_rng(seed)))


def sensor_values(sensor: Sensor) -> dict[str, float]:
    """Return the values of a Sensor by its names, rounded, and the seed of specks and hot pixels.

    Values of the faults that are absent are left out.
    """
    present = [name for name in (*ALWAYS, *FAULTS) if getattr(sensor, name) != ABSENT.get(name)]
    values = {name: float(f"{getattr(sensor, name):.{DIGITS}g}") for name in present}
    return {**values, "seed": sensor.seed}


def same_sensor(one: SensorValues, other: SensorValues) -> bool:
    """Return whether two records of sensor_values are of the same detectors."""
    return (
        one.keys() == other.keys()
        and one["seed"] == other["seed"]
        and all(math.isclose(one[name], other[name], rel_tol=SAME_SENSOR, abs_tol=SMALLEST) for name in one)
    )
