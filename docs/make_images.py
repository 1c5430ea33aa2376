"""Make the pictures of README.md and docs/ from the commands that the guides show.

    make demo
    python docs/make_images.py out/images

The commands write into the folder, and those whose results are there already are not run again. Pictures come out as
JPEG in docs/images.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import trimesh

from m3depth.training.curves import save_curves
from m3depth.training.log import LOG
from marssim.base.camera import NATECAM, StereoRig
from marssim.base.images.colours import depth_colours, normal_colours
from marssim.engines.embree import TriangleRays
from marssim.mesh import scene_mesh, screen_colours
from marssim.render.sensor import Sensor
from marssim.render.view import SceneRenderer
from marssim.scene.presets import PRESETS, preset
from marssim.scene.scene import build_scene
from marssim.scene.viewpoint import ViewConfig

HERE = Path(__file__).parent / "images"
ROOT = Path(__file__).parents[1]
DEMO = ROOT / "out" / "demo"
PPO_LOG = ROOT / "docs" / "results" / "policy" / "log.jsonl"
LITE = ROOT / "docs" / "results" / "methods" / "longer" / "lite-150-min" / "log.jsonl"
PPO_MEAN = 20  # rows of that log over which the thick line takes the mean
TILE = 360  # [px] side of a tile of presets.jpg
VIEW = ViewConfig(pitch_deg=(18.0, 22.0), roll_deg=(0.0, 0.0))  # little sky, and near ground with its pebbles
SUN = (25.0, 40.0)  # [deg] elevation
LARGEST = 80_000  # [byte] of a guide's picture
PLACE = {
    "preset": "gale",
    "rocks": {"k": 0.12},
    "relief": {"regional_slope_deg": 8},
    "look": {"sun_elevation_deg": [20, 25]},
}  # that of guides/own-terrain.md

# Faults of a sensor, weak and strong, by the name that the picture shows; the first two have their own names.
FAULTS = {
    "sound | hot pixels": ({}, {"hot_pixels": 3000.0}),
    "dust": ({"dust": 0.1}, {"dust": 0.35}),
    "motion blur": ({"motion_blur": 2.5}, {"motion_blur": 6.0}),
    "glare": ({"glare": 0.1}, {"glare": 0.3}),
    "overexposure, bleeding": (
        {"overexposure": 0.4, "bleeding": 0.4, "glare": 0.02},
        {"overexposure": 0.9, "bleeding": 1.0, "glare": 0.05},
    ),
    "smear": ({"smear": 0.1}, {"smear": 0.4}),
    "underexposure": ({"overexposure": -1.0}, {"overexposure": -2.5}),
    "stretch": ({"stretch": 0.005}, {"stretch": 0.03}),
    "JPEG": ({"jpeg_quality": 60.0}, {"jpeg_quality": 25.0}),
}

# Command lines by the file that each leaves, in their order.
COMMANDS = {
    "small/dataset.json": "marssim.generate --out small --pairs 12 --views-per-scene 4 --seed 1 --renderer scan",
    "verify/statistics.png": "marssim.verify small --out verify",
    "score/comparison.png": "m3depth.evaluate --data small --split test --out score",
    "predict/figure.png": "m3depth.predict small/scenes/00001/00/left.png small/scenes/00001/00/right.png "
    "--calib small/scenes/00001/00/sample.json --out predict",
    "own/qualitative.png": "m3depth.evaluate --data small --split test --out own --estimator own_estimator:Blocks",
    "drive/results.json": "envs.evaluate --perception m3depth --dynamics kinematic --goal-distance 12 --k .1 "
    "--episodes 1 --no-videos --out drive",
    "out/wary/results.json": "envs.evaluate --driver my_driver:Wary navigator --perception ground_truth "
    "--dynamics kinematic --goal-distance 12 --episodes 2 --k .1 --no-videos --out out/wary",
}


def presets() -> np.ndarray:
    """Return (H, W, 3) uint8: left eye, depth and normals of each preset, a column each."""
    columns = []
    for n, name in enumerate(PRESETS):
        rng = np.random.default_rng((13, n))
        scene = build_scene(preset(name, look=replace(preset(name).look, sun_elevation_deg=SUN)), rng)
        with SceneRenderer(scene, "embree") as renderer:
            frame = renderer.draw(rng, VIEW)
        columns.append(column(frame, TILE))
    return np.hstack(columns)


def column(frame, tile: int) -> np.ndarray:
    """Return left eye, depth and normals of a frame, one above the other."""
    parts = [frame.left, depth_colours(frame.depth), normal_colours(frame.normal)]
    return np.vstack([cv2.resize(part, (tile, tile), interpolation=cv2.INTER_AREA) for part in parts])


def place(folder: Path) -> np.ndarray:
    """Return three views of the place of the guide, from its file."""
    from marssim.scene.place_file import load_place

    (folder / "my_place.json").write_text(json.dumps(PLACE))
    scene = build_scene(load_place(folder / "my_place.json"), rng=4)
    with SceneRenderer(scene) as renderer:
        frames = [renderer.render(x=0, y=0, yaw_deg=yaw, pitch_deg=14) for yaw in (20, 140, 260)]
    return np.hstack([column(frame, 300) for frame in frames])


def ditches() -> np.ndarray:
    """Return two views of ditches and one of a fresh crater."""
    relief = replace(preset("gusev").relief, ditch_density=0.004, fresh_crater_density=0.004)
    scene = build_scene(preset("gusev", relief=relief), rng=3).with_sun(35, 60)
    with SceneRenderer(scene) as renderer:
        views = ((0.4, 9.4, 0), (5.6, 6.0, 120), (-1.5, -4.6, 180))
        return np.hstack([renderer.render(x, y, yaw, pitch_deg=15).left for x, y, yaw in views])


def mesh() -> np.ndarray:
    """Return a view of a scene's mesh, shaded by its faces, and the same view by the renderer."""
    scene = build_scene(preset("gale"), np.random.default_rng((1, 0)))
    with SceneRenderer(scene) as renderer:
        frame = renderer.render(x=0, y=0, yaw_deg=40)
    parts = trimesh.util.concatenate(list(scene_mesh(scene).values()))
    rays = (NATECAM.camera.rays() @ frame.pose[:3, :3].T).reshape(-1, 3)
    face, _ = TriangleRays(parts.vertices, parts.faces).meet(frame.pose[None, :3, 3], rays)
    light = 0.4 + 0.6 * np.clip(parts.face_normals[face] @ scene.look.sun, 0, 1)[:, None]
    colours = screen_colours(parts.visual.vertex_colors[parts.faces[face, 0], :3])
    shaded = np.where(face[:, None] >= 0, np.clip(1.3 * colours * light, 0, 255), 200).astype(np.uint8)
    return np.hstack([shaded.reshape(frame.left.shape), frame.left])


def heightmap(folder: Path) -> np.ndarray:
    """Return a heightmap, lit from the west, and a view of a scene on it."""
    y, x = np.mgrid[-150:151, -150:151].astype(float)
    heights = 6 * np.exp(-((x - 12) ** 2 + y**2) / 60) + 4 * np.sin(x / 25) * np.cos(y / 30)  # a mound among waves
    np.save(folder / "dem.npy", heights)
    relief = replace(preset("gusev").relief, heightmap=str(folder / "dem.npy"), heightmap_scale=1.0)
    scene = build_scene(preset("gusev", relief=relief), rng=2)
    with SceneRenderer(scene) as renderer:
        frame = renderer.render(x=-6, y=-3, yaw_deg=12, pitch_deg=4)
    light = np.clip(0.55 - 0.9 * np.gradient(heights, axis=1), 0, 1)[::-1]  # north is up
    shade = cv2.resize((255 * light).astype(np.uint8), (512, 512), interpolation=cv2.INTER_CUBIC)
    return np.hstack([cv2.cvtColor(shade, cv2.COLOR_GRAY2RGB), frame.left])


def cameras() -> np.ndarray:
    """Return the same ground by NaTeCam and by the wide rig of the guide."""
    scene = build_scene(preset("gale"), rng=7)
    wide = StereoRig(type(NATECAM.camera).centred(640, 480, 400.0), 0.12)
    images = []
    for rig in (NATECAM, wide):
        with SceneRenderer(scene, rig=rig) as renderer:
            left = renderer.render(x=2, y=-1, yaw_deg=30).left
        images.append(cv2.resize(left, (round(480 * left.shape[1] / left.shape[0]), 480), interpolation=cv2.INTER_AREA))
    return np.hstack(images)


def faults() -> np.ndarray:
    """Return a part of one view with each fault, weak and strong, three faults a row, with their names."""
    sound = Sensor(0.46, 0.45, 9000.0, 8.0, 0.1, motion_direction_deg=25.0, seed=3)
    tiles = []
    with SceneRenderer(build_scene(preset("gale"), rng=7).with_sun(25, 60)) as renderer:
        for name, levels in FAULTS.items():
            labels = name.split(" | ") if " | " in name else [f"{name}, {level}" for level in ("weak", "strong")]
            for label, changes in zip(labels, levels, strict=True):
                image = renderer.render(2, -1, 30, pitch_deg=13, sensor=replace(sound, **changes)).left
                tile = np.ascontiguousarray(image[90:346, 240:496])
                (across, _), _ = cv2.getTextSize(label, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
                cv2.rectangle(tile, (0, 0), (across + 9, 20), (255, 255, 255), cv2.FILLED)
                cv2.putText(tile, label, (5, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (20, 20, 20), 1, cv2.LINE_AA)
                tiles.append(tile)
    return np.vstack([np.hstack(tiles[first : first + 6]) for first in range(0, len(tiles), 6)])


def navigator() -> np.ndarray:
    """Return what the rover sees and the navigator's map of it, in the middle of a drive."""
    from envs import Cell, MarsNavEnv, NavigatorDriver, run_episode
    from envs.drives.film import navigator_map

    shown: dict[int, np.ndarray] = {}

    def watch(env, driver, step: int) -> None:
        if step % 4 == 0 and step:
            world_map = navigator_map(env, driver)
            depth = depth_colours(env.sight.depth)
            size = world_map.shape[0]
            shown[step] = np.hstack([cv2.resize(depth, (size, size), interpolation=cv2.INTER_NEAREST), world_map])

    env = MarsNavEnv("ground_truth", "kinematic", goal_distance=14.0, mast=True)
    run_episode(env, NavigatorDriver(), Cell(k=0.1), seed=3, episode=0, watch=watch)
    env.close()
    return shown[sorted(shown)[len(shown) // 2]]


def curves(folder: Path) -> np.ndarray:
    """Return curves.png of the longest training of `lite` in results/methods.md."""
    run = folder / "lite"
    run.mkdir(exist_ok=True)
    shutil.copy(LITE, run / LOG)
    drawn = save_curves(run)
    assert drawn is not None
    return picture(drawn)


def ppo() -> np.ndarray:
    """Return a plot of the log of results/policy.md: arrivals and reward over the choices."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = [json.loads(line) for line in PPO_LOG.read_text().splitlines()]
    choices = np.array([row["choices"] for row in rows]) / 1000
    figure, axes = plt.subplots(1, 2, figsize=(8, 2.8), layout="constrained")
    values = {"goals reached [%]": [100 * row["arrived"] for row in rows], "reward": [row["reward"] for row in rows]}
    for axis, (label, series) in zip(axes, values.items(), strict=True):
        mean = np.convolve(series, np.ones(PPO_MEAN) / PPO_MEAN, "valid")
        axis.plot(choices, series, linewidth=0.5, alpha=0.4)
        axis.plot(choices[PPO_MEAN - 1 :], mean, color="C0")
        axis.set(xlabel="thousand choices", ylabel=label)
    axes[0].set_ylim(0, 100)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3]


def picture(path: Path) -> np.ndarray:
    """Return an image file as (H, W, 3) RGB. Ends the program if it is not there."""
    image = cv2.imread(str(path))
    if image is None:
        raise SystemExit(f"{path}: no such picture; run `make demo` first")
    return image[..., ::-1]


def save(name: str, image: np.ndarray, width: int = 1100, largest: int = LARGEST) -> None:
    """Write a picture of at most so many pixels across and so many bytes."""
    while True:
        across = min(image.shape[1], width)
        size = (across, round(image.shape[0] * across / image.shape[1]))
        shown = cv2.resize(image, size, interpolation=cv2.INTER_AREA)[..., ::-1]
        for quality in (88, 80, 72, 64):
            data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
            if len(data) <= largest:
                (HERE / name).write_bytes(data.tobytes())
                print(f"{name}: {size[0]} x {size[1]}, {len(data) // 1000} kB")
                return
        width = round(0.85 * across)


def run(folder: Path) -> None:
    """Run the commands whose results are not there; my_driver.py is the program of the guide."""
    guide = (ROOT / "docs" / "guides" / "own-driver.md").read_text()
    (folder / "my_driver.py").write_text(guide.partition("```python\n")[2].partition("```")[0])
    for result, line in COMMANDS.items():
        if not (folder / result).exists():
            paths = os.pathsep.join([str(ROOT), str(ROOT / "examples")])  # own_estimator is an example
            environment = {**os.environ, "PYTHONPATH": paths}
            subprocess.run([sys.executable, "-m", *shlex.split(line)], cwd=folder, env=environment, check=True)


def main(folder: Path) -> None:
    """Make all pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    run(folder)
    save("presets.jpg", presets(), 1500, 360_000)
    save("faults.jpg", faults(), 1536, 250_000)
    save("drive.jpg", picture(DEMO / "drive.png"), 1500, 550_000)
    guides(folder)


def guides(folder: Path) -> None:
    """Make the pictures of the guides."""
    save("guide_generate.jpg", picture(folder / "small" / "contact_sheet.png"), largest=98_000)
    save("guide_verify.jpg", picture(folder / "verify" / "statistics.png"))
    save("guide_score.jpg", picture(folder / "score" / "comparison.png"), largest=98_000)
    save("guide_predict.jpg", picture(folder / "predict" / "figure.png"))
    save("guide_own_estimator.jpg", picture(folder / "own" / "qualitative.png"))
    save("guide_drive.jpg", picture(next((folder / "drive" / "maps").glob("*.png"))))
    save("guide_own_driver.jpg", picture(next((folder / "out" / "wary" / "maps").glob("*.png"))))
    save("guide_train.jpg", curves(folder))
    save("guide_ppo.jpg", ppo())
    save("guide_place.jpg", place(folder))
    save("guide_ditches.jpg", ditches())
    save("guide_heightmap.jpg", heightmap(folder))
    save("guide_mesh.jpg", mesh())
    save("guide_camera.jpg", cameras())
    save("guide_navigator.jpg", navigator())


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]))
