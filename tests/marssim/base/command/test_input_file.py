import pytest

from marssim.base.command.input_file import check_file


def test_a_file_passes_and_nothing_else(tmp_path):
    (tmp_path / "w.bin").write_bytes(b"")
    check_file(tmp_path / "w.bin", "weights file")
    with pytest.raises(IsADirectoryError, match=rf"^{tmp_path}: is a folder, not a weights file$"):
        check_file(tmp_path, "weights file")
    with pytest.raises(FileNotFoundError, match=r"v\.bin: no such file$"):
        check_file(tmp_path / "v.bin")
