"""Where a command may put its results."""

from __future__ import annotations

from pathlib import Path

from marssim.base.dataset.dataset import EXPORTED, SETTINGS, DatasetError


def check_out(out: Path) -> None:
    """Raise DatasetError unless `out`, the flag --out of a command, is a folder for results, or not there yet.

    A file is none, nor is a dataset of marssim.generate or marssim.export or a folder in one: results would replace its
    files, and marssim.verify would find foreign ones. A folder around one will do.
    """
    if out.exists() and not out.is_dir():
        raise DatasetError(f"--out {out}: is not a folder")
    if _is_dataset(out.resolve()):
        raise DatasetError(f"--out {out}: is a dataset; choose another folder")
    check_around(out)


def check_around(out: Path) -> None:
    """Raise DatasetError if `out`, the flag --out of a command that makes datasets, lies in one."""
    for folder in out.resolve().parents:
        if _is_dataset(folder):
            raise DatasetError(f"--out {out}: lies in the dataset {folder}; choose another folder")


def _is_dataset(folder: Path) -> bool:
    return (folder / EXPORTED).is_file() or ((folder / SETTINGS).is_file() and (folder / "scenes").is_dir())
