"""Generate stereo pairs of Mars with exact depth, normals and masks.

    python -m marssim.generate --out data/utopia --pairs 100 --seed 1 --workers 2
    python -m marssim.generate --out data/rocky --scene gale --rocks.k 0.1 --look.sun-elevation-deg 10 20
    python -m marssim.generate --out data/mine --scene my_place.json --renderer scan
    python -m marssim.generate --out data/drives --trajectory --drive.step 0.3 --views-per-scene 50
    python -m marssim.generate --out data/worn --scene mixed --faults random
    python -m marssim.generate --out data/own --rig-file camchain.yaml --raw     # also pairs before rectification

A sample depends only on the settings, the seed, its scene and its view. Any number of workers therefore writes the same
files, and the same command completes a dataset after an interrupted run. my_place.json names the values in which your
place differs from a preset, like {"preset": "gale", "rocks": {"k": 0.12}}; marssim.save_place writes a whole file. The
renderer is PyBullet by default; scan is faster and needs no library.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from marssim.base.calibration.calibration_files import calibration_texts
from marssim.base.command.progress import progress
from marssim.base.command.run import exit_code, writing_to
from marssim.base.command.wording import counted
from marssim.base.compute.workers import run_tasks
from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.marks import MARK_NOTES, SETTINGS, SOURCES
from marssim.base.dataset.sample import is_complete
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json
from marssim.base.files.png import encode_png
from marssim.base.results.claim import PARTIAL, ResultFolder
from marssim.base.results.code_state import source_digest
from marssim.base.results.out_folder import check_around
from marssim.engines.egl import draws_on_a_card, probe
from marssim.generation.command_line import command_flags
from marssim.generation.config import AUTO, EGL, TINY, GenerateConfig, parse_generate
from marssim.generation.contact_sheet import contact_sheet
from marssim.generation.readme import dataset_readme, pairs_by_split
from marssim.generation.scene_views import draw_drive, draw_scene, draw_view, generate_scene
from marssim.inspection.integrity import CALIBRATION, check_written
from marssim.render.raw import RawRenderer
from marssim.scene.presets import PRESETS, preset

__all__ = ["GenerateConfig", "generate_dataset", "generate_scene"]

SHEET_SAMPLES = 12  # samples on the contact sheet
UNKNOWN = "unknown"  # stands for the source files of pairs that a dataset of an earlier version holds


def generate_dataset(config: GenerateConfig) -> StereoDataset:
    """Write a dataset, or complete it, and return it.

    Samples that are complete stay if the call fails, and the same call continues from there.

    Raises:
        DatasetError: The folder holds the data of another config.
        FolderInUse: Another command writes to the folder.
        ValueError: A scene cannot be built, or leaves a camera no place to stand.
        ImportError: The renderer's library is not installed.
        OSError: The folder cannot be written.
        BrokenExecutor: A worker process was killed.
    """
    config = _with_rasterizer(_absolute(config))
    _check(config)
    folder = _folder(config)
    with folder.claim(command=command_flags(config, elsewhere=False)) as previous:
        sources = _sources(config, previous)
        folder.note(command=command_flags(config, elsewhere=False), **{SOURCES: sources})
        return _generate(config, folder)


def _sources(config: GenerateConfig, previous: dict[str, Any] | None) -> list[str]:
    """Return the digests of the source files of marssim that rendered pairs of a dataset, with those of now.

    Prints a warning if pairs are left to render and others were rendered by other source files. Pairs of a dataset that
    does not record it are of UNKNOWN ones.
    """
    names = _names(_scenes(config))
    present = sum(is_complete(config.out / "scenes" / name) for name in names)
    recorded = None if previous is None else previous.get(SOURCES)
    is_list = isinstance(recorded, list) and all(isinstance(digest, str) for digest in recorded)
    earlier = list(recorded) if is_list else [UNKNOWN] if present else []  # type: ignore[arg-type]
    if present == len(names):
        return earlier
    now = source_digest(("marssim",))
    if present and set(earlier) - {now, UNKNOWN}:
        print(
            f"warning: {config.out}: {counted(present, 'pair')} in it came from another version of marssim's source "
            "files; the missing ones may look different. Another --out has all of them from this version",
            file=sys.stderr,
        )
    return earlier if now in earlier else [*earlier, now]


def _generate(config: GenerateConfig, folder: ResultFolder) -> StereoDataset:
    scenes = _scenes(config)
    names = _names(scenes)
    _check_written(config.out, names)
    tasks = _shared_out(config, scenes)
    with progress(config.pairs, "pair", "generate") as bar:
        run_tasks(generate_scene, tasks, lambda _, count: bar.update(count), config.workers, config.scheduler)
    folder.clear_partial()
    write_index(config.out, {**folder.settings, "pairs": config.pairs}, names)
    dataset = StereoDataset(config.out)
    chosen = range(0, len(dataset), max(1, len(dataset) // SHEET_SAMPLES))[:SHEET_SAMPLES]
    sheet = contact_sheet([dataset[i] for i in chosen], [dataset.names[i] for i in chosen], total=len(dataset))
    write_atomically(config.out / "contact_sheet.png", encode_png(sheet[..., ::-1]))
    if config.raw and config.raw_rig is not None:
        for name, text in calibration_texts(config.raw_rig).items():
            write_atomically(config.out / CALIBRATION / name, text.encode())
    write_atomically(config.out / "README.md", dataset_readme(config, dataset).encode())
    folder.note(command=command_flags(config, elsewhere=True))  # the folder may be given to others
    return dataset


def _check_written(out: Path, names: list[str]) -> None:
    """Raise DatasetError if a file of an earlier run has changed since, which would stay in the dataset."""
    recorded = _recorded(out / "dataset.json")
    findings = check_written(out, [name for name in names if is_complete(out / "scenes" / name)], recorded)
    if findings:
        more = f" ({len(findings)} files in all)" if len(findings) > 1 else ""
        raise DatasetError(
            f"{out / findings[0].path}: {findings[0].problem}{more}; delete the folder of this sample, and the same "
            "command renders it again"
        )


def _recorded(index: Path) -> dict[str, str]:
    """Return the SHA-256 of each sample.json by the sample's name, as the index records it; none without an index."""
    if not index.is_file():
        return {}
    try:
        return {sample["name"]: sample["sha256"] for sample in StereoDataset(index.parent).index["samples"]}
    except DatasetError as error:
        raise DatasetError(f"{error}; delete this file, and the same command writes it again") from None


def _scenes(config: GenerateConfig) -> list[range]:
    """Return the numbers of the views of each scene."""
    per_scene = config.views_per_scene
    return [range(min(per_scene, config.pairs - first)) for first in range(0, config.pairs, per_scene)]


def _names(scenes: list[range]) -> list[str]:
    """Return the names of all pairs, from the numbers of the views of each scene."""
    return [f"{scene:05d}/{view:02d}" for scene, views in enumerate(scenes) for view in views]


def _shared_out(config: GenerateConfig, scenes: list[range]) -> list[tuple[GenerateConfig, int, list[int], str | None]]:
    """Return the arguments of all calls of generate_scene.

    A scene is one call. The last scenes, of which there are fewer than workers, are split by views, so that no worker
    is idle: of five scenes for two workers, the fifth is split. A drive is not split, nor are the scenes for a cluster,
    whose number of workers is not known.
    """
    sources = None if config.scheduler is None and config.workers == 1 else source_digest(("marssim",))
    shares = config.workers if config.scheduler is None and not config.trajectory else 1
    left_over = len(scenes) % shares
    tasks = []
    for scene, views in enumerate(scenes):
        parts = shares if scene >= len(scenes) - left_over else 1
        tasks += [(config, scene, list(views[part::parts]), sources) for part in range(min(parts, len(views)))]
    return tasks


def _absolute(config: GenerateConfig) -> GenerateConfig:
    """Return the config with absolute paths, since workers, and the command that completes it, may run in another
    folder."""
    scenes = [
        replace(scene, relief=replace(scene.relief, heightmap=str(Path(scene.relief.heightmap).absolute())))
        if scene.relief.heightmap is not None
        else scene
        for scene in config.scenes
    ]
    rig_file = tuple(Path(file).absolute() for file in config.rig_file)
    return replace(config, out=Path(config.out).absolute(), scenes=tuple(scenes), rig_file=rig_file)


def _with_rasterizer(config: GenerateConfig) -> GenerateConfig:
    """Return the config with `rasterizer` decided: by the dataset in the folder, or else by a trial.

    The two rasterizers differ in a few pixels on silhouettes, so that the choice is one of the dataset's settings.
    Raises ValueError if it is EGL and EGL does not work here.
    """
    if config.renderer != "pybullet":
        return config
    folder = _folder(config)
    settings, begun = folder.mark_path, folder.is_begun
    if config.rasterizer == AUTO:
        egl = read_json(settings).get("rasterizer") == EGL if begun else draws_on_a_card()
        config = replace(config, rasterizer=EGL if egl else TINY)
    if config.rasterizer == EGL and not (trial := probe()).works:
        what = f"{settings}: the dataset was begun with EGL, which" if begun else "--rasterizer egl: it"
        raise ValueError(f"{what} does not work here: {trial.message}")
    return config


def _check(config: GenerateConfig) -> None:
    """Raise before anything is written if a lens cannot be rendered, the folder holds other data, or no camera can
    stand in a scene."""
    if config.raw and config.raw_rig is not None:
        try:
            RawRenderer(config.raw_rig)
        except ValueError as error:
            raise ValueError(f"--rig-file {' '.join(map(str, config.rig_file))}: {error}") from None
    if _folder(config).check() is not None:
        names = set(_names(_scenes(config)))
        present = {f"{file.parts[-3]}/{file.parts[-2]}" for file in config.out.glob("scenes/*/[0-9]*/sample.json")}
        if more := len(present - names):
            raise DatasetError(
                f"--pairs {config.pairs}: {config.out} holds {counted(more, 'pair')} more than that; "
                f"ask for at least as many as before, or choose another --out"
            )
        return
    for scene_config in config.scenes:
        if scene_config in map(preset, PRESETS) and not config.trajectory:
            continue  # tests build the presets
        index = next(i for i in range(len(config.scenes)) if config.scene_config(i) == scene_config)
        scene = draw_scene(config, index)
        if config.trajectory:
            draw_drive(config, scene, index)
        else:
            draw_view(config, scene, index, 0)


def _folder(config: GenerateConfig) -> ResultFolder:
    """Return the folder of the dataset. Its settings may change for as long as it holds no sample."""
    return ResultFolder(
        config.out,
        "dataset",
        mark=SETTINGS,
        settings=as_json(config.content()),
        notes=MARK_NOTES,
        flags=False,
        check_place=check_around,
        partial=(PARTIAL, f"{CALIBRATION}/{PARTIAL}", f"scenes/*/{PARTIAL}", "scenes/*/.[0-9]*.partial"),
        has_results=_has_visible_files,
    )


def _has_visible_files(out: Path) -> bool:
    """Return whether the folder holds more than the settings and half-written files of a killed run."""
    if any(out.glob("scenes/*/[0-9]*/sample.json")):  # also where scenes is a link, which rglob does not follow
        return True
    rest = (file.relative_to(out) for file in out.rglob("*") if file.is_file())
    return any(str(file) != SETTINGS and not any(part.startswith(".") for part in file.parts) for file in rest)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return exit_code(lambda: _work(parse_generate("python -m marssim.generate", __doc__, args)))


def _work(config: GenerateConfig) -> None:
    with writing_to(config.out):
        dataset = generate_dataset(config)
    print(
        f"{counted(len(dataset), 'pair')} in {config.out} ({pairs_by_split(dataset)}), digest {dataset.digest[:16]}, "
        f"see {config.out / 'contact_sheet.png'}"
    )


if __name__ == "__main__":
    sys.exit(main())
