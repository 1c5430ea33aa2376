"""Pairs in folders of any structure, found by patterns or by a list."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from m3depth.datasets.config import DataConfig
from m3depth.datasets.maps import Kind
from m3depth.datasets.pair_files import CalibrationFinder, PairFiles, is_above_zero
from marssim.base.files.json_file import DatasetError

WORDS = re.compile(r'"([^"]+)"(?!\S)|(\S+)')  # of a line of a list
FEWEST_SCENES = 10  # of which each split gets one or more
CAMERAS = ("left", "right", "image_0", "image_2", "image_02", "im0")  # folders that are named after a camera


def folder_pairs(root: Path, config: DataConfig, rigs: CalibrationFinder) -> Iterator[PairFiles]:
    """Yield pairs found by patterns: two images and a map belong together where their * stand for the same text.

    The pairs of a folder are one scene, which a split does not divide, if there are enough folders for all splits.

    Args:
        root: Root folder of the dataset.
        config: The patterns, and the unit of the maps.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.

    Raises:
        DatasetError: A pattern matches nothing, or a left image lacks a partner; the message names it.
    """
    truth = config.disparity or config.depth
    for flag, pattern, example in (
        ("--left", config.left, "left/*.png"), ("--right", config.right, "right/*.png"),
        ("--disparity or --depth", truth, "depth/*.png"),
    ):  # fmt: skip
        if pattern is None:
            raise DatasetError(f"{root}: --format folder needs {flag}, a pattern such as {example}")
    assert config.left is not None and config.right is not None and truth is not None
    kind: Kind = "disparity" if config.disparity else "depth"
    patterns = [config.left, config.right, truth] + ([config.normal] if config.normal else [])
    groups = list(partners(root, patterns))
    lefts = [path.relative_to(root) for path, *_ in groups]
    names = [left.with_suffix("").as_posix() for left in lefts]
    if (twice := next((path for path, right, *_ in groups if path == right), None)) is not None:
        raise DatasetError(f"{twice}: --left and --right both find this file")
    scenes = _scenes([left.as_posix() for left in lefts])
    if len(set(scenes)) < FEWEST_SCENES:
        scenes = names
    for name, scene, (path, right, file, *normal) in zip(names, scenes, groups, strict=True):
        yield PairFiles(
            name, scene, path, right, file, kind, rigs(root / "calib.txt", path), unit=config.unit,
            normal=normal[0] if normal else None,
        )  # fmt: skip


def partners(
    root: Path, patterns: Sequence[str], left_out: Callable[[Path], bool] = lambda path: False
) -> Iterator[tuple[Path, ...]]:
    """Yield the files that belong together because the wildcards of all patterns stand for the same text.

    Args:
        root: Folder that the patterns start from.
        patterns: Patterns, that of the left images first.
        left_out: Returns whether a file of the first pattern does not count.

    Raises:
        DatasetError: A pattern matches nothing, or a left image lacks a partner; the message names it.
    """
    first, *others = (matches(root, pattern) for pattern in patterns)
    for key, path in first.items():
        if left_out(path):
            continue
        for files, pattern in zip(others, patterns[1:], strict=True):
            if key not in files:
                raise DatasetError(f"{path}: has no partner in {root / pattern}")
        yield path, *(files[key] for files in others)


def numbers_by_value(files: tuple[Path, ...]) -> list[str | int]:
    """Return what sorts files that belong together by the path of the first, with frame_9 before frame_10.

    Decimals stay in the order of their digits: 12.05 before 12.1.
    """
    parts = re.split(r"((?<![0-9]\.)(?<![0-9])[0-9]+)", files[0].as_posix())
    return [int(part) if n % 2 else part for n, part in enumerate(parts)]


def warn_of_lone_rights(
    root: Path, left: str, right: str, left_out: Callable[[Path], bool] = lambda path: False
) -> None:
    """Print a warning if right images have no left image, so that `partners` leaves them out.

    Args:
        root: Folder that the patterns start from.
        left: The pattern of the left images.
        right: The pattern of the right images.
        left_out: Returns whether a file does not count.

    Raises:
        DatasetError: A pattern matches nothing.
    """
    lefts = matches(root, left)
    lone = [path for key, path in matches(root, right).items() if key not in lefts and not left_out(path)]
    if lone:
        others = f", like {len(lone) - 1} more" if len(lone) > 1 else ""
        print(f"warning: {lone[0]}: has no left image in {root / left} and is left out{others}", file=sys.stderr)


def matches(root: Path, pattern: str) -> dict[tuple[str, ...], Path]:
    """Return the files that match a pattern, in order, by the texts that its wildcards stand for.

    Args:
        root: Folder that the pattern starts from.
        pattern: The pattern, with *, ? or **/.

    Raises:
        DatasetError: There are none, or the pattern is absolute.
    """
    if Path(pattern).anchor:  # on Windows, a path with a root and no drive is not absolute
        raise DatasetError(f"{root}: {pattern} is an absolute pattern; give one that starts from this folder")
    plain = Path(pattern).as_posix()  # without ./ and //, as the paths that glob returns
    parts = re.split(r"(\*\*/|\*|\?)", plain)
    wild = {"**/": r"((?:.*/)?)", "*": r"([^/]*)", "?": r"([^/])"}
    form = re.compile("".join(wild.get(part) or re.escape(part) for part in parts))
    files = {}
    for path in sorted(root.glob(plain.replace("[", "[[]")) if plain != "." else ()):  # glob takes no "."
        match = form.fullmatch(path.relative_to(root).as_posix())
        if match and path.is_file():
            files[match.groups()] = path
    if not files:
        raise DatasetError(f"{root}: no file matches {pattern}")
    return files


def list_pairs(
    file: Path, root: Path, rigs: CalibrationFinder, config: DataConfig, other_lists: Sequence[Path] = ()
) -> Iterator[PairFiles]:
    """Yield the pairs of an OpenStereo list: lines of "left right disparity" with paths from `root`.

    root/calib/NAME.txt and root/occluded/NAME.png, which OpenStereo does not know, are used where they exist.

    Args:
        file: The list.
        root: Folder that its paths start from.
        rigs: Returns the reader of a pair's calibration, from its calibration file and left image.
        config: The unit of the maps.
        other_lists: The lists of other splits, whose pairs get other names. One that cannot be read does not count.

    Raises:
        DatasetError: The list is missing or a line is malformed; the message names list and line.
    """
    rows = read_list(file, (3,))
    lefts = [words[0] for words in rows]
    more_lefts = []
    for other in other_lists:
        with suppress(DatasetError):
            more_lefts += [words[0] for words, _ in _words_of_lines(other) if words]
    for words, name, scene in zip(rows, names_of_list(root, [*lefts, *more_lefts]), _scenes(lefts)):
        left, right, truth = (root / word for word in words)
        occluded = root / "occluded" / f"{left.stem}.png"
        yield PairFiles(
            name, scene, left, right, truth, "disparity",
            rigs(root / "calib" / f"{left.stem}.txt", left), unit=config.unit,
            visible=occluded if occluded.is_file() else None, hidden=is_above_zero,
        )  # fmt: skip


def names_of_list(root: Path, lefts: Sequence[str]) -> list[str]:
    """Return the names of the pairs of a list: the paths of their left images without suffixes.

    If one of these leads elsewhere, by "..", or absolute, the names begin in the folder that all left images have in
    common: a name is also that of a folder of results, which lie in the folder that --out names.

    Args:
        root: Folder that the paths start from.
        lefts: The paths of the left images.
    """
    paths = [Path(left) for left in lefts]
    if any(path.anchor or ".." in path.parts for path in paths):
        paths = [Path(os.path.abspath(root / path)) for path in paths]
        drives = {path.drive for path in paths}
        common = os.path.commonpath([path.parent for path in paths]) if len(drives) == 1 else None
        paths = [path.relative_to(common or path.anchor) for path in paths]
    return [path.with_suffix("").as_posix() for path in paths]


def read_list(file: Path, counts: Sequence[int]) -> list[list[str]]:
    """Return the paths in each line of a list; empty lines, and those that begin with #, do not count.

    Spaces separate the paths, and a path with spaces stands in double quotes.

    Args:
        file: The list.
        counts: How many paths a line may have.

    Raises:
        DatasetError: The list is missing or a line is malformed; the message names list and line.
    """
    rows = []
    for number, (words, line) in enumerate(_words_of_lines(file), 1):
        if words and len(words) not in counts:
            wanted = "left, right and disparity" if 2 not in counts else "left and right"
            hint = "; put paths with spaces in double quotes" if len(words) > max(counts) else "; spaces part them"
            raise DatasetError(f"{file}, line {number}: expected {wanted}, got {line.strip()!r}{hint}")
        if words:
            rows.append(words)
    return rows


def _words_of_lines(file: Path) -> list[tuple[list[str], str]]:
    """Return the words of each line of a list, none for a comment, and the line."""
    if not file.is_file():
        raise DatasetError(f"{file}: no such list")
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise DatasetError(f"{file}: is not a text file") from None
    return [
        ([] if line.lstrip().startswith("#") else ["".join(word) for word in WORDS.findall(line)], line)
        for line in lines
    ]


def _scenes(lefts: Sequence[str]) -> list[str]:
    """Return the scene of each left image of a list, or of a pattern.

    In marssim's names (00003_05) it is the number, else the folder above the images, skipping one named after a camera.
    Where that is the same for all, each pair is a scene of its own.
    """
    paths = [Path(left) for left in lefts]
    numbers = [re.fullmatch(r"(\d{5})_\d+", path.stem) for path in paths]
    if all(numbers):
        return [match[1] for match in numbers if match]
    folders = [(p.parent.parent if p.parent.name.lower() in CAMERAS else p.parent).as_posix() for p in paths]
    return folders if len(set(folders)) > 1 else [path.with_suffix("").as_posix() for path in paths]
