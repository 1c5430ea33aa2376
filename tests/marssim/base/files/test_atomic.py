import os
from pathlib import Path

import pytest

from marssim.base.files import atomic
from marssim.base.files.atomic import write_atomically, written_atomically


def test_folders_are_made_and_nothing_else_is_left(tmp_path) -> None:
    path = tmp_path / "a" / "b.json"
    for content in (b"old", b"new"):
        write_atomically(path, content)
        assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


def test_a_write_that_fails_keeps_the_old_file(tmp_path, monkeypatch) -> None:
    path = tmp_path / "b.json"
    path.write_bytes(b"old")

    def full_disk(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_atomically(path, b"new")
    assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == b"old"


@pytest.mark.parametrize("refusals", [2, 1000])
def test_windows_is_asked_again_while_another_program_has_the_file_open(tmp_path, monkeypatch, refusals) -> None:
    replace, asked = Path.replace, []

    def refuse(path: Path, target: Path) -> Path:
        asked.append(path)
        if len(asked) <= refusals:
            raise PermissionError(13, "Access is denied", str(target))
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(PermissionError):  # elsewhere at once
        write_atomically(tmp_path / "a.json", b"new")
    assert len(asked) == 1
    asked.clear()
    monkeypatch.setattr(atomic, "WINDOWS", True)
    monkeypatch.setattr(atomic, "PATIENCE", 0.2)
    if refusals == 2:
        write_atomically(tmp_path / "a.json", b"new")
        assert (tmp_path / "a.json").read_bytes() == b"new"
    else:
        with pytest.raises(PermissionError, match=r"a\.json"):
            write_atomically(tmp_path / "a.json", b"new")
    assert len(asked) > 2


@pytest.mark.parametrize("before", [None, b"old"])
def test_a_file_that_is_written_by_its_name_appears_when_the_block_ends(tmp_path, before) -> None:
    path = tmp_path / "film.mp4"
    if before is not None:
        path.write_bytes(before)
    with pytest.raises(KeyboardInterrupt), written_atomically(path) as part:
        part.write_bytes(b"half")
        raise KeyboardInterrupt
    assert (path.read_bytes() if path.exists() else None) == before
    with written_atomically(path) as part:
        assert part.name == path.name
        part.write_bytes(b"whole")
        assert (path.read_bytes() if path.exists() else None) == before
    assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == b"whole"


def test_a_missing_folder_is_named_by_the_file_in_it(tmp_path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none/film\.mp4"), written_atomically(tmp_path / "none" / "film.mp4"):
        pytest.fail("there is no such folder")
