"""Measures how far the ground truth is the surface that the images show, by place: the table of docs/results/scene.md.

Run it in the folder of the repository:

    python docs/measure_relief.py --scenes 4 --pixels 512
    python docs/measure_relief.py --scenes 2 --pixels 2048
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
import tyro

from marssim.base.camera import NATECAM, StereoRig
from marssim.base.dataset.frame import GROUND, StereoFrame
from marssim.base.pose import rotate
from marssim.inspection.tilted_planes import BARE
from marssim.render.sensor import Sensor
from marssim.render.view import SceneRenderer
from marssim.scene.look import draw_look
from marssim.scene.presets import PRESETS, preset
from marssim.scene.scene import Scene, build_scene
from marssim.scene.viewpoint import ViewConfig, draw_pose

NEAR = 5.0  # [m] farthest ground whose normals and images are compared
NEAREST = 3.0  # [m] farthest ground whose heights are compared
WINDOW = 15  # [px] window over which heights are compared with their mean
SHARP = Sensor(exposure=0.5, psf=0.45, full_well=1e9, read_noise=0.0, vignetting=0.0)  # no noise


@dataclass(frozen=True)
class Options:
    """Measures, for each place, how far the ground truth is the surface that the images show."""

    scenes: int = 4
    """Number of scenes of each place, with one view each."""
    pixels: int = 512
    """Width and height of the images [px]."""
    seed: int = 1000
    """Seed of the first scene."""


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    rig = NATECAM.resized(options.pixels, options.pixels)
    print("place     normals [deg]  residual  without relief  relief left over [mm]: truth, height field")
    everything = []
    for place in PRESETS:
        rows = []
        for seed in range(options.seed, options.seed + options.scenes):
            scene = build_scene(preset(place), seed)
            rows.append(_measured(scene, rig, np.random.default_rng(seed)))
        mean = np.mean(rows, axis=0)
        everything.append(mean)
        print(f"{place:9s} {mean[0]:13.2f} {mean[1]:9.3f} {mean[2]:15.3f} {mean[3]:12.2f} {mean[4]:10.2f}", flush=True)
    mean = np.mean(everything, axis=0)
    print(f"{'all':9s} {mean[0]:13.2f} {mean[1]:9.3f} {mean[2]:15.3f} {mean[3]:12.2f} {mean[4]:10.2f}")


def _measured(scene: Scene, rig: StereoRig, rng: np.random.Generator) -> tuple[float, ...]:
    """Return the angle between fitted and true normals [deg], the residual of the images with the true disparity and
    with that of the smooth ground [codes], and the heights left over in the truth and in the height field [mm]."""
    pose = draw_pose(scene, ViewConfig(), rng)
    with SceneRenderer(scene, rig=rig) as renderer:
        frame = renderer.render_from(pose, SHARP)
    bare = replace(scene, look=replace(draw_look(BARE, rng), sun=scene.look.sun))
    with SceneRenderer(bare, rig=rig) as renderer:
        smooth = renderer.render_from(pose, SHARP)
    ground = (frame.surface == GROUND) & (frame.depth < NEAR) & _inside(frame)
    angle = np.rad2deg(np.arccos(np.clip(np.sum(fitted_normals(frame) * frame.normal, axis=-1), -1, 1)))
    both = ground & (smooth.surface == GROUND) & ~frame.occluded & _far_from_edges(frame)
    residual = [float(np.abs(_difference(frame, each.disparity))[both].mean()) for each in (frame, smooth)]
    near = ground & (frame.depth < NEAREST)
    downward = -rotate(rig.camera.rays(), pose[:3, :3])[..., 2]
    depth = np.where(frame.surface == GROUND, frame.depth, 0).astype(float)
    height = rotate(rig.camera.unproject(depth), pose[:3, :3])[..., 2]
    seen = _left_over(depth) * downward
    truth, field = (float(1e3 * np.sqrt(np.mean(each[near] ** 2))) for each in (seen, _left_over(height)))
    return float(np.median(angle[ground])), *residual, truth, field


def fitted_normals(frame: StereoFrame) -> np.ndarray:
    """Return the normals (H, W, 3) of planes fitted to 3 x 3 pixels of true disparity, camera frame.

    On a plane the disparity is linear in the image: d / (f B) = 1 / Z = n . r / (n . p).
    """
    camera, rays = frame.rig.camera, frame.rig.camera.rays()
    inverse = np.float64(frame.disparity) / frame.rig.fb
    across = cv2.Sobel(inverse, cv2.CV_64F, 1, 0, ksize=3, scale=1 / 8)
    down = cv2.Sobel(inverse, cv2.CV_64F, 0, 1, ksize=3, scale=1 / 8)
    mean = cv2.blur(inverse, (3, 3))
    x, y = camera.fx * across, camera.fy * down
    out = np.stack([x, y, mean - x * rays[..., 0] - y * rays[..., 1]], axis=-1)
    out /= np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
    return -out


def _left_over(values: np.ndarray) -> np.ndarray:
    """Return what a map (H, W) has over its mean in windows."""
    return values - cv2.blur(values, (WINDOW, WINDOW))


def _difference(frame: StereoFrame, disparity: np.ndarray) -> np.ndarray:
    """Return the right image, moved by a disparity (H, W) [px], less the left one: (H, W, 3) [codes]."""
    v, u = np.indices(disparity.shape, dtype=np.float32)
    moved = cv2.remap(frame.right.astype(np.float32), u - disparity.astype(np.float32), v, cv2.INTER_CUBIC)
    return moved - frame.left


def _inside(frame: StereoFrame) -> np.ndarray:
    """Return the pixels (H, W) that are seen by both eyes and whose windows lie in the image, on ground."""
    ground = (frame.surface == GROUND) & np.isfinite(frame.depth)
    out = cv2.erode(ground.astype(np.uint8), np.ones((WINDOW, WINDOW), np.uint8)) > 0
    out[:WINDOW], out[-WINDOW:], out[:, :WINDOW], out[:, -WINDOW:] = False, False, False, False
    return out


def _far_from_edges(frame: StereoFrame) -> np.ndarray:
    """Return the pixels (H, W) whose 5 x 5 pixels both eyes see, and that lie 3 px inside the right image."""
    kernel = np.ones((5, 5), np.uint8)
    hidden = cv2.dilate(frame.occluded.astype(np.uint8), kernel) > 0
    return ~hidden & (np.arange(frame.disparity.shape[1]) - frame.disparity >= 3)


if __name__ == "__main__":
    main(tyro.cli(Options))
