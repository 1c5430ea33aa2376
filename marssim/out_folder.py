"""Where a command may put its results."""

from __future__ import annotations

from pathlib import Path

from marssim.dataset import EXPORTED, SETTINGS, DatasetError


def check_out(out: Path) -> None:
    """Raise DatasetError unless `out`, the flag --out of a command, is a folder for results, or not there yet.

    A file is none, nor is a dataset of marssim.generate or marssim.export or a folder in one: results would replace its
    files, and marssim.verify would find foreign ones. A folder around one will do.
    """
    if out.exists() and not out.is_dir():
        raise DatasetError(f"--out {out}: is not a folder")
    there = out.resolve()
    for folder in (there, *there.parents):
        if (folder / EXPORTED).is_file() or ((folder / SETTINGS).is_file() and (folder / "scenes").is_dir()):
            where = "is a dataset" if folder == there else f"lies in the dataset {folder}"
            raise DatasetError(f"--out {out}: {where}; choose another folder")
