"""Measures how far a pixel of the ground is from the mean of 16 finer ones: a table of docs/results/look.md.

Run it in the folder of the repository:

    python docs/measure_aliasing.py
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
import tyro

from marssim.base.camera import NATECAM
from marssim.base.dataset.frame import GROUND, StereoFrame
from marssim.inspection.image_statistics import linear
from marssim.render.sensor import Sensor
from marssim.render.view import SceneRenderer
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene
from marssim.scene.viewpoint import ViewConfig, draw_pose

FINER = 4  # pixels along a side that stand for one
DISTANCES = (1, 2, 4, 8, 16, 40)  # [m] borders of the intervals
SUNLIT = 0.5  # of the median: least brightness of ground that counts as sunlit, so that no border of a shadow counts
VIEW = ViewConfig(pitch_deg=(15.0, 15.0), roll_deg=(0.0, 0.0))
CLEAN = Sensor(exposure=0.5, psf=0.0, full_well=1e9, read_noise=0.0, vignetting=0.0)


@dataclass(frozen=True)
class Options:
    """Measures how far a pixel of the ground is from the mean of finer ones, by distance."""

    places: tuple[str, ...] = ("utopia", "gale", "jezero", "gravel")
    """Presets."""
    scenes: int = 3
    """Number of scenes of each."""


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    for place in options.places:
        square = np.mean([_square(place, seed) for seed in range(options.scenes)], axis=0)
        print(f"{place:8s}", *(f"{100 * value:5.1f} %" for value in np.sqrt(square)), flush=True)


def _square(place: str, seed: int) -> np.ndarray:
    """Return the mean square of the difference of logarithms in each interval of distance."""
    look = replace(preset(place).look, texture_strength=(1.0, 1.0), albedo_contrast=(1.0, 1.0))
    scene = build_scene(preset(place, look=replace(look, sun_elevation_deg=(30.0, 30.0))), seed)
    pose = draw_pose(scene, VIEW, np.random.default_rng(seed))
    frames = []
    for scale in (1, FINER):
        size = scale * NATECAM.camera.width
        with SceneRenderer(scene, rig=NATECAM.resized(size, size)) as renderer:
            frames.append(renderer.render_from(pose, CLEAN))
    coarse, fine = frames
    light, samples = _light(coarse), _light(fine)
    mean = cv2.resize(samples, light.shape[::-1], interpolation=cv2.INTER_AREA)
    darkest = cv2.erode(samples, np.ones((FINER, FINER), np.uint8), anchor=(0, 0))[::FINER, ::FINER]
    whole = (
        cv2.resize((fine.surface == GROUND).astype(np.float32), light.shape[::-1], interpolation=cv2.INTER_AREA) == 1
    )
    counts = (coarse.surface == GROUND) & whole
    counts &= np.minimum(light, darkest) > SUNLIT * np.median(mean[counts])
    change = np.log(np.maximum(light, 1e-6) / np.maximum(mean, 1e-6))
    change -= np.median(change[counts])  # the exposures differ
    interval = np.digitize(coarse.depth, DISTANCES) - 1
    return np.array([np.mean(change[counts & (interval == n)] ** 2) for n in range(len(DISTANCES) - 1)])


def _light(frame: StereoFrame) -> np.ndarray:
    return linear(cv2.cvtColor(frame.left, cv2.COLOR_RGB2GRAY))


if __name__ == "__main__":
    main(tyro.cli(Options))
