import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.files.png import decode_png, is_whole

IMAGE = np.random.default_rng(0).integers(0, 256, (7, 9, 3)).astype(np.uint8)
FILE = cv2.imencode(".png", IMAGE)[1].tobytes()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 3), (5, 3, 3)])
def test_whole_files_are_read_as_they_were_written(kind, shape):
    image = np.random.default_rng(1).integers(0, np.iinfo(kind).max + 1, shape).astype(kind)
    read = decode_png(cv2.imencode(".png", image)[1].tobytes())
    assert read is not None and read.dtype == kind and np.array_equal(read, image)


@given(place=st.integers(0, len(FILE) - 1), bits=st.integers(1, 255))
def test_a_changed_byte_is_noticed(place, bits):
    corrupted = bytearray(FILE)
    corrupted[place] ^= bits
    assert not is_whole(bytes(corrupted))


@given(length=st.integers(0, len(FILE) - 1))
def test_a_file_that_is_cut_off_is_noticed(length):
    assert not is_whole(FILE[:length])


@pytest.mark.parametrize(
    "corrupt", [lambda f: f[:-30], lambda f: f[:60] + b"\0" + f[61:], lambda f: b"", lambda f: b"GIF"]
)
def test_a_broken_file_prints_nothing(corrupt, capfd):
    assert decode_png(corrupt(FILE)) is None
    assert capfd.readouterr() == ("", "")
