"""Generate stereo pairs with ground truth.

    python -m marssim.generate --out data/utopia --pairs 100 --seed 1 --workers 2

Each scene gives as many pairs as --views-per-scene says. A sample depends on the seed, its scene and its view alone:
any number of workers writes the same bytes, and the same command goes on where an earlier run was stopped.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from tqdm import tqdm

from marssim.camera import NATECAM, StereoRig
from marssim.command import counted, run_command
from marssim.contact_sheet import contact_sheet
from marssim.dataset import DatasetError, StereoDataset, is_complete, read_json, write_index, write_json, write_sample
from marssim.render.makers import make_renderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.shading import Shader
from marssim.render.stereo import render_stereo
from marssim.scene.scene import PRESETS, Scene, build_scene, preset
from marssim.viewpoint import ViewConfig, draw_pose

MIXED = "mixed"
SHEET_SAMPLES = 12


@dataclass(frozen=True)
class GenerateConfig:
    """Generate stereo pairs of Mars with exact depth, normals and masks."""

    out: Path
    """folder to write; a folder that holds part of the same dataset is completed"""
    pairs: int = 100
    """number of stereo pairs; a larger number later adds to those that are there"""
    seed: int = 0
    """seed of every random draw, 0 or more"""
    workers: int = 1
    """processes to render in, one thread each; the files do not depend on it"""
    renderer: Literal["pybullet", "embree"] = "pybullet"
    """what makes the G-buffer: PyBullet's rasteriser, or Embree's rays (faster)"""
    scene: Literal["utopia", "gusev", "gale", "jezero", "hard", "mixed"] = "utopia"
    """place on Mars that the terrain is modelled on, from few rocks to many; "mixed" draws one for each scene"""
    k: float | None = None
    """share of the ground that rocks cover, 0 to 0.4 (Golombek's k), instead of the preset's .033 to .20"""
    views_per_scene: int = 8
    """pairs rendered of one scene; train, val and test share no scene"""
    view: ViewConfig = field(default_factory=ViewConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)

    def __post_init__(self) -> None:
        if self.pairs < 1:
            raise ValueError(f"--pairs must be at least 1, got {self.pairs}")
        if self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        if self.views_per_scene < 1:
            raise ValueError(f"--views-per-scene must be at least 1, got {self.views_per_scene}")
        if self.seed < 0:
            raise ValueError(f"--seed must not be negative, got {self.seed}")
        if self.k is not None and not 0 <= self.k <= 0.4:
            raise ValueError(f"--k must lie in [0, 0.4], got {self.k}")

    def content(self) -> dict[str, Any]:
        """What decides the content of each sample: all but the place, the number of pairs and of workers."""
        return {name: value for name, value in asdict(self).items() if name not in ("out", "pairs", "workers")}


def generate_scene(config: GenerateConfig, scene_index: int, views: list[int], rig: StereoRig = NATECAM) -> int:
    """Render the views of one scene that are not on disk yet. Returns how many of `views` are there now.

    Raises ValueError if rocks leave a camera no place to stand, ImportError if the renderer is not installed.
    """
    missing = [v for v in views if not is_complete(sample_folder(config.out, scene_index, v))]
    if not missing:
        return len(views)
    rng = np.random.default_rng((config.seed, scene_index))
    name = PRESETS[rng.integers(len(PRESETS))] if config.scene == MIXED else config.scene
    scene_config = preset(name)
    if config.k is not None:
        scene_config = replace(scene_config, rocks=replace(scene_config.rocks, k=config.k))
    scene = build_scene(scene_config, rng)
    maker = make_renderer(config.renderer, scene)
    try:
        shader = Shader(scene)
        for view in missing:
            rng = np.random.default_rng((config.seed, scene_index, 1 + view))
            pose = draw_pose(scene, config.view, rng)
            sensor = Sensor.draw(config.sensor, rng)
            frame = render_stereo(maker, shader, rig, pose, sensor, rng)
            write_sample(
                sample_folder(config.out, scene_index, view), frame, _meta(config, scene, sensor, scene_index, view)
            )
    finally:
        maker.close()
    return len(views)


def sample_folder(out: Path, scene: int, view: int) -> Path:
    """Where a sample of the dataset `out` lies: scenes/<scene, 5 digits>/<view, 2 digits>."""
    return out / "scenes" / f"{scene:05d}" / f"{view:02d}"


def _meta(config: GenerateConfig, scene: Scene, sensor: Sensor, scene_index: int, view: int) -> dict[str, Any]:
    return {
        "scene": scene_index,
        "view": view,
        "seed": config.seed,
        "renderer": config.renderer,
        "preset": scene.config.preset,
        "scene_config": asdict(scene.config),
        "sun": scene.look.sun.tolist(),
        "sun_elevation_deg": float(np.rad2deg(scene.look.sun_elevation)),
        "optical_depth": scene.look.optical_depth,
        "albedo_contrast": scene.look.albedo_contrast,
        "texture_strength": scene.look.texture_strength,
        "sensor": asdict(sensor),
    }


def _start_worker() -> None:
    cv2.setNumThreads(1)


def generate(config: GenerateConfig, rig: StereoRig = NATECAM) -> StereoDataset:
    """Write the dataset and return it.

    rig: the cameras; another than NaTeCam is recorded with the settings.
    Raises DatasetError if the folder holds another configuration's data, OSError if it cannot be written, and
    BrokenExecutor if a worker process was killed; what is complete stays, and the same call goes on from there.
    """
    if config.out.exists() and not config.out.is_dir():
        raise DatasetError(f"--out {config.out}: a file of that name is in the way; choose another")
    config.out.mkdir(parents=True, exist_ok=True)
    asked = config.out / "generate.json"
    content = _plain(config.content()) | ({} if rig == NATECAM else {"rig": rig.to_dict()})
    if asked.is_file():
        if read_json(asked) != content:
            raise DatasetError(f"{asked}: the folder holds a dataset of other settings; choose another --out")
    elif any(config.out.iterdir()):
        raise DatasetError(f"{config.out}: the folder is not empty and holds no dataset; choose another --out")
    else:
        write_json(asked, content)

    per_scene = config.views_per_scene
    tasks = [
        (scene, list(range(min(per_scene, config.pairs - scene * per_scene))))
        for scene in range(-(-config.pairs // per_scene))
    ]
    with tqdm(total=config.pairs, unit="pair", desc="generate", disable=None) as bar:
        if config.workers == 1:
            for scene, views in tasks:
                bar.update(generate_scene(config, scene, views, rig))
        else:
            _run_pool(config, rig, tasks, bar)
    names = [f"{scene:05d}/{view:02d}" for scene, views in tasks for view in views]
    write_index(config.out, {**content, "pairs": config.pairs}, names)
    dataset = StereoDataset(config.out)
    step = max(1, len(dataset) // SHEET_SAMPLES)
    sheet = contact_sheet([dataset[i] for i in range(0, len(dataset), step)][:SHEET_SAMPLES])
    cv2.imwrite(str(config.out / "contact_sheet.png"), sheet[..., ::-1])
    (config.out / "README.md").write_text(_readme(config, dataset))
    return dataset


def _run_pool(config: GenerateConfig, rig: StereoRig, tasks: list[tuple[int, list[int]]], bar: tqdm) -> None:
    """Scenes in spawned processes of one thread each; a worker is replaced now and then, so that memory stays flat."""
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    before = {name: os.environ.get(name) for name in threads}
    os.environ.update(threads)  # inherited by the spawned workers, read when they import numpy
    try:
        with ProcessPoolExecutor(
            config.workers, multiprocessing.get_context("spawn"), initializer=_start_worker, max_tasks_per_child=16
        ) as pool:
            waiting = list(reversed(tasks))
            running: set[Future[int]] = set()
            try:
                while waiting or running:
                    while waiting and len(running) < 2 * config.workers:
                        running.add(pool.submit(generate_scene, config, *waiting.pop(), rig))
                    done, running = wait(running, return_when=FIRST_COMPLETED)
                    for future in done:
                        bar.update(future.result())
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _plain(content: dict[str, Any]) -> dict[str, Any]:
    """As JSON gives it back: tuples become lists."""

    return json.loads(json.dumps(content))


def _readme(config: GenerateConfig, dataset: StereoDataset) -> str:
    counts = {name: sum(s["split"] == name for s in dataset.index["samples"]) for name in ("train", "val", "test")}
    return f"""# Mars stereo dataset

{counted(len(dataset), "stereo pair")} (train {counts["train"]}, val {counts["val"]}, test {counts["test"]}; split by
scene), scene `{config.scene}`, seed {config.seed}, rendered with {config.renderer}.

![contact sheet](contact_sheet.png)

Files of a sample, in `scenes/<scene>/<view>/`: `left.png`, `right.png` (8-bit RGB), `depth.png`
(16-bit: Z = 0.1 m * 10000^(code / 65534); 65535 is the sky), `normal.png` (16-bit RGB, n = 2 code / 65535 - 1, camera
frame x right, y down, z forward), `surface.png` (0 sky, 1 ground, from 2 rocks), `occluded.png` (255: hidden from the
right eye), `sample.json` (rig, pose, sun, sensor, scene). Read it with

    from marssim.dataset import StereoDataset
    sample = StereoDataset("{config.out.name}", split="train")[0]

Digest of all samples: `{dataset.digest}`
"""


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return run_command(_work, GenerateConfig, "python -m marssim.generate", __doc__, args)


def _work(config: GenerateConfig) -> None:
    dataset = generate(config)
    print(
        f"{counted(len(dataset), 'pair')} in {config.out}, digest {dataset.digest[:16]}, "
        f"see {config.out / 'contact_sheet.png'}"
    )


if __name__ == "__main__":
    sys.exit(main())
