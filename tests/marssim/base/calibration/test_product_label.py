"""What labels say about pixels that hold no data."""

import numpy as np
import pytest

from marssim.base.calibration.product_label import pixel_constants
from marssim.base.calibration.read_pair import read_label

NULL = float(np.array([0xFF7FFFFB], ">u4").view(">f4")[0])  # of ISIS


def pds3(path, *lines: str):
    image = "\r\n ".join(["LINES = 4", "LINE_SAMPLES = 6", *lines])
    path.write_text(f"PDS_VERSION_ID = PDS3\r\nOBJECT = IMAGE\r\n {image}\r\nEND_OBJECT = IMAGE\r\nEND\r\n")
    return read_label(path)


def pds4(path, kind: str, constant: str):
    path.write_text(
        '<?xml version="1.0"?><P xmlns="http://pds.nasa.gov/pds4/pds/v1"><Array_2D_Image><Element_Array><data_type>'
        f"{kind}</data_type></Element_Array><Special_Constants><missing_constant>{constant}</missing_constant>"
        "</Special_Constants></Array_2D_Image></P>"
    )
    return read_label(path)


@pytest.mark.parametrize(
    ("kind", "bits", "constant", "values"),
    [
        ("IEEE_REAL", 32, "16#FF7FFFFB#", (NULL,)),
        ("PC_REAL", 32, "-3.4028226550889045E+38", (NULL,)),
        ("MSB_INTEGER", 16, "16#8000#", (-32768.0,)),
        ("UNSIGNED_INTEGER", 8, "2#11111111#", (255.0,)),
        ("REAL", 8, "10#7#", (7.0,)),
        ("MSB_INTEGER", 16, "(0.0, 0.0, -1)", (-1.0, 0.0)),
        ("IEEE_REAL", 32, "16#7FC00000#", ()),  # NaN, which is no data in any case
        ("MSB_INTEGER", 16, '"N/A"', ()),
    ],
)
def test_constants_of_pds3(tmp_path, kind, bits, constant, values):
    lines = f"SAMPLE_TYPE = {kind}", f"SAMPLE_BITS = {bits}", f"MISSING_CONSTANT = {constant}"
    assert pds3(tmp_path / "left.LBL", *lines).missing == values


@pytest.mark.parametrize(
    ("kind", "constant", "values"),
    [("IEEE754MSBSingle", "16#FF7FFFFB#", (NULL,)), ("IEEE754LSBSingle", "0xFF7FFFFB", (NULL,)),
     ("SignedMSB2", "-32768", (-32768.0,)), ("SignedMSB2", "16#8000#", (-32768.0,)), ("UnsignedByte", "", ())],
)  # fmt: skip
def test_constants_of_pds4(tmp_path, kind, constant, values):
    assert pds4(tmp_path / "left.xml", kind, constant).missing == values


@pytest.mark.parametrize("constant", ["many", "16#GG#", "16#12345#", "1#0#"])
def test_the_field_that_is_no_number_is_named(tmp_path, constant):
    lines = "SAMPLE_TYPE = MSB_INTEGER", "SAMPLE_BITS = 16", "MISSING_CONSTANT = 0", f"INVALID_CONSTANT = {constant}"
    with pytest.raises(ValueError, match=r"left\.LBL: field INVALID_CONSTANT must hold numbers only, has '"):
        pds3(tmp_path / "left.LBL", *lines)


def test_without_the_type_of_a_pixel_a_based_number_is_whole():
    assert pixel_constants({"MISSING_CONSTANT": "16#8000#"}, None) == (32768.0,)
