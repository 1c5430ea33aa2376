"""Open a dataset of any layout as a sequence of stereo samples.

    open_pairs(Path("KITTI"), "train")  # its files tell the layout
    open_pairs(Path("SimMars6K"), "test", DataConfig(
        format="folder", left="left/*.png", right="right/*.png", depth="depth/*.exr", calib=Path("natecam")))

Folders train, val and test below the root (as marssim.export writes KITTI, Middlebury and ETH3D), SceneFlow's TRAIN,
VAL and TEST, and lists named train.txt, val.txt and test.txt are splits; with folders, a pair's name begins with its
split. Other datasets are split 7:2:1 by scene, in the order of names, as marssim's datasets are. `all` takes every
pair.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

from m3depth.datasets.benchmarks import eth3d, kitti, middlebury, sceneflow, sceneflow_rig
from m3depth.datasets.config import DataConfig, Format, Split
from m3depth.datasets.folders import folder_pairs, list_pairs
from m3depth.datasets.oaisys import is_sensor_name, oaisys
from m3depth.datasets.pair_files import CalibrationFinder, PairFiles, read_pair_files
from m3depth.datasets.rigs import given_rig, rigs_of_files
from m3depth.stereo.pairs import StereoPairs
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import SPLITS, StereoDataset, split_of
from marssim.base.dataset.sample import StereoSample
from marssim.base.files.json_file import DatasetError, read_json

SIGNS: tuple[tuple[Format, tuple[str, ...]], ...] = (  # files that identify a layout, in the root or a split's folder
    ("marssim", ("dataset.json",)),
    ("kitti", ("training/image_2/*_10.png", "training/colored_0/*_10.png", "training/image_0/*_10.png")),
    ("sceneflow", ("FlyingThings3D", "frames_cleanpass", "frames_finalpass", "Driving/frames_*", "Monkaa/frames_*")),
    ("eth3d", ("two_view_training",)),
    ("middlebury", ("*/im0.png", "2014/*/im0.png", "training[FHQ]/*/im0.png", "MiddEval3/training[FHQ]/*/im0.png")),
    ("oaisys", ("batch_*/*/*_rgb_*.png", "*/batch_*/*/*_rgb_*.png")),
)
# the pairs of a root, by layout
READERS: dict[Format, Callable[[Path, DataConfig, CalibrationFinder], Iterator[PairFiles]]] = {
    "kitti": lambda root, config, rigs: kitti(root, rigs),
    "sceneflow": lambda root, config, rigs: sceneflow(root, rigs),
    "middlebury": lambda root, config, rigs: middlebury(root, rigs),
    "eth3d": lambda root, config, rigs: eth3d(root, rigs),
    "oaisys": oaisys,
    "folder": folder_pairs,
}
# other names of splits, which count beside a folder of another split
SPLIT_NAMES = {"training": "train", "validation": "val", "valid": "val", "testing": "test"}
SPLIT_FOLDERS = ("kitti", "middlebury", "eth3d")  # layouts whose roots may lie in folders train, val and test


class PairList:
    """The pairs of one split of a folder. Indexing reads the files of that pair each time.

    Attributes:
        path: The folder.
        split: The split, "all" for every pair.
        pairs: The files of each pair.
        config: How they are read.
        names: Names of the pairs, in order.
        scenes: Scene of each pair; pairs of one scene look alike.
        depth_range: Nearest and farthest depth that is scored [m].
    """

    def __init__(self, path: Path, split: Split, pairs: Sequence[PairFiles], config: DataConfig) -> None:
        self.path, self.split, self.pairs, self.config = path, split, list(pairs), config
        self.names = [pair.name for pair in self.pairs]
        self.scenes = [pair.group for pair in self.pairs]
        self.depth_range = config.depth_range

    def __len__(self) -> int:
        return len(self.pairs)

    @overload
    def __getitem__(self, index: int) -> StereoSample: ...
    @overload
    def __getitem__(self, index: slice) -> list[StereoSample]: ...
    def __getitem__(self, index: int | slice) -> StereoSample | list[StereoSample]:
        if isinstance(index, slice):
            return [read_pair_files(pair, self.config) for pair in self.pairs[index]]
        if not -len(self) <= index < len(self):
            raise IndexError(
                f"{self.path}: split {self.split} holds {counted(len(self), 'pair')}, there is no index {index}"
            )
        return read_pair_files(self.pairs[index], self.config)

    def __iter__(self) -> Iterator[StereoSample]:
        return (self[i] for i in range(len(self)))


def detect(path: Path, config: DataConfig) -> Format:
    """Return the layout of a folder.

    Args:
        path: The folder, or a list.
        config: How it is read; a format in it decides.

    Raises:
        DatasetError: No layout is recognised; the message says which flags to give.
    """
    if config.format != "auto":
        return config.format
    if config.left is not None and (config.disparity is not None or config.depth is not None):
        return "folder"
    if path.is_file() and path.suffix == ".txt":
        return "list"
    if (path / "export.json").is_file():
        name = str(read_json(path / "export.json").get("format"))
        exported: dict[str, Format] = {sign[0]: sign[0] for sign in SIGNS} | {"openstereo": "list"}
        if name in exported:
            return exported[name]
        if (bag := next((each.parent for each in sorted(path.glob("*/*/metadata.yaml"))), None)) is not None:
            raise DatasetError(f"{path}: holds ROS 2 bags and no dataset; m3depth.predict takes one of them, as {bag}")
    if (layout := _layout_by_signs(path)) is not None:
        return layout
    for above in path.resolve().parents[:2]:
        if (layout := _layout_by_signs(above, path.resolve())) is not None:
            raise DatasetError(f"{path}: is a part of a dataset of layout {layout}; give {above}")
    raise DatasetError(
        f"{path}: holds no dataset of marssim, KITTI, SceneFlow, Middlebury, ETH3D or OAISYS; for other folders give "
        "--left, --right, --disparity or --depth (patterns), and --calib"
    )


def sensors_are_named(path: Path, left: str | None, right: str | None) -> bool:
    """Return whether --left and --right name the sensors of an OAISYS dataset, and not patterns of images."""
    both = left is not None and right is not None and is_sensor_name(left) and is_sensor_name(right)
    return both and _layout_by_signs(path) == "oaisys"


def _layout_by_signs(path: Path, part: Path | None = None) -> Format | None:
    """Return the layout whose SIGNS are in a folder; None if there is none.

    Args:
        path: The folder.
        part: A folder below it; only signs in it, or above it, count.
    """
    for name, signs in SIGNS:
        for root in (path, *(path / split for split in SPLITS)):
            for file in (file for sign in signs for file in root.glob(sign)):
                if part is None or file.is_relative_to(part) or part.is_relative_to(file):
                    return name
    return None


def open_pairs(path: str | os.PathLike[str], split: Split, config: DataConfig | None = None) -> StereoPairs:
    """Open the pairs of one split of a dataset; it may hold none.

    Args:
        path: Folder, or list, of the dataset.
        split: "train", "val", "test" or "all".
        config: How the folder is read.

    Returns:
        A sequence of StereoSample; the files of a pair are read and checked when it is indexed.

    Raises:
        DatasetError: The folder has none of the layouts; the message, one line, names the file or the flag.
        ValueError: A split that is unknown, or a flag that the layout does not take.
    """
    config, path = config or DataConfig(), Path(path)
    if split not in (*SPLITS, "all"):
        raise ValueError(f"split {split!r} is unknown; choose from {', '.join(SPLITS)}, all")
    if not path.exists():
        raise DatasetError(f"{path}: no such folder")
    layout = detect(path, config)
    try:
        config.check_layout(layout)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if layout == "marssim":
        return StereoDataset(path, None if split == "all" else split)
    rig_of_flags = given_rig(config)
    rigs: CalibrationFinder = rig_of_flags or (sceneflow_rig if layout == "sceneflow" else rigs_of_files())
    if layout in ("folder", "oaisys") and rig_of_flags is None and not (path / "calib.txt").is_file():
        raise DatasetError(f"{path}: layout {layout} needs --calib, or --focal and --baseline, or {path / 'calib.txt'}")
    if layout == "list":
        return PairList(path, split, _lists(path, split, rigs, config), config)
    read = READERS[layout]
    roots = [name for name in SPLITS if (path / name).is_dir()] if layout in SPLIT_FOLDERS else []
    if roots:
        _check_split_names(path, roots, lambda folder: read(folder, config, rigs))
        parts = [(name, read(path / name, config, rigs)) for name in roots if split in (name, "all")]
        # each split numbers its pairs from 0
        chosen = [
            replace(p, name=f"{name}/{p.name}", group=f"{name}/{p.group}") for name, pairs in parts for p in pairs
        ]
    elif pairs := list(read(path, config, rigs)):
        chosen = pairs if split == "all" else [p for p, part in zip(pairs, splits_of(pairs)) if part == split]
    else:
        raise DatasetError(f"{path}: holds no pairs of layout {layout}")
    return PairList(path, split, chosen, config)


def _check_split_names(root: Path, splits: Sequence[str], read: Callable[[Path], Iterator[PairFiles]]) -> None:
    """Raise DatasetError if pairs lie beside the folders of splits, in one that has another name of a split."""
    for name, split in SPLIT_NAMES.items():
        if any(read(root / name)):
            others = " and ".join(str(root / other) for other in splits)
            raise DatasetError(f"{root / name}: holds pairs beside {others}; call the folder {split}")


def open_folders(paths: Sequence[Path], split: Split, config: DataConfig | None = None) -> list[StereoPairs]:
    """Open one split of several datasets; the reader's settings pass by marssim's if other layouts are among them.

    Args:
        paths: Folders, or lists, of the datasets.
        split: "train", "val", "test" or "all".
        config: How the folders are read.

    Returns:
        The pairs of each folder, in the order of `paths`.

    Raises:
        DatasetError, ValueError: As of open_pairs.
    """
    opened = []
    for path in paths:
        own = reader_config_for(path, paths, config or DataConfig())
        try:
            opened.append(open_pairs(path, split, own))
        except DatasetError as error:
            if len(paths) > 1 and own.changed_fields():
                raise DatasetError(f"{error}; the flags are for all folders but those of marssim.generate") from None
            raise
    return opened


def reader_config_for(path: Path, paths: Sequence[Path], config: DataConfig) -> DataConfig:
    """Return how one of several folders is read: without flags if it is marssim's and another one is not.

    Args:
        path: The folder, one of `paths`.
        paths: All folders of the command.
        config: How the folders are read.
    """
    of_marssim = [_is_of_marssim(other) for other in paths]
    return DataConfig() if _is_of_marssim(path) and config.format != "marssim" and not all(of_marssim) else config


def _is_of_marssim(path: Path) -> bool:
    return (path / "dataset.json").is_file()


def splits_of(pairs: Sequence[PairFiles]) -> list[str]:
    """Return the split of each pair: that of a folder in its name, else 7:2:1 by groups in order.

    The folder is the first one (SceneFlow's TRAIN), or one below it that is named after two or three splits, as in
    left/train and left/test.

    Raises:
        DatasetError: Some pairs lie in folders named after splits, and others do not.
    """
    folders = [pair.name.lower().split("/") for pair in pairs]
    for place in range(max(1, max(map(len, folders)) - 1)):
        at_place = [parts[place] if place == 0 or place < len(parts) - 1 else "" for parts in folders]
        named = [SPLIT_NAMES.get(name, name) for name in at_place]
        if len(set(named)) == 1:
            named = at_place
        splits, present = set(named) & set(SPLITS), set(named)
        if not splits or (place > 0 and len(splits) == 1):
            continue
        if splits < present:
            split = next(pair for pair, name in zip(pairs, named) if name in SPLITS)
            other = next(pair for pair, name in zip(pairs, named) if name not in SPLITS)
            raise DatasetError(
                f"{split.left}: lies in a folder of a split, but {other.left} does not; name all folders train, val "
                "and test, or none"
            )
        if "val" in present or "train" not in present:
            return named
        # SceneFlow has no validation set: a tenth of the training scenes becomes one.
        train = {g: i for i, g in enumerate(dict.fromkeys(p.group for p, n in zip(pairs, named) if n == "train"))}
        return ["val" if n == "train" and train[p.group] % 10 == 9 else n for p, n in zip(pairs, named)]
    order = {group: i for i, group in enumerate(dict.fromkeys(pair.group for pair in pairs))}
    return [split_of(order[pair.group]) for pair in pairs]


def _lists(path: Path, split: Split, rigs: CalibrationFinder, config: DataConfig) -> list[PairFiles]:
    """Return the pairs of a split from one list, or from the lists train.txt, val.txt and test.txt of a folder."""
    if path.is_file():
        pairs = list(list_pairs(path, path.parent, rigs, config))
        return pairs if split == "all" else [p for p, part in zip(pairs, splits_of(pairs)) if part == split]
    present = [name for name in SPLITS if (path / f"{name}.txt").is_file()]
    if not present:
        raise DatasetError(f"{path}: holds no list named train.txt, val.txt or test.txt")
    files = {name: path / f"{name}.txt" for name in present}
    lists = [name for name in present if split in (name, "all")]
    others = {name: [file for other, file in files.items() if other != name] for name in lists}
    return [pair for name in lists for pair in list_pairs(files[name], path, rigs, config, others[name])]
