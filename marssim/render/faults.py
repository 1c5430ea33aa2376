"""Named sets of image faults, from which a command's sensor starts."""

from __future__ import annotations

from typing import Literal, get_args

from marssim.render.sensor import SensorConfig
from marssim.scene.viewpoint import ViewConfig

FaultSet = Literal["none", "random", "public"]
FAULT_SETS: tuple[FaultSet, ...] = get_args(FaultSet)

RANDOM = SensorConfig(
    horizontal_offset=(-0.5, 0.5),
    dust=(0.03, 0.5),
    motion_blur=(0.5, 5.0),
    glare=(0.02, 0.3),
    overexposure=(-2.0, 1.2),
    bleeding=(0.1, 1.0),
    smear=(0.01, 0.15),
    hot_pixels=(100.0, 3000.0),
    stretch=(0.001, 0.02),
    stretch_alone=(0.0, 1.0),
    jpeg_quality=(35.0, 95.0),
    fault_chance=(0.0, 0.7),
)
PUBLIC = SensorConfig(
    dust=(0.03, 0.12),
    glare=(0.02, 0.08),
    hot_pixels=(200.0, 1500.0),
    stretch=(0.004, 0.01),
    stretch_alone=(1.0, 1.0),
    jpeg_quality=(75.0, 92.0),
)


RANDOM_VIEW = ViewConfig(rover=(0.0, 0.6))


def fault_view(name: FaultSet) -> ViewConfig:
    """Return the ranges of the views that go with a set: with "random", some have the rover itself in view."""
    return RANDOM_VIEW if name == "random" else ViewConfig()


def fault_set(name: FaultSet) -> SensorConfig:
    """Return the detectors' ranges of a set.

    Args:
        name: "none", the defaults of SensorConfig, or "random": each pair has each fault but sun_glare with a chance
            that is drawn for the pair, 0 to 0.7, and with a strength from weak to strong. Training on it makes a
            network used to such images. "public": every pair has what the raw images of rovers on the web have: some
            dust, glare and hot pixels, a contrast stretch of each image alone, and JPEG.

    Raises:
        ValueError: There is no set of that name.
    """
    sets = {"none": SensorConfig(), "random": RANDOM, "public": PUBLIC}
    if name not in sets:
        raise ValueError(f"faults must be one of {', '.join(FAULT_SETS)}, got {name!r}")
    return sets[name]
