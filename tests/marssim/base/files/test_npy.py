import io
import os

import numpy as np
import pytest

from marssim.base.files.npy import read_npy

VALUES = np.arange(12, dtype=np.float32).reshape(3, 4)


def whole(values: np.ndarray, save=np.save) -> bytes:
    file = io.BytesIO()
    save(file, values)
    return file.getvalue()


def test_a_file_that_numpy_wrote_is_read(tmp_path):
    (tmp_path / "a.npy").write_bytes(whole(VALUES.T))
    assert np.array_equal(read_npy(tmp_path / "a.npy"), VALUES.T)
    assert np.array_equal(read_npy(str(tmp_path / "a.npy")), VALUES.T)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.npy")
    with pytest.raises(OSError, match=r"^is a pipe or a device, not a file$"):
        read_npy(tmp_path / "a.npy")


def wrong_header() -> bytes:
    file = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    np.lib.format.write_array_header_1_0(file, header)
    return file.getvalue() + bytes(100)


FAULTS = {
    "empty": b"",
    "text": b"1.0 2.0",
    "pickle": np.array([{}], object).dumps(),
    "objects": whole(np.array([{}], object)),
    "archive": whole(VALUES, np.savez),
    "only begun": b"\x93NUMPY",
    "cut off": whole(VALUES)[:-1],
    "a header that lies": wrong_header(),
    "a header without end": whole(VALUES).replace(b"}", b" "),
    "a header of no type": whole(VALUES).replace(b"<f4", b"<04"),
    "a negative side": whole(VALUES).replace(b"(3, 4)", b"(3,-4)"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_broken_file_is_one_error_of_one_line(tmp_path, fault):
    (tmp_path / "a.npy").write_bytes(FAULTS[fault])
    with pytest.raises(ValueError, match=r"\S") as error:
        read_npy(tmp_path / "a.npy")
    assert len(str(error.value).splitlines()) == 1


def test_a_file_that_cannot_be_opened(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_npy(tmp_path / "a.npy")
