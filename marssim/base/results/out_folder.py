"""Where a command may put its results."""

from __future__ import annotations

from pathlib import Path

from marssim.base.dataset.marks import EXPORTED, SETTINGS
from marssim.base.files.json_file import DatasetError, read_json


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


def check_own_results(out: Path, field: str) -> None:
    """Raise DatasetError, before anything is done, if the results.json in a folder is another command's.

    field: what only the caller's has. Its own of an earlier run is replaced.
    """
    path = out / "results.json"
    if path.is_file() and field not in read_json(path):
        raise DatasetError(
            f"--out {out}: results.json there is another command's, or an earlier version's; choose another folder"
        )
