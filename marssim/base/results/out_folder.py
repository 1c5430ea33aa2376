"""Which places take the results of a command."""

from __future__ import annotations

from pathlib import Path

from marssim.base.dataset.marks import EXPORTED, SETTINGS
from marssim.base.files.json_file import DatasetError


def check_out(out: Path) -> None:
    """Check that a folder may take results, which neither replace files of a dataset nor look like its own.

    Args:
        out: The flag --out of a command. It need not exist. A folder around a dataset will do.

    Raises:
        DatasetError: `out` is a file, a dataset of marssim.generate or marssim.export, or lies in one.
    """
    check_folder(out)
    if _is_dataset(out.resolve()):
        raise DatasetError(f"--out {out}: is a dataset; choose another folder")
    check_around(out)


def check_around(out: Path) -> None:
    """Check that a folder may take a new dataset. Raises DatasetError if it is a file or lies in a dataset."""
    check_folder(out)
    for folder in out.resolve().parents:
        if _is_dataset(folder):
            raise DatasetError(f"--out {out}: lies in the dataset {folder}; choose another folder")


def check_folder(out: Path) -> None:
    """Raise DatasetError if there is a file where the folder for results should be."""
    if out.exists() and not out.is_dir():
        raise DatasetError(f"--out {out}: is not a folder")


def _is_dataset(folder: Path) -> bool:
    return (folder / EXPORTED).is_file() or ((folder / SETTINGS).is_file() and (folder / "scenes").is_dir())
