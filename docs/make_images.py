"""Make the README's pictures anew: `make demo`, then `python docs/make_images.py`."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from marssim.base.camera import NATECAM
from marssim.base.images.colours import depth_colours, normal_colours
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.scene import PRESETS, build_scene, preset
from marssim.scene.viewpoint import ViewConfig, draw_pose

HERE = Path(__file__).parent / "images"
DEMO = Path(__file__).parents[1] / "out" / "demo"
TILE = 360
VIEW = ViewConfig(pitch_deg=(12.0, 16.0), roll_deg=(0.0, 0.0))
SUN = (28.0, 48.0)  # [deg] elevation


def presets() -> np.ndarray:
    """(H, W, 3) uint8: left eye, depth and normals of each preset, a column each."""
    columns = []
    for n, name in enumerate(PRESETS):
        rng = np.random.default_rng((11, n))
        look = replace(preset(name).look, sun_elevation_deg=SUN)
        scene = build_scene(preset(name, look=look), rng)
        renderer = EmbreeRenderer(scene)
        pose = draw_pose(scene, VIEW, rng)
        frame = render_stereo(renderer, Shader(scene), NATECAM, pose, Sensor.draw(SensorConfig(), rng), rng)
        renderer.close()
        parts = [frame.left, depth_colours(frame.depth), normal_colours(frame.normal)]
        columns.append(np.vstack([cv2.resize(part, (TILE, TILE), interpolation=cv2.INTER_AREA) for part in parts]))
    return np.hstack(columns)


def save(name: str, image: np.ndarray) -> None:
    cv2.imwrite(str(HERE / name), image, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    HERE.mkdir(exist_ok=True)
    save("presets.jpg", presets()[..., ::-1])
    for source, name in (("drive.png", "drive.jpg"), ("comparison.png", "comparison.jpg")):
        image = cv2.imread(str(DEMO / source))
        if image is None:
            raise SystemExit(f"{DEMO / source}: not there; run `make demo` first")
        width = min(image.shape[1], 1500)
        size = (width, round(image.shape[0] * width / image.shape[1]))
        save(name, cv2.resize(image, size, interpolation=cv2.INTER_AREA))
