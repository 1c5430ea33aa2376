import struct

import numpy as np
import pytest

from marssim.base.files.pfm import decode_pfm, encode_pfm


def test_header_and_rows_are_as_readers_want_them():
    image = np.array([[1.5, np.inf, 3.0], [4.0, 5.0, 6.0]])
    data = encode_pfm(image)
    assert data.startswith(b"Pf\n3 2\n-1\n")
    assert struct.unpack("<6f", data[len(b"Pf\n3 2\n-1\n") :]) == (4.0, 5.0, 6.0, 1.5, np.inf, 3.0)


def test_nan_and_other_shapes_are_refused():
    with pytest.raises(ValueError, match="NaN"):
        encode_pfm(np.array([[np.nan]]))
    with pytest.raises(ValueError, match=r"\(2, 2, 4\)"):
        encode_pfm(np.zeros((2, 2, 4)))


def test_a_written_map_is_read_back():
    image = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32)
    image[2, 3] = np.inf
    assert np.array_equal(decode_pfm(encode_pfm(image)), image)
    vectors = np.random.default_rng(1).normal(size=(5, 7, 3)).astype(np.float32)
    assert np.array_equal(decode_pfm(encode_pfm(vectors)), vectors)


@pytest.mark.parametrize("scale", ["-0.003922", "-1.0", "-3e-2", "1", "0.5"])
def test_only_the_sign_of_the_scale_counts(scale):
    """By Middlebury's rules, a scale of 1/255 in the header does not turn 10 px into 2550."""
    values = np.array([[[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [10, 11, 12]]], np.float32)
    order = "<f4" if scale.startswith("-") else ">f4"
    colour = f"PF\r\n2 2\r\n{scale}\r\n".encode() + values[::-1].astype(order).tobytes()
    grey = f"Pf\n2 2\n{scale}\n".encode() + values[::-1, :, 0].astype(order).tobytes()
    assert np.array_equal(decode_pfm(colour), values) and np.array_equal(decode_pfm(grey), values[..., 0])


@pytest.mark.parametrize(
    "data",
    [
        b"", b"P5\n2 2\n255\nabcd", b"Pf\n2 2\n-1\n" + bytes(15), b"Pf\n2 2\n-1\n" + bytes(17), b"Pf\n0 2\n-1\n",
        b"Pf\n2 2\n-1e-e\n" + bytes(16), b"Pf\n2 2", b"Pf\n-2 -2\n-1\n" + bytes(16),
    ],
)  # fmt: skip
def test_a_broken_file_gives_none(data):
    assert decode_pfm(data) is None


def test_a_header_of_many_digits_is_no_pfm():
    assert decode_pfm(b"Pf\n" + b"1" * 5000 + b" 3\n-1\n") is None
