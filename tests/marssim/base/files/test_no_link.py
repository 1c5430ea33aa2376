import errno
import os
import resource

import pytest

from marssim.base.files.no_link import append_line


@pytest.mark.parametrize("system", ["POSIX", "Windows"])
def test_lines_are_added_to_a_file_but_not_through_a_link(tmp_path, monkeypatch, system):
    if system == "Windows":
        monkeypatch.delattr(os, "O_NOFOLLOW")
        monkeypatch.setattr("marssim.base.files.no_link.NO_LINK", 0)
    log, others = tmp_path / "log.jsonl", tmp_path / "others.txt"
    append_line(log, '{"a": "ä"}')
    append_line(log, "{}")
    assert log.read_text(encoding="utf-8") == '{"a": "ä"}\n{}\n'
    (tmp_path / "link.jsonl").symlink_to(others)  # others.txt does not exist yet
    with pytest.raises(OSError, match=rf"^{tmp_path}/link\.jsonl: is a link, through which nothing is written"):
        append_line(tmp_path / "link.jsonl", "{}")
    assert not others.exists()


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OSError) as error:
        append_line(tmp_path / "none" / "log.jsonl", "{}")
    assert error.value.filename == str(tmp_path / "none" / "log.jsonl")


def test_a_line_that_a_full_disk_cuts_off_is_an_error_and_leaves_nothing(tmp_path):
    """A limit of files' sizes lets the system write a part of a line and report no error, as a full disk does."""
    log = tmp_path / "log.jsonl"
    append_line(log, '{"step": 1}')
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (log.stat().st_size + 5, limits[1]))
    try:
        with pytest.raises(OSError) as error:
            append_line(log, '{"step": 2}')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert error.value.errno == errno.ENOSPC and error.value.filename == str(log)
    append_line(log, '{"step": 3}')
    assert log.read_text() == '{"step": 1}\n{"step": 3}\n'
