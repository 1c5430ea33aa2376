"""Write a dataset in the layout of a stereo benchmark, which existing trainers read without changes, or as ROS 2 bags.

    python -m marssim.export data/gale --format sceneflow --out data/gale-sceneflow
    python -m marssim.export data/drive --format rosbag2 --out data/drive-bags

The layouts are those of KITTI 2015, SceneFlow (FlyingThings3D), Middlebury 2014 and MiddEval3, ETH3D two-view, and
OpenStereo's lists. rosbag2 is a bag of each scene: images, CameraInfo, depth, poses and frames; it needs the extra
`real`. A README.md beside the files explains them, and in the layouts of benchmarks how unknown disparities are marked.
The same command completes an export after an interrupted run.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import tyro

from marssim.base.bags.library import check_installed
from marssim.base.command.limits import check_least
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.compute.threads import in_threads
from marssim.base.dataset.dataset import SPLITS, Split, StereoDataset
from marssim.base.dataset.marks import EXPORTED
from marssim.base.files.atomic import naming, write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.results.claim import PARTIAL, ResultFolder
from marssim.base.results.out_folder import check_around
from marssim.layouts.layout import Item, Layout, SameAs
from marssim.layouts.registry import LAYOUTS
from marssim.layouts.rosbag2 import ABOUT as ROSBAG2
from marssim.layouts.rosbag2 import write_scene_bag

SCHEMA = "marssim-export"
BAGS = "rosbag2"  # the one format that is no Layout, as its files hold many samples


@dataclass(frozen=True)
class ExportConfig:
    """Write a dataset in the layout of a stereo benchmark, or as ROS 2 bags."""

    data: tyro.conf.Positional[Path]
    """Folder of the dataset, as marssim.generate writes it."""
    format: Literal["kitti", "sceneflow", "middlebury", "eth3d", "openstereo", "rosbag2"]
    """Layout of the files; rosbag2 writes a ROS 2 bag of each scene."""
    out: Path
    """Folder of the export, outside of the dataset. If it holds a part of the same export, the command adds what is
    missing."""
    split: tuple[Split, ...] = ("train", "val", "test")
    """Splits of the dataset to write. They never share a scene."""
    workers: int = 2
    """Number of threads that write, 1 or more. It does not change the files."""

    def __post_init__(self) -> None:
        check_least(self, workers=1)
        if not self.split or len(set(self.split)) < len(self.split):
            raise ValueError(f"split must name one or more of {', '.join(SPLITS)}, each once")
        if self.format == "sceneflow" and "left" in str(self.out.absolute()):
            raise ValueError(
                f'--out {self.out}: SceneFlow readers replace "left" by "right" anywhere in a path; choose another'
            )


def export(config: ExportConfig) -> int:
    """Write an export, or complete it. If the call fails, the same call continues from there.

    Returns:
        The number of samples in the export.

    Raises:
        DatasetError: The dataset or one of its files cannot be read, the splits are empty, or the output folder holds
            something else, lies in the dataset or contains it.
        FolderInUse: Another command writes to the output folder.
        ImportError: A bag is asked for, and `rosbags` is not installed.
        OSError: The output folder cannot be written.
    """
    dataset = StereoDataset(config.data)
    chosen = [sample for sample in dataset.index["samples"] if sample["split"] in config.split]
    if not chosen:
        raise DatasetError(f"{config.data}: has no pairs of --split {' '.join(config.split)}")
    _check_apart(config)
    if config.format == BAGS:
        check_installed(config.out)
    with _folder(config, chosen).claim():
        return _export(config, chosen)


def _export(config: ExportConfig, chosen: list[dict[str, Any]]) -> int:
    about = ROSBAG2 if config.format == BAGS else f"{LAYOUTS[config.format].about}\n{_DISPARITY}"
    name = config.data.resolve().name
    write_atomically(config.out / "README.md", f"# {name}, exported by marssim\n\n{about}\n{_NAMES}".encode())
    items: dict[str, list[Item]] = {split: [] for split in SPLITS}
    for sample in chosen:
        part = items[sample["split"]]
        part.append(Item(config.data / "scenes" / sample["name"], sample["name"], sample["split"], len(part)))
    if config.format == BAGS:
        _write_bags(config, items)
    else:
        _write_files(config, items)
    write_json(config.out / "samples.json", {split: [item.name for item in items[split]] for split in config.split})
    return len(chosen)


def _write_bags(config: ExportConfig, items: Mapping[str, Sequence[Item]]) -> None:
    """Write a bag of each scene."""
    scenes: dict[tuple[str, str], list[Item]] = {}
    for item in (item for part in items.values() for item in part):
        scenes.setdefault((item.split, item.name.partition("/")[0]), []).append(item)
    with progress(len(scenes), "scene", "export") as bar:
        for _ in in_threads(partial(write_scene_bag, config.out), list(scenes.values()), config.workers):
            bar.update()


def _write_files(config: ExportConfig, items: Mapping[str, Sequence[Item]]) -> None:
    """Write the files of each sample, and the lists of each split."""
    layout = LAYOUTS[config.format]
    jobs = [item for part in items.values() for item in part]
    with progress(len(jobs), "pair", "export") as bar:
        for _ in in_threads(partial(_write, config.out, layout), jobs, config.workers):
            bar.update()
    for split in config.split:
        for path, text in layout.lists(split, items[split]).items():  # empty ones too, since trainers open all of them
            write_atomically(config.out / path, text.encode())


def _check_apart(config: ExportConfig) -> None:
    """Raise DatasetError unless the output folder lies beside the dataset.

    In the dataset, its files would be reported by verify; around it, clearing half-written files would reach into it.
    """
    data, out = config.data.resolve(), config.out.resolve()
    relations = {"is": out == data, "lies in": data in out.parents, "contains": out in data.parents}
    for relation, holds in relations.items():
        if holds:
            raise DatasetError(f"--out {config.out}: {relation} the dataset {config.data}; choose another folder")


def _folder(config: ExportConfig, chosen: list[dict[str, Any]]) -> ResultFolder:
    digest = hashlib.sha256("".join(f"{s['name']} {s['split']} {s['sha256']}\n" for s in chosen).encode()).hexdigest()
    splits = [split for split in SPLITS if split in config.split]
    settings = {"schema": SCHEMA, "version": 1, "format": config.format, "split": splits, "samples": digest}
    return ResultFolder(
        config.out, "export", EXPORTED, settings, digests=("samples",), flags=False, check_place=check_around,
        partial=(f"**/{PARTIAL}",),
    )  # fmt: skip


_DISPARITY = """\
Disparity is x_left - x_right in pixels as the images show it, pixel centres are integers. So it contains the residual
errors of rectification that the dataset was rendered with; depth = f B / disparity is exact where there are none.
These errors may give very far ground a disparity of 0 or less; there it is marked like the sky.
"""

_NAMES = """\
`samples.json` lists the names of the samples in the dataset (scene/view), by split and in the order of the export.
"""


def _write(out: Path, layout: Layout, item: Item) -> None:
    """Write the missing files of one sample."""
    item = replace(item)  # a copy, so that the sample it reads is freed afterwards
    for path, content in layout.sample(item).items():
        target = out / path
        if target.is_file() and target.stat().st_size > 0:
            continue
        with naming(target):
            if isinstance(content, SameAs):
                _link(out / content.path, target)
            else:
                write_atomically(target, content())


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:  # a file system without hard links
        write_atomically(target, source.read_bytes())


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(_work, ExportConfig, "python -m marssim.export", __doc__, args)


def _work(config: ExportConfig) -> None:
    number = export(config)
    print(f"{counted(number, 'pair')} in {config.out} as {config.format}, see {config.out / 'README.md'}")


if __name__ == "__main__":
    sys.exit(main())
