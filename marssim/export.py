"""Write a dataset in a layout that existing stereo trainers read as it is.

    python -m marssim.export data/gale --format sceneflow --out data/gale-sceneflow

Formats: KITTI 2015, SceneFlow (FlyingThings3D), Middlebury 2014 and MiddEval3, ETH3D two-view, and OpenStereo's
lists. A README.md beside the files says what is where, and how missing disparities are marked. The same command goes
on where an earlier one was stopped.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import tyro

from marssim.base.command.notes import counted
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command
from marssim.base.compute.threads import in_threads
from marssim.base.dataset.dataset import SPLITS, Split, StereoDataset
from marssim.base.dataset.marks import EXPORTED
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.results.claim import ResultFolder
from marssim.base.results.out_folder import check_around
from marssim.layouts.layout import Item, Layout, SameAs
from marssim.layouts.registry import LAYOUTS

SCHEMA = "marssim-export"


@dataclass(frozen=True)
class ExportConfig:
    """Write a dataset in the layout of a well-known stereo benchmark."""

    data: tyro.conf.Positional[Path]
    """dataset folder, as marssim.generate writes it"""
    format: Literal["kitti", "sceneflow", "middlebury", "eth3d", "openstereo"]
    """layout to write"""
    out: Path
    """folder to write, outside of the dataset; one that holds part of the same export is completed"""
    split: tuple[Split, ...] = ("train", "val", "test")
    """parts of the dataset to write; they never share a scene"""
    workers: int = 2
    """threads to write in; the files do not depend on it"""

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        if not self.split or len(set(self.split)) < len(self.split):
            raise ValueError(f"--split must name one or more of {', '.join(SPLITS)}, each once")
        if self.format == "sceneflow" and "left" in str(self.out.absolute()):
            raise ValueError(
                f'--out {self.out}: SceneFlow readers replace "left" by "right" anywhere in a path; choose another'
            )


def export(config: ExportConfig) -> int:
    """Write what is missing of the export. Returns the number of samples that are there now.

    Raises DatasetError if the dataset or one of its files cannot be read, if none of the splits holds a sample, or if
    the output folder holds something else or lies in the dataset or around it, FolderInUse if another command writes to
    it, and OSError if it cannot be written; the same call goes on from there.
    """
    dataset = StereoDataset(config.data)
    chosen = [sample for sample in dataset.index["samples"] if sample["split"] in config.split]
    if not chosen:
        raise DatasetError(f"{config.data}: holds no pairs of --split {' '.join(config.split)}")
    _check_apart(config)
    with _folder(config, chosen).claim():
        return _export(config, chosen)


def _export(config: ExportConfig, chosen: list[dict[str, Any]]) -> int:
    layout = LAYOUTS[config.format]
    name = config.data.resolve().name
    write_atomically(config.out / "README.md", f"# {name}, exported by marssim\n\n{layout.about}\n{_NAMES}".encode())
    items: dict[str, list[Item]] = {split: [] for split in SPLITS}
    for sample in chosen:
        there = items[sample["split"]]
        there.append(Item(config.data / "scenes" / sample["name"], sample["name"], sample["split"], len(there)))
    jobs = [item for there in items.values() for item in there]
    with progress(len(jobs), "pair", "export") as bar:
        for _ in in_threads(partial(_write, config.out, layout), jobs, config.workers):
            bar.update()
    for split in config.split:
        for path, text in layout.lists(split, items[split]).items():  # empty ones too: trainers open them all
            write_atomically(config.out / path, text.encode())
    write_json(config.out / "samples.json", {split: [item.name for item in items[split]] for split in config.split})
    return len(chosen)


def _check_apart(config: ExportConfig) -> None:
    """Raise DatasetError unless the output folder lies beside the dataset.

    In it, verify would find foreign files; around it, what killed commands have left would be cleared up in it too.
    """
    data, out = config.data.resolve(), config.out.resolve()
    where = "is" if out == data else "lies in" if data in out.parents else "contains" if out in data.parents else None
    if where is not None:
        raise DatasetError(f"--out {config.out}: {where} the dataset {config.data}; choose another folder")


def _folder(config: ExportConfig, chosen: list[dict[str, Any]]) -> ResultFolder:
    digest = hashlib.sha256("".join(f"{s['name']} {s['split']} {s['sha256']}\n" for s in chosen).encode()).hexdigest()
    splits = [split for split in SPLITS if split in config.split]
    settings = {"schema": SCHEMA, "version": 1, "format": config.format, "split": splits, "samples": digest}
    return ResultFolder(
        config.out, "export", EXPORTED, settings, digests=("samples",), flags=False, check_place=check_around,
        partial=("**/.*.part",),
    )  # fmt: skip


_NAMES = """\
Disparity is x_left - x_right in pixels, pixel centres are integers. `samples.json` lists the dataset's own names
(scene/view) of each split, in the order of the export.
"""


def _write(out: Path, layout: Layout, item: Item) -> None:
    """Make the files of one sample that are not there yet."""
    item = replace(item)  # what it reads goes when it is written
    for path, content in layout.sample(item).items():
        target = out / path
        if target.is_file() and target.stat().st_size > 0:
            continue
        try:
            if isinstance(content, SameAs):
                _link(out / content.path, target)
            else:
                write_atomically(target, content())
        except OSError as error:
            error.filename = error.filename or str(target)  # a full disk does not say where
            raise


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:  # a file system without hard links
        write_atomically(target, source.read_bytes())


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return run_command(_work, ExportConfig, "python -m marssim.export", __doc__, args)


def _work(config: ExportConfig) -> None:
    number = export(config)
    print(f"{counted(number, 'pair')} in {config.out} as {config.format}, see {config.out / 'README.md'}")


if __name__ == "__main__":
    sys.exit(main())
