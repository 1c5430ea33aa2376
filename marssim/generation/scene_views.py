"""One task of marssim.generate: render and write the views of one scene."""

from __future__ import annotations

import platform
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.dataset.marks import MARK_NOTES, SETTINGS
from marssim.base.dataset.sample import is_complete, write_sample
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json
from marssim.base.pose import ROVER_KEY
from marssim.base.results.claim import differences
from marssim.base.results.code_state import source_digest
from marssim.generation.config import EGL, GenerateConfig
from marssim.render.raw import RawRenderer
from marssim.render.renderers.by_name import make_renderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.own_rover import ROVER_DRAWS, draw_pan, draw_pose_of_rover, rover_below
from marssim.scene.scene import Scene, build_scene
from marssim.scene.trajectory import TRAJECTORY, MastState, draw_trajectory, tum_lines
from marssim.scene.viewpoint import draw_pose

RAW_DRAWS = 0x726177  # separates the noise of the raw images


def generate_scene(config: GenerateConfig, scene_index: int, views: list[int], sources: str | None = None) -> int:
    """Render the views of one scene that are not on disk yet.

    Every random draw follows from (seed, scene, view), so that a view depends neither on the worker nor on the other
    views.

    Args:
        config: The dataset.
        scene_index: Number of the scene, from 0.
        views: Numbers of its views.
        sources: Digest of marssim's source files where the command runs; None if it runs in this process.

    Returns:
        The number of `views`, all of which are on disk now.

    Raises:
        ValueError: Rocks leave a camera no place to stand.
        ImportError: The renderer's library is not installed.
        DatasetError: The worker cannot see the folder of the dataset, has other source files of marssim, or works on
            after the folder was given to another dataset.
        OSError: A file could not be written. The error names it.
    """
    if sources is not None and source_digest(("marssim",)) != sources:
        raise DatasetError(
            f"the worker on {platform.node()} has other source files of marssim than this command; install one version "
            "on all machines, and do not change it while the command runs"
        )
    _check_mark(config)
    missing = [v for v in views if not is_complete(sample_folder(config.out, scene_index, v))]
    if missing:
        _render(config, scene_index, missing)
    if config.trajectory:
        _write_trajectory(config.out, scene_index, views)
    return len(views)


def _check_mark(config: GenerateConfig) -> None:
    """Raise DatasetError if the folder is not marked as this dataset.

    A worker of a cluster finishes its scene even where the command that sent it has ended.
    """
    mark = config.out / SETTINGS
    if not mark.is_file():
        raise DatasetError(
            f"{config.out}: a worker cannot see this folder; --out must be a folder that all workers share"
        )
    settings = {name: value for name, value in read_json(mark).items() if name not in MARK_NOTES}
    if differences(settings, as_json(config.content())):
        raise DatasetError(f"{mark}: another dataset has taken this folder; this worker stops, and writes nothing more")


def sample_folder(out: Path, scene: int, view: int) -> Path:
    """Return the folder of a sample: scenes/<scene, 5 digits>/<view, 2 digits>.

    Args:
        out: Folder of the dataset.
        scene: Number of the scene, from 0.
        view: Number of the view in the scene, from 0.
    """
    return out / "scenes" / f"{scene:05d}" / f"{view:02d}"


def draw_scene(config: GenerateConfig, scene_index: int) -> Scene:
    """Build a scene of the dataset.

    Args:
        config: The dataset.
        scene_index: Number of the scene, from 0.

    Raises:
        ValueError: The scene cannot be built.
    """
    return build_scene(config.scene_config(scene_index), np.random.default_rng((config.seed, scene_index)))


def draw_drive(config: GenerateConfig, scene: Scene, scene_index: int) -> tuple[Sensor, np.ndarray, np.ndarray]:
    """Draw the drive over a scene.

    Args:
        config: The dataset.
        scene: The scene.
        scene_index: Its number.

    Returns:
        The sensor, one for the whole drive; the poses (views_per_scene, 4, 4), left camera to world; and (4, 4), left
        camera to rover. See draw_trajectory.
    """
    rng, mast = np.random.default_rng((config.seed, scene_index, 0)), _mast(config, scene_index, 0)
    sensor = Sensor.draw(config.sensor, rng)
    return sensor, *draw_trajectory(scene, config.view, config.drive, config.views_per_scene, rng, mast)


def draw_view(
    config: GenerateConfig, scene: Scene, scene_index: int, view: int
) -> tuple[np.ndarray, np.random.Generator]:
    """Draw the pose of a view that is not part of a drive.

    Args:
        config: The dataset.
        scene: The scene.
        scene_index: Its number.
        view: Number of the view in the scene, from 0.

    Returns:
        The pose (4, 4), left camera to world, and the generator of the view's further draws.

    Raises:
        ValueError: Rocks leave the camera no place to stand.
    """
    rng, mast = _rng_of(config, scene_index, view), _mast(config, scene_index, view)
    if mast is None:
        return draw_pose(scene, config.view, rng, config.rig.baseline), rng
    return draw_pose_of_rover(scene, config.view, rng, mast), rng


def draw_rover(config: GenerateConfig, scene_index: int, view: int) -> float | None:
    """Draw the pan of the mast [rad] in a view where the rover is there; None where it is not.

    Args:
        config: The dataset. A drive draws it once.
        scene_index: Number of the scene.
        view: Number of the view in the scene, from 0.
    """
    first = 0 if config.trajectory else 1 + view
    return draw_pan(config.view, np.random.default_rng((config.seed, scene_index, first, ROVER_DRAWS)))


def _mast(config: GenerateConfig, scene_index: int, view: int) -> MastState | None:
    pan = draw_rover(config, scene_index, view)
    return None if pan is None else MastState(config.rig.baseline, pan)


def _rng_of(config: GenerateConfig, scene_index: int, view: int) -> np.random.Generator:
    return np.random.default_rng((config.seed, scene_index, 1 + view))


def _render(config: GenerateConfig, scene_index: int, views: list[int]) -> None:
    scene = draw_scene(config, scene_index)
    sensor, poses, mount = draw_drive(config, scene, scene_index) if config.trajectory else (None, None, None)
    renderer = make_renderer(config.renderer, scene, egl=config.rasterizer == EGL)
    try:
        shader = Shader(scene)
        raw_renderer = RawRenderer(config.raw_rig) if config.raw and config.raw_rig is not None else None
        for view in views:
            if poses is None:
                pose, rng = draw_view(config, scene, scene_index, view)
            else:
                pose, rng = poses[view], _rng_of(config, scene_index, view)
            view_sensor = sensor or Sensor.draw(config.sensor, rng)
            pan = draw_rover(config, scene_index, view)
            rover = None
            if pan is not None and mount is not None:  # the mast is rigid over a drive
                rover = pose @ np.linalg.inv(mount)
            elif pan is not None:
                rover = rover_below(scene, pose, config.rig.baseline, pan)
            frame = render_stereo(renderer, shader, config.rig, pose, view_sensor, rng, rover)
            meta = _meta(config, scene, view_sensor, scene_index, view)
            if pan is not None and rover is not None:
                meta["rover"] = {"pan_deg": float(np.rad2deg(pan)), "pose": rover.tolist()}
            elif mount is not None:
                meta[ROVER_KEY] = mount.tolist()
            raw = None
            if raw_renderer is not None:
                noise = np.random.default_rng((config.seed, scene_index, 1 + view, RAW_DRAWS))
                raw = raw_renderer.render(renderer, shader, pose, view_sensor, noise, rover)
            _check_mark(config)
            write_sample(sample_folder(config.out, scene_index, view), frame, meta, raw, replace=False)
    finally:
        renderer.close()


def _meta(config: GenerateConfig, scene: Scene, sensor: Sensor, scene_index: int, view: int) -> dict[str, Any]:
    scene_config = asdict(scene.config)
    if scene.config.relief.heightmap is not None:  # the name alone, since folders differ between machines
        scene_config["relief"]["heightmap"] = Path(scene.config.relief.heightmap).name
    more: dict[str, Any] = {"rasterizer": EGL} if config.rasterizer == EGL else {}
    if scene.terrain.at is not None:  # place and height of the scene's origin in the heightmap [m]
        more["heightmap"] = {"at": list(scene.terrain.at), "datum": scene.terrain.datum}
    if config.trajectory:
        more["timestamp"] = view * config.drive.step / config.drive.speed
    return {
        "scene": scene_index,
        "view": view,
        "seed": config.seed,
        "renderer": config.renderer,
        "preset": scene.config.preset,
        "scene_config": scene_config,
        "rock_abundance": scene.abundance(),
        "outcrop": asdict(scene.outcrop.traits),
        "surface_ids": scene.outcrop.surface_ids(len(scene.rocks)),
        **asdict(scene.look),  # every value that the scene drew
        "sun": scene.look.sun.tolist(),
        "sun_elevation_deg": float(np.rad2deg(scene.look.sun_elevation)),
        "sensor": asdict(sensor),
        **more,
    }


def _write_trajectory(out: Path, scene_index: int, views: list[int]) -> None:
    """Write the poses of a scene's views beside them, unless the file has them already."""
    metas = [read_json(sample_folder(out, scene_index, view) / "sample.json") for view in views]
    text = tum_lines([meta["timestamp"] for meta in metas], np.array([meta["pose"] for meta in metas]))
    file = out / "scenes" / f"{scene_index:05d}" / TRAJECTORY
    if not file.is_file() or file.read_text(encoding="utf-8") != text:
        write_atomically(file, text.encode())
