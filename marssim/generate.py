"""Generate stereo pairs with ground truth.

    python -m marssim.generate --out data/utopia --pairs 100 --seed 1 --workers 2
    python -m marssim.generate --out data/rocky --scene gale --rocks.k 0.1 --look.sun-elevation-deg 10 20
    python -m marssim.generate --out data/drives --trajectory --drive.step 0.3 --views-per-scene 50

Each scene gives as many pairs as --views-per-scene says. A sample depends on the seed, its scene and its view alone:
any number of workers writes the same bytes, and the same command goes on where an earlier run was stopped.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2

from marssim.base.command.notes import counted
from marssim.base.command.progress import progress
from marssim.base.command.run import exit_code, writing_to
from marssim.base.compute.workers import run_tasks
from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.marks import SETTINGS
from marssim.base.dataset.sample import is_complete
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.out_folder import check_around
from marssim.engines.egl import draws_on_a_card, probe
from marssim.generation.command_line import command_flags
from marssim.generation.config import AUTO, EGL, TINY, GenerateConfig, parse_generate
from marssim.generation.contact_sheet import contact_sheet
from marssim.generation.scene_views import draw_drive, draw_scene, draw_view, generate_scene
from marssim.inspection.integrity import check_written
from marssim.scene.scene import PRESETS, preset
from marssim.scene.trajectory import TRAJECTORY

__all__ = ["GenerateConfig", "generate_dataset", "generate_scene"]

SHEET_SAMPLES = 12


def generate_dataset(config: GenerateConfig) -> StereoDataset:
    """Write the dataset and return it.

    Raises DatasetError if the folder holds another configuration's data, FolderInUse if another command writes to it,
    ValueError for scenes that cannot be built, OSError if it cannot be written, and BrokenExecutor if a worker process
    was killed; what is complete stays, and the same call goes on from there.
    """
    config = _with_rasterizer(_absolute(config))
    _check(config)
    folder = _folder(config)
    with folder.claim(command=command_flags(config, elsewhere=False)):
        folder.note(command=command_flags(config, elsewhere=False))
        return _generate(config, folder)


def _generate(config: GenerateConfig, folder: ResultFolder) -> StereoDataset:
    scenes = _scenes(config)
    names = [f"{scene:05d}/{view:02d}" for scene, views in enumerate(scenes) for view in views]
    _check_written(config.out, names)
    tasks = _shared_out(config, scenes)
    with progress(config.pairs, "pair", "generate") as bar:
        run_tasks(generate_scene, tasks, lambda _, count: bar.update(count), config.workers, config.scheduler)
    folder.clear_partial()
    write_index(config.out, {**folder.settings, "pairs": config.pairs}, names)
    dataset = StereoDataset(config.out)
    chosen = range(0, len(dataset), max(1, len(dataset) // SHEET_SAMPLES))[:SHEET_SAMPLES]
    sheet = contact_sheet([dataset[i] for i in chosen], [dataset.names[i] for i in chosen])
    write_atomically(config.out / "contact_sheet.png", cv2.imencode(".png", sheet[..., ::-1])[1].tobytes())
    write_atomically(config.out / "README.md", _readme(config, dataset).encode())
    folder.note(command=command_flags(config, elsewhere=True))  # the folder may be given to others
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
    folder = _folder(config)
    asked, begun = folder.mark_path, folder.is_begun
    if config.rasterizer == AUTO:
        egl = read_json(asked).get("rasterizer") == EGL if begun else draws_on_a_card()
        config = replace(config, rasterizer=EGL if egl else TINY)
    if config.rasterizer == EGL and not (found := probe()).works:
        what = f"{asked}: the dataset was begun with EGL, which" if begun else "--rasterizer egl: it"
        raise ValueError(f"{what} does not work here: {found.message}")
    return config


def _check(config: GenerateConfig) -> None:
    """Raise what must fail before anything is written: another folder, or scenes in which no camera can stand."""
    if _folder(config).check() is not None:
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


def _folder(config: GenerateConfig) -> ResultFolder:
    """The dataset's folder; as long as no sample is in it, its settings may be replaced."""
    return ResultFolder(
        config.out,
        "dataset",
        mark=SETTINGS,
        settings=as_json(config.content()),
        notes=("command",),
        flags=False,
        check_place=check_around,
        partial=(".*.part", "scenes/*/.*"),
        has_results=_has_visible_files,
    )


def _has_visible_files(out: Path) -> bool:
    """Whether there is more than the settings and what a killed run has half written."""
    rest = (file.relative_to(out) for file in out.rglob("*") if file.is_file())
    return any(str(file) != SETTINGS and not any(part.startswith(".") for part in file.parts) for file in rest)


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
        dataset = generate_dataset(config)
    print(
        f"{counted(len(dataset), 'pair')} in {config.out}, digest {dataset.digest[:16]}, "
        f"see {config.out / 'contact_sheet.png'}"
    )


if __name__ == "__main__":
    sys.exit(main())
