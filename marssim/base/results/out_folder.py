"""Check that a folder may take the results of a command."""

from __future__ import annotations

from pathlib import Path

from marssim.base.dataset.marks import EXPORTED, SETTINGS
from marssim.base.files.json_file import DatasetError


def check_out(out: Path) -> None:
    """Check that a folder may take results, and is neither a dataset nor in one.

    Args:
        out: Value of a command's flag --out. It need not exist. It may contain a dataset.

    Raises:
        DatasetError: `out` is a file, a dataset of marssim.generate or marssim.export, or lies in one.
    """
    check_folder(out)
    if _is_dataset(out.resolve()):
        raise DatasetError(f"--out {out}: is a dataset; choose another folder")
    check_around(out)


def check_around(out: Path) -> None:
    """Check that a folder may take a new dataset.

    Args:
        out: Value of a command's flag --out. It need not exist.

    Raises:
        DatasetError: `out` is a file, or lies in a dataset.
    """
    check_folder(out)
    for folder in out.resolve().parents:
        if _is_dataset(folder):
            raise DatasetError(f"--out {out}: lies in the dataset {folder}; choose another folder")


def check_folder(out: Path) -> None:
    """Check that the folder for results is no file.

    Args:
        out: Value of a command's flag --out. It need not exist.

    Raises:
        DatasetError: `out` is a file.
    """
    if out.exists() and not out.is_dir():
        raise DatasetError(f"--out {out}: is not a folder; choose another")


def _is_dataset(folder: Path) -> bool:
    return (folder / EXPORTED).is_file() or ((folder / SETTINGS).is_file() and (folder / "scenes").is_dir())
