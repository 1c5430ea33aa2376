import struct

import numpy as np
import pytest

from marssim.pfm import encode_pfm


def test_header_and_rows_are_as_readers_want_them():
    image = np.array([[1.5, np.inf, 3.0], [4.0, 5.0, 6.0]])
    data = encode_pfm(image)
    assert data.startswith(b"Pf\n3 2\n-1\n")
    assert struct.unpack("<6f", data[len(b"Pf\n3 2\n-1\n") :]) == (4.0, 5.0, 6.0, 1.5, np.inf, 3.0)


def test_what_it_cannot_hold():
    with pytest.raises(ValueError, match="NaN"):
        encode_pfm(np.array([[np.nan]]))
    with pytest.raises(ValueError, match=r"\(2, 2, 3\)"):
        encode_pfm(np.zeros((2, 2, 3)))
