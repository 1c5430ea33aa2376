"""Images of missions: which pixels hold data."""

from importlib.util import find_spec

import numpy as np
import pytest
from raw_pairs import cahvore_pair, img_bytes

from m3depth.rectification.products import read_product
from marssim.base.calibration.read_pair import read_label

pytestmark = pytest.mark.skipif(find_spec("pdr") is None, reason="needs the extra real")
VALUES = np.tile(np.array([-32768, 5, 7, 9], np.int16), (4, 25))


def read(path, constant: bytes):
    # the label is filled up with spaces
    label, _, rest = img_bytes(cahvore_pair().left, VALUES).partition(b"  MISSING_CONSTANT = 0.0")
    end, spaces, data = rest.partition(b" " * 40)
    path.write_bytes(label + b"  MISSING_CONSTANT = " + constant + end + spaces[len(constant) - 3 :] + data)
    return read_product(path, read_label(path))


@pytest.mark.parametrize("constant", [b"-32768", b"16#8000#"])
def test_pixels_of_a_negative_constant_hold_no_data(tmp_path, constant):
    pixels, valid = read(tmp_path / "left.IMG", constant)
    assert pixels.dtype == np.uint16
    np.testing.assert_array_equal(valid, VALUES != -32768)
    np.testing.assert_array_equal(pixels, np.where(valid, VALUES, 0))


def test_other_negative_pixels_are_black(tmp_path):
    pixels, valid = read(tmp_path / "left.IMG", b'"N/A"')
    np.testing.assert_array_equal(pixels, np.maximum(VALUES, 0))
    assert valid.all()


def test_a_constant_far_below_all_values_leaves_their_type(tmp_path, monkeypatch):
    """The other eye may lack it, and both must have one type."""
    wide = VALUES.astype(np.int32)
    wide[wide < 0] = -(2**31)
    monkeypatch.setattr("m3depth.rectification.products._read", lambda path: wide)
    pixels, valid = read(tmp_path / "left.IMG", b"-2147483648")
    assert pixels.dtype == np.uint16 and pixels.max() == 9
    np.testing.assert_array_equal(valid, wide > 0)


def test_a_pixel_of_a_colour_image_holds_data_unless_all_its_bands_are_missing(tmp_path, monkeypatch):
    values = np.full((4, 100, 3), 7, np.uint8)
    values[0, 0], values[0, 1] = 0, (0, 5, 9)  # nothing, and a colour without red
    path = tmp_path / "left.IMG"
    path.write_bytes(img_bytes(cahvore_pair().left, values[..., 0]))
    monkeypatch.setattr("m3depth.rectification.products._read", lambda path: values)
    _, valid = read_product(path, read_label(path))
    assert not valid[0, 0] and valid.sum() == valid.size - 1
