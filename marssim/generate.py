"""Generate stereo pairs with ground truth.

    python -m marssim.generate --out data/utopia --pairs 100 --seed 1 --workers 2
    python -m marssim.generate --out data/rocky --scene gale --rocks.k 0.1 --look.sun-elevation-deg 10 20
    python -m marssim.generate --out data/drives --trajectory --drive.step 0.3 --views-per-scene 50

Each scene gives as many pairs as --views-per-scene says. A sample depends on the seed, its scene and its view alone:
any number of workers writes the same bytes, and the same command goes on where an earlier run was stopped.
"""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from marssim.base.command.notes import counted
from marssim.base.command.progress import progress
from marssim.base.command.run import exit_code, writing_to
from marssim.base.compute.workers import run_tasks
from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.marks import SETTINGS
from marssim.base.dataset.sample import is_complete
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.results.lock import LOCK, sole_writer
from marssim.base.results.out_folder import check_around
from marssim.engines.egl import draws_on_a_card, probe
from marssim.generation.command_line import command_flags
from marssim.generation.config import AUTO, EGL, TINY, GenerateConfig, parse_generate
from marssim.generation.contact_sheet import contact_sheet
from marssim.generation.scene_views import draw_drive, draw_scene, draw_view, generate_scene
from marssim.inspection.integrity import check_written
from marssim.scene.scene import PRESETS, preset
from marssim.scene.trajectory import TRAJECTORY

__all__ = ["GenerateConfig", "generate", "generate_scene"]

SHEET_SAMPLES = 12


def generate(config: GenerateConfig) -> StereoDataset:
    """Write the dataset and return it.

    Raises DatasetError if the folder holds another configuration's data, FolderInUse if another command writes to it,
    ValueError for scenes that cannot be built, OSError if it cannot be written, and BrokenExecutor if a worker process
    was killed; what is complete stays, and the same call goes on from there.
    """
    config = _with_rasterizer(_absolute(config))
    _check(config)
    with sole_writer(config.out):
        return _generate(config)


def _generate(config: GenerateConfig) -> StereoDataset:
    content = _claim(config)
    _clear_up(config.out)
    scenes = _scenes(config)
    names = [f"{scene:05d}/{view:02d}" for scene, views in enumerate(scenes) for view in views]
    _check_written(config.out, names)
    tasks = _shared_out(config, scenes)
    with progress(config.pairs, "pair", "generate") as bar:
        run_tasks(generate_scene, tasks, lambda _, count: bar.update(count), config.workers, config.scheduler)
    _clear_up(config.out)
    write_index(config.out, {**content, "pairs": config.pairs}, names)
    dataset = StereoDataset(config.out)
    chosen = range(0, len(dataset), max(1, len(dataset) // SHEET_SAMPLES))[:SHEET_SAMPLES]
    sheet = contact_sheet([dataset[i] for i in chosen], [dataset.names[i] for i in chosen])
    write_atomically(config.out / "contact_sheet.png", cv2.imencode(".png", sheet[..., ::-1])[1].tobytes())
    write_atomically(config.out / "README.md", _readme(config, dataset).encode())
    _note(config, content, finished=True)
    return dataset


def _check_written(out: Path, names: list[str]) -> None:
    """Raise DatasetError if a sample of an earlier run is not as it was written: it would be taken for whole."""
    spoilt = check_written(out, [name for name in names if is_complete(out / "scenes" / name)])
    if spoilt:
        more = f" ({len(spoilt)} files in all)" if len(spoilt) > 1 else ""
        raise DatasetError(
            f"{out / spoilt[0].path}: {spoilt[0].problem}{more}; delete that sample's folder, and the same command "
            "makes it anew"
        )


def _scenes(config: GenerateConfig) -> list[range]:
    """The views of each scene."""
    per_scene = config.views_per_scene
    return [range(min(per_scene, config.pairs - first)) for first in range(0, config.pairs, per_scene)]


def _shared_out(config: GenerateConfig, scenes: list[range]) -> list[tuple[GenerateConfig, int, list[int]]]:
    """Arguments of generate_scene. Scenes that are left over when all workers have had as many are shared out by views.

    Else, of two workers that have five scenes, one would stand idle while the other renders the fifth. A drive is one
    piece of work, and how many workers a cluster has is not known.
    """
    shares = config.workers if config.scheduler is None and not config.trajectory else 1
    left_over = len(scenes) % shares
    tasks = []
    for scene, views in enumerate(scenes):
        parts = shares if scene >= len(scenes) - left_over else 1
        tasks += [(config, scene, list(views[part::parts])) for part in range(min(parts, len(views)))]
    return tasks


def _absolute(config: GenerateConfig) -> GenerateConfig:
    """With absolute paths: workers elsewhere may stand in another folder."""
    scenes = [
        replace(scene, relief=replace(scene.relief, heightmap=str(Path(scene.relief.heightmap).absolute())))
        if scene.relief.heightmap is not None
        else scene
        for scene in config.scenes
    ]
    return replace(config, out=config.out.absolute(), scenes=tuple(scenes))


def _with_rasterizer(config: GenerateConfig) -> GenerateConfig:
    """With what draws PyBullet's pictures decided: as the folder's dataset was begun, else by a trial.

    The two differ in a few pixels on silhouettes, so that it belongs to the settings. Raises ValueError if it is EGL,
    which does not work here.
    """
    if config.renderer != "pybullet":
        return config
    asked = config.out / SETTINGS
    begun = asked.is_file() and not _only_claimed(config.out)
    if config.rasterizer == AUTO:
        egl = read_json(asked).get("rasterizer") == EGL if begun else draws_on_a_card()
        config = replace(config, rasterizer=EGL if egl else TINY)
    if config.rasterizer == EGL and not (found := probe()).works:
        what = f"{asked}: the dataset was begun with EGL, which" if begun else "--rasterizer egl: it"
        raise ValueError(f"{what} does not work here: {found.message}")
    return config


def _check(config: GenerateConfig) -> None:
    """Raise for what must fail, before anything is written: see _held, and scenes in which no camera can stand."""
    if config.out.exists() and not config.out.is_dir():
        raise DatasetError(f"--out {config.out}: a file of that name is in the way; choose another")
    check_around(config.out)
    if _held(config):
        asked = {f"{scene:05d}/{view:02d}" for scene, views in enumerate(_scenes(config)) for view in views}
        there = {f"{file.parts[-3]}/{file.parts[-2]}" for file in config.out.glob("scenes/*/[0-9]*/sample.json")}
        if more := len(there - asked):
            raise DatasetError(
                f"--pairs {config.pairs}: {config.out} holds {counted(more, 'pair')} beyond these; "
                f"ask for as many as before or more, or choose another --out"
            )
        return
    for scene_config in config.scenes:
        if scene_config in map(preset, PRESETS) and not config.trajectory:
            continue  # known to be sound
        index = next(i for i in range(len(config.scenes)) if config.scene_config(i) == scene_config)
        scene = draw_scene(config, index)
        if config.trajectory:
            draw_drive(config, scene, index)
        else:
            draw_view(config, scene, index, 0)


def _settings(config: GenerateConfig) -> dict[str, Any]:
    """What is noted of the config in the folder, as it is read back: tuples become lists."""
    return json.loads(json.dumps(config.content(), default=str))


def _held(config: GenerateConfig) -> bool:
    """Does the folder hold this dataset, or a part of it? Raises DatasetError if it holds something else.

    Settings of which nothing came, say because a package is missing, do not count.
    """
    asked, content = config.out / SETTINGS, _settings(config)
    if asked.is_file():
        there = read_json(asked)
        there.pop("command", None)
        if there == content:
            return True
        if _only_claimed(config.out):
            return False
        if {**there, "marssim": content["marssim"]} == content:
            raise DatasetError(
                f"{asked}: the folder holds a dataset of marssim {there.get('marssim', 'of an earlier version')}, "
                f"which this version, {content['marssim']}, may not draw alike; choose another --out"
            )
        differing = sorted(_differences(there, content), key=lambda line: not line.startswith("scene:"))
        other = "; ".join(differing[:3]) + (f"; and {len(differing) - 3} more" if len(differing) > 3 else "")
        raise DatasetError(f"{asked}: the folder holds a dataset of other settings ({other}); choose another --out")
    if config.out.is_dir() and not all(file.name == LOCK or _is_part(file) for file in config.out.iterdir()):
        raise DatasetError(f"{config.out}: the folder is not empty and holds no dataset; choose another --out")
    return False


def _differences(there: Any, asked: Any, name: str = "") -> list[str]:
    """Where two settings differ, as "name: value there, not value asked"."""
    if isinstance(there, dict) and isinstance(asked, dict):
        keys = [*there, *(key for key in asked if key not in there)]
        parts = [_differences(there.get(key), asked.get(key), f"{name}.{key}" if name else str(key)) for key in keys]
        return [difference for part in parts for difference in part]
    if isinstance(there, list) and isinstance(asked, list) and len(there) == len(asked):
        parts = [_differences(a, b, f"{name}[{i}]") for i, (a, b) in enumerate(zip(there, asked))]
        return [difference for part in parts for difference in part]
    if there == asked:
        return []
    values = (textwrap.shorten(json.dumps(value), 60) for value in (there, asked))
    return [f"{name}: {next(values)}, not {next(values)}"]


def _claim(config: GenerateConfig) -> dict[str, Any]:
    """Make the folder this dataset's, or find that it is. Returns the settings that are noted in it."""
    _held(config)
    content = _settings(config)
    _note(config, content, finished=False)
    return content


def _note(config: GenerateConfig, content: dict[str, Any], finished: bool) -> None:
    """Keep the settings, and the command that completes them here; of a finished dataset, that others can give."""
    note = {**content, "command": command_flags(config, elsewhere=finished)}
    if not (config.out / SETTINGS).is_file() or read_json(config.out / SETTINGS) != note:
        write_json(config.out / SETTINGS, note)


def _is_part(file: Path) -> bool:
    """Is it what a killed run has half written?"""
    return file.name.startswith(f".{SETTINGS}.")


def _only_claimed(out: Path) -> bool:
    """Is there nothing yet but the settings, and what a killed run has half written?"""
    rest = (file.relative_to(out) for file in out.rglob("*") if file.is_file())
    return all(str(file) in (SETTINGS, LOCK) or any(part.startswith(".") for part in file.parts) for file in rest)


def _clear_up(out: Path) -> None:
    """Remove what killed runs have half written."""
    for rest in (*out.glob(".*.part"), *out.glob("scenes/*/.*")):
        if rest.is_dir():
            shutil.rmtree(rest)
        else:
            rest.unlink()


def _readme(config: GenerateConfig, dataset: StereoDataset) -> str:
    counts = {name: sum(s["split"] == name for s in dataset.index["samples"]) for name in ("train", "val", "test")}
    drive = f" The views of a scene are a drive; its poses are also in `scenes/<scene>/{TRAJECTORY}` (TUM format)."
    drive = drive if config.trajectory else ""
    datum = """ Heights are metres above
the ground in the middle of each scene; `heightmap` in `sample.json` has where that lies in the heightmap (`at`: metres
east and north of its middle) and how high (`datum`: metres to add to a height for that of the file)."""
    datum = datum if any(scene.relief.heightmap for scene in config.scenes) else ""
    flags = command_flags(config, elsewhere=True)
    made = f"\nMade by\n\n    python -m marssim.generate --out DIR {flags}\n" if flags is not None else ""
    return f"""# Mars stereo dataset

{counted(len(dataset), "stereo pair")} (train {counts["train"]}, val {counts["val"]}, test {counts["test"]}; split by
scene), scene `{config.place}`, seed {config.seed}, rendered with {config.renderer}.
{made}
![contact sheet](contact_sheet.png)

Files of a sample, in `scenes/<scene>/<view>/`: `left.png`, `right.png` (8-bit RGB), `depth.png`
(16-bit: Z = 0.1 m * 10000^(code / 65534); 65535 is the sky), `normal.png` (16-bit RGB, n = 2 code / 65535 - 1, camera
frame x right, y down, z forward), `surface.png` (0 sky, 1 ground, from 2 rocks), `occluded.png` (255: hidden from the
right eye), `sample.json` (rig, pose, scene parameters, what was drawn from their ranges: sun, air, surface, sensor;
SHA-256 of each image).{drive}{datum} `dataset.json` lists all samples with the SHA-256 of their
`sample.json`; `python -m marssim.verify DIR` checks them. Read it with

    from marssim.dataset import StereoDataset
    sample = StereoDataset("DIR", split="train")[0]

Digest of all samples: `{dataset.digest}`
"""


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return exit_code(lambda: _work(parse_generate("python -m marssim.generate", __doc__, args)))


def _work(config: GenerateConfig) -> None:
    with writing_to(config.out):
        dataset = generate(config)
    print(
        f"{counted(len(dataset), 'pair')} in {config.out}, digest {dataset.digest[:16]}, "
        f"see {config.out / 'contact_sheet.png'}"
    )


if __name__ == "__main__":
    sys.exit(main())
