"""Pairs in anybody's folders, by patterns or by a list."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from m3depth.datasets.config import DataConfig
from m3depth.datasets.maps import Kind
from m3depth.datasets.pair_files import PairFiles, Rigs
from marssim.dataset import DatasetError


def folder(root: Path, config: DataConfig, rigs: Rigs) -> Iterator[PairFiles]:
    """Pairs by patterns: left and right images and maps belong together where their * stand for the same text.

    Raises DatasetError that names a pattern that matches nothing, or a left image without a partner.
    """
    truth = config.disparity or config.depth
    for flag, pattern in (("--left", config.left), ("--right", config.right), ("--disparity or --depth", truth)):
        if pattern is None:
            raise DatasetError(f"{root}: --format folder needs {flag}, a pattern as left/*.png")
    assert config.left is not None and config.right is not None and truth is not None
    left, right, maps = (matches(root, pattern) for pattern in (config.left, config.right, truth))
    kind: Kind = "disparity" if config.disparity else "depth"
    for key, path in left.items():
        for others, pattern in ((right, config.right), (maps, truth)):
            if key not in others:
                raise DatasetError(f"{path}: has no partner in {root / pattern}")
        name = path.relative_to(root).with_suffix("").as_posix()
        yield PairFiles(
            name, name, path, right[key], maps[key], kind, rigs(root / "calib.txt", path), unit=config.unit,
        )  # fmt: skip


def matches(root: Path, pattern: str) -> dict[tuple[str, ...], Path]:
    """Files of a pattern by what its wildcards stand for, in order. Raises DatasetError if there are none."""
    parts = re.split(r"(\*\*/|\*|\?)", pattern)
    wild = {"**/": r"((?:.*/)?)", "*": r"([^/]*)", "?": r"([^/])"}
    form = re.compile("".join(wild.get(part) or re.escape(part) for part in parts))
    found = {}
    for path in sorted(root.glob(pattern)):
        match = form.fullmatch(path.relative_to(root).as_posix())
        if match and path.is_file():
            found[match.groups()] = path
    if not found:
        raise DatasetError(f"{root}: no file matches {pattern}")
    return found


def listed(file: Path, root: Path, rigs: Rigs, config: DataConfig) -> Iterator[PairFiles]:
    """Pairs of OpenStereo's lists: "left right disparity" a line, paths from `root`.

    Beside what OpenStereo reads, root/calib/NAME.txt and root/occluded/NAME.png are used where they are there. Raises
    DatasetError that names the list and the line.
    """
    if not file.is_file():
        raise DatasetError(f"{file}: no such list")
    for number, line in enumerate(file.read_text().splitlines(), 1):
        words = line.split()
        if not words:
            continue
        if len(words) != 3:
            raise DatasetError(f"{file}, line {number}: expected left, right and disparity, got {line.strip()!r}")
        left, right, truth = (root / word for word in words)
        name = Path(words[0]).with_suffix("").as_posix()
        occluded = root / "occluded" / f"{left.stem}.png"
        yield PairFiles(
            name, Path(words[0]).stem.rpartition("_")[0] or name, left, right, truth, "disparity",
            rigs(root / "calib" / f"{left.stem}.txt", left), unit=config.unit,
            visible=occluded if occluded.is_file() else None, hidden=lambda mask: mask > 0,
        )  # fmt: skip
