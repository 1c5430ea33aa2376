import io
import struct

import cv2
import numpy as np
import pytest
from PIL import Image

from marssim.base.files.geotiff import encode_geotiff

HEIGHTS = np.array([[1.5, np.nan, -2.0], [0.0, 3.25, 7.0]], np.float32)


@pytest.mark.parametrize("values", [HEIGHTS, np.array([[1, 255, 2], [0, 3, 7], [9, 9, 1]], np.uint8)])
def test_other_readers_find_the_numbers_and_their_place(values):
    data = encode_geotiff(values, west=10.0, north=-4.5, cell=0.1, nodata=255 if values.dtype == np.uint8 else np.nan)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), values)
    with Image.open(io.BytesIO(data)) as image:
        np.testing.assert_array_equal(np.asarray(image), values)
        tags = image.tag_v2
    assert tags[33550] == (0.1, 0.1, 0.0) and tags[33922] == (0, 0, 0, 10.0, -4.5, 0)
    assert tags[42113].rstrip("\0") == ("255" if values.dtype == np.uint8 else "nan")
    keys = np.reshape(tags[34735], (-1, 4)).tolist()
    assert keys[0] == [1, 1, 0, len(keys) - 1] and [1025, 0, 1, 1] in keys  # a pixel is an area
    assert [1024, 0, 1, 1] in keys and [3076, 0, 1, 9001] in keys


def test_a_code_of_a_coordinate_system_replaces_the_local_frame():
    with Image.open(io.BytesIO(encode_geotiff(HEIGHTS, 0.0, 0.0, 1.0, np.nan, epsg=32631))) as image:
        keys = np.reshape(image.tag_v2[34735], (-1, 4)).tolist()
        assert [3072, 0, 1, 32631] in keys and 34737 not in image.tag_v2
        assert [key[0] for key in keys[1:]] == [1024, 1025, 3072]  # the code says the unit


def test_other_types_are_refused():
    with pytest.raises(ValueError, match=r"uint8 or float32, got float64 \(2, 3\)"):
        encode_geotiff(HEIGHTS.astype(float), 0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize("frame", ["even", "odd one"])
def test_all_that_lies_behind_an_entry_begins_at_an_even_byte(frame):
    """As TIFF 6.0 demands."""
    data = encode_geotiff(np.zeros((3, 3), np.float32), 0.0, 0.0, 1.0, -32768.0, frame=frame)
    (start,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, start)
    sizes = {2: 1, 3: 2, 4: 4, 12: 8}
    entries = [struct.unpack_from("<HHII", data, start + 2 + 12 * n) for n in range(count)]
    places = [place for _, kind, number, place in entries if sizes[kind] * number > 4]
    assert start % 2 == 0 and len(places) > 3 and not any(place % 2 for place in places)
