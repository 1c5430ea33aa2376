import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from marssim.base.dataset.encoding import decode_depth, decode_normal, encode_depth, encode_normal


@given(depth=hnp.arrays(np.float64, 20, elements=st.floats(0.1, 1000)))
def test_depth_survives_within_its_step(depth):
    back = decode_depth(encode_depth(depth))
    assert back.dtype == np.float32
    assert np.abs(back / depth - 1).max() < 7.5e-5


def test_the_whole_range_of_codes_is_used_in_order():
    depth = np.geomspace(0.1, 1000, 300_000)
    code = encode_depth(depth)
    assert code[0] == 0 and code[-1] == 65534 and (np.diff(code.astype(int)) >= 0).all()
    assert len(np.unique(code)) == 65535
    known = np.arange(65535, dtype=np.uint16)
    assert np.array_equal(encode_depth(decode_depth(known)), known)  # writing again loses nothing


def test_sky_survives_and_what_lies_beyond_the_range_is_clipped():
    depth = np.array([[np.inf, np.nan, 5000.0, 0.01]])
    assert encode_depth(depth)[0, :2].tolist() == [65535, 65535]
    back = decode_depth(encode_depth(depth))[0]
    assert np.isinf(back[:2]).all() and back[2] == pytest.approx(1000) and back[3] == pytest.approx(0.1)


@given(normal=hnp.arrays(np.float64, (6, 3), elements=st.floats(-1, 1)))
def test_normals_survive(normal):
    normal = normal[np.linalg.norm(normal, axis=1) > 0.1]
    normal = np.append(normal, [[0, 0, -1]], axis=0)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    back = decode_normal(encode_normal(normal[None]))[0]
    assert np.abs(back - normal).max() < 1e-4
    assert np.allclose(np.linalg.norm(back, axis=1), 1, atol=1e-6)


def test_the_sky_has_no_normal():
    normal = np.zeros((2, 2, 3), np.float32)
    normal[0, 0] = [0.6, 0, -0.8]
    code = encode_normal(normal)
    assert not code[1].any()
    assert not decode_normal(code)[1].any() and np.allclose(decode_normal(code)[0, 0], normal[0, 0], atol=1e-4)
