"""Open a dataset of any layout as a sequence of stereo samples.

    open_pairs(Path("KITTI"), "train")                                          # told by what lies there
    open_pairs(Path("SimMars6K"), "test", DataConfig(
        format="folder", left="left/*.png", right="right/*.png", depth="depth/*.exr", calib=Path("natecam")))

A root with folders train, val and test (as marssim.export writes KITTI, Middlebury and ETH3D), SceneFlow's TRAIN, VAL
and TEST, and lists called train.txt, val.txt and test.txt are split so. Anything else is split 7:2:1 by scene, in the
order of names, as marssim's datasets are; `all` takes every pair.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from m3depth.datasets.benchmarks import eth3d, kitti, middlebury, sceneflow, sceneflow_rig
from m3depth.datasets.config import DataConfig, Format, Part
from m3depth.datasets.folders import folder, listed
from m3depth.datasets.oaisys import oaisys
from m3depth.datasets.pair_files import PairFiles, Rigs, read_pair_files
from m3depth.datasets.rigs import file_rig, given_rig
from m3depth.stereo.pairs import StereoPairs
from marssim.base.dataset.dataset import SPLITS, StereoDataset, split_of
from marssim.base.dataset.sample import StereoSample
from marssim.base.files.json_file import DatasetError, read_json

SIGNS: tuple[tuple[Format, tuple[str, ...]], ...] = (  # what tells a layout, below the root or one of its splits
    ("marssim", ("dataset.json",)),
    ("kitti", ("training/image_2/*_10.png", "training/colored_0/*_10.png", "training/image_0/*_10.png")),
    ("sceneflow", ("FlyingThings3D", "frames_cleanpass", "frames_finalpass")),
    ("eth3d", ("two_view_training",)),
    ("middlebury", ("*/im0.png", "2014/*/im0.png", "training[FHQ]/*/im0.png", "MiddEval3/training[FHQ]/*/im0.png")),
    ("oaisys", ("batch_*/*/*_rgb_*.png", "*/batch_*/*/*_rgb_*.png")),
)


class PairList:
    """Pairs that were found in a folder; indexing reads the files of that pair anew.

    names, scenes: of the pairs, in order; pairs of one scene are alike. path, split: where and which. depth_range [m]:
    what is scored.
    """

    def __init__(self, path: Path, split: Part, pairs: Sequence[PairFiles], config: DataConfig) -> None:
        self.path, self.split, self.pairs, self.config = path, split, list(pairs), config
        self.names = [pair.name for pair in self.pairs]
        self.scenes = [pair.group for pair in self.pairs]
        self.depth_range = config.depth_range

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, index: int) -> StereoSample:
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.path}: split {self.split} holds {len(self)} pairs, there is no index {index}")
        return read_pair_files(self.pairs[index], self.config)

    def __iter__(self) -> Iterator[StereoSample]:
        return (self[i] for i in range(len(self)))


def detect(path: Path, config: DataConfig) -> Format:
    """The layout of a folder. Raises DatasetError that says what may be given if nothing tells it."""
    if config.format != "auto":
        return config.format
    if config.left is not None and (config.disparity is not None or config.depth is not None):
        return "folder"
    if path.is_file() and path.suffix == ".txt":
        return "list"
    if (path / "export.json").is_file():
        name = str(read_json(path / "export.json").get("format"))
        known: dict[str, Format] = {sign[0]: sign[0] for sign in SIGNS} | {"openstereo": "list"}
        if name in known:
            return known[name]
    if (told := _told_by_signs(path)) is not None:
        return told
    for above in path.resolve().parents[:2]:
        if (told := _told_by_signs(above, path.resolve())) is not None:
            raise DatasetError(f"{path}: is a part of a dataset of layout {told}; give {above}")
    raise DatasetError(
        f"{path}: holds no dataset of marssim, KITTI, SceneFlow, Middlebury, ETH3D or OAISYS; for other folders give "
        "--left, --right, --disparity or --depth (patterns), and --calib"
    )


def _told_by_signs(path: Path, part: Path | None = None) -> Format | None:
    """The layout by SIGNS. part: a folder below, and only what lies in it, or holds it, is a sign."""
    for name, signs in SIGNS:
        for root in (path, *(path / split for split in SPLITS)):
            for found in (found for sign in signs for found in root.glob(sign)):
                if part is None or found.is_relative_to(part) or part.is_relative_to(found):
                    return name
    return None


def open_pairs(path: Path, split: Part, config: DataConfig | None = None) -> StereoPairs:
    """The pairs of one split of a dataset; it may hold none.

    Raises DatasetError, one line that names the file or the flag, if the folder is none of the layouts, and ValueError
    for a flag that does not belong to it. Files of pairs are checked when they are read.
    """
    config = config or DataConfig()
    if not path.exists():
        raise DatasetError(f"{path}: no such folder")
    layout = detect(path, config)
    try:
        config.check_layout(layout)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if layout == "marssim":
        return StereoDataset(path, None if split == "all" else split)
    given = given_rig(config)
    rigs: Rigs = given or (sceneflow_rig if layout == "sceneflow" else file_rig)
    if layout in ("folder", "oaisys") and given is None and not (path / "calib.txt").is_file():
        raise DatasetError(f"{path}: layout {layout} needs --calib, or --focal and --baseline, or {path / 'calib.txt'}")
    if layout == "list":
        return PairList(path, split, _lists(path, split, rigs, config), config)
    readers: dict[str, Callable[[Path], Iterator[PairFiles]]] = {
        "kitti": lambda root: kitti(root, rigs),
        "sceneflow": lambda root: sceneflow(root, rigs),
        "middlebury": lambda root: middlebury(root, rigs),
        "eth3d": lambda root: eth3d(root, rigs),
        "oaisys": lambda root: oaisys(root, config, rigs),
        "folder": lambda root: folder(root, config, rigs),
    }
    read = readers[layout]
    roots = [name for name in SPLITS if (path / name).is_dir()] if layout in ("kitti", "middlebury", "eth3d") else []
    if roots:
        chosen = [pair for name in roots if split in (name, "all") for pair in read(path / name)]
    elif found := list(read(path)):
        chosen = [pair for pair, part in zip(found, splits_of(found)) if split in (part, "all")]
    else:
        raise DatasetError(f"{path}: holds no pairs of layout {layout}")
    return PairList(path, split, chosen, config)


def splits_of(pairs: Sequence[PairFiles]) -> list[str]:
    """The split of each pair: what its name begins with (SceneFlow's TRAIN), else 7:2:1 by groups in order."""
    named = [pair.name.split("/")[0].lower() for pair in pairs]
    there = set(named)
    if there <= set(SPLITS):
        if "val" in there or "train" not in there:
            return named
        # SceneFlow brings no validation set: a tenth of the training scenes.
        train = {g: i for i, g in enumerate(dict.fromkeys(p.group for p, n in zip(pairs, named) if n == "train"))}
        return ["val" if n == "train" and train[p.group] % 10 == 9 else n for p, n in zip(pairs, named)]
    order = {group: i for i, group in enumerate(dict.fromkeys(pair.group for pair in pairs))}
    return [split_of(order[pair.group]) for pair in pairs]


def _lists(path: Path, split: Part, rigs: Rigs, config: DataConfig) -> list[PairFiles]:
    if path.is_file():
        found = list(listed(path, path.parent, rigs, config))
        return [pair for pair, part in zip(found, splits_of(found)) if split in (part, "all")]
    there = [name for name in SPLITS if (path / f"{name}.txt").is_file()]
    if not there:
        raise DatasetError(f"{path}: holds no list called train.txt, val.txt or test.txt")
    return [p for name in there if split in (name, "all") for p in listed(path / f"{name}.txt", path, rigs, config)]
