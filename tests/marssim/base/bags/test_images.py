"""Images of every encoding, against the pixels that they were packed from."""

import cv2
import numpy as np
import pytest

from marssim.base.bags.images import ENCODINGS, cloud_arrays, image_array
from marssim.base.bags.library import new_message
from marssim.base.bags.messages import header

RNG = np.random.default_rng(0)
RGB = cv2.resize(RNG.integers(0, 256, (3, 4, 3)).astype(np.uint8), (12, 8), interpolation=cv2.INTER_LINEAR)
BAYER = {"rggb": "RGGB", "bggr": "BGGR", "gbrg": "GBRG", "grbg": "GRBG"}


def message(encoding, rows, width=12, height=8, **fields):
    """rows: (height, bytes) uint8"""
    values = {"is_bigendian": 0, "step": rows.shape[1], "data": rows.reshape(-1), **fields}
    return new_message(
        "sensor_msgs/Image", header=header(1, "eye"), height=height, width=width, encoding=encoding, **values
    )


def packed(values):
    return np.ascontiguousarray(values).reshape(len(values), -1).view(np.uint8)


def mosaic(pattern):
    """The colour that each pixel of a sensor with a pattern, its first two rows, sees."""
    out = np.zeros((8, 12), np.uint8)
    for at, colour in enumerate(pattern):
        row, column = divmod(at, 2)
        out[row::2, column::2] = RGB[row::2, column::2, "RGB".index(colour)]
    return out


@pytest.mark.parametrize("encoding", sorted(set(ENCODINGS)))
def test_each_encoding_gives_the_pixels_that_were_packed(encoding):
    grey, wide = RGB[..., 0], RGB.astype(np.uint16) * 257
    sources = {
        "mono8": grey, "8UC1": grey, "mono16": wide[..., 0], "16UC1": wide[..., 0], "32FC1": grey.astype("<f4"),
        "rgb8": RGB, "rgb16": wide, "bgr8": RGB[..., ::-1], "8UC3": RGB[..., ::-1], "bgr16": wide[..., ::-1],
        "rgba8": np.dstack([RGB, grey]), "bgra8": np.dstack([RGB[..., ::-1], grey]),
    }  # fmt: skip
    if encoding.startswith("bayer"):
        image = image_array(message(encoding, packed(mosaic(BAYER[encoding[6:10]]))))
        assert image.shape == RGB.shape
        pattern = BAYER[encoding[6:10]]
        for at, colour in enumerate(pattern):  # where the sensor saw a colour, it stays
            row, column = divmod(at, 2)
            channel = "RGB".index(colour)
            inner = np.s_[2 + row : -2 : 2, 2 + column : -2 : 2, channel]
            np.testing.assert_array_equal(image[inner], RGB[inner])
        return
    image = image_array(message(encoding, packed(sources[encoding])))
    expected = sources[encoding] if image.ndim == 2 else wide if image.dtype == np.uint16 else RGB
    np.testing.assert_array_equal(image, expected)


def test_rows_with_padding_and_big_endian_values_are_read():
    values = RNG.integers(0, 65536, (8, 12)).astype(">u2")
    rows = np.hstack([packed(values), np.full((8, 6), 9, np.uint8)])
    np.testing.assert_array_equal(image_array(message("mono16", rows, is_bigendian=1)), values)


def test_compressed_images_are_decoded():
    data = np.frombuffer(cv2.imencode(".png", RGB[..., ::-1])[1].tobytes(), np.uint8)
    content = {"header": header(1, "eye"), "format": "rgb8; png compressed bgr8"}
    image = image_array(new_message("sensor_msgs/CompressedImage", **content, data=data))
    np.testing.assert_array_equal(image, RGB)
    for broken in (data[:40], np.zeros(0, np.uint8)):
        with pytest.raises(ValueError, match="compressed image of format 'rgb8; png compressed bgr8' is not readable"):
            image_array(new_message("sensor_msgs/CompressedImage", **content, data=broken))


def test_an_unsupported_encoding_and_missing_bytes_are_named():
    with pytest.raises(ValueError, match=r"encoding 'yuv422' is not supported; mono8, .* are"):
        image_array(message("yuv422", packed(RGB)))
    for fields in ({"data": np.zeros(9, np.uint8)}, {"step": 3}, {"width": 0}, {"height": 1 << 31, "width": 1 << 31}):
        with pytest.raises(ValueError, match="px in rgb8 need"):
            image_array(message("rgb8", packed(RGB), **{"width": 12, **fields}))


def test_clouds_with_padded_rows_and_colours_as_whole_numbers_are_read():
    points = RNG.normal(size=(2, 3, 3)).astype("<f4")
    colours = RNG.integers(0, 256, (2, 3, 3), dtype=np.uint32)
    rgb = (colours[..., 0] << 16 | colours[..., 1] << 8 | colours[..., 2]).astype("<u4")
    rows = np.concatenate([points.view(np.uint8).reshape(2, 3, 12), rgb.view(np.uint8).reshape(2, 3, 4)], axis=2)
    data = np.hstack([rows.reshape(2, 48), np.full((2, 5), 7, np.uint8)])
    names = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 12, 6)]
    fields = [new_message("sensor_msgs/PointField", name=n, offset=o, datatype=d, count=1) for n, o, d in names]
    cloud = new_message(
        "sensor_msgs/PointCloud2", header=header(1, "eye"), height=2, width=3, fields=fields, is_bigendian=False,
        point_step=16, row_step=53, data=data.ravel(), is_dense=True,
    )  # fmt: skip
    read, seen = cloud_arrays(cloud)
    np.testing.assert_array_equal(read, points.reshape(-1, 3))
    np.testing.assert_array_equal(seen, colours.reshape(-1, 3))


def compressed(form, image, suffix):
    data = np.frombuffer(cv2.imencode(suffix, image)[1], np.uint8)
    return new_message("sensor_msgs/CompressedImage", header=header(1, "eye"), format=form, data=data)


@pytest.mark.parametrize("pattern", BAYER)
@pytest.mark.parametrize(
    ("form", "suffix", "is_mosaic"),
    [
        ("{0}; png compressed ", ".png", True), ("{0}; tiff compressed", ".tiff", True),
        ("{0}; jpeg compressed {0}", ".png", True), ("{0}; jpeg compressed mono8", ".png", False),
        ("{0}; jpeg compressed ", ".png", True), ("mono8; png compressed ", ".png", False), ("png", ".png", False),
    ],
)  # fmt: skip
def test_a_compressed_mosaic_becomes_the_colours_of_the_same_mosaic(pattern, form, suffix, is_mosaic):
    """As image_transport names them; lossless, so that pixels can be compared."""
    image = image_array(compressed(form.format(f"bayer_{pattern}8"), mosaic(BAYER[pattern]), suffix))
    plain = image_array(message(f"bayer_{pattern}8", packed(mosaic(BAYER[pattern]))))
    np.testing.assert_array_equal(image, plain if is_mosaic else mosaic(BAYER[pattern]))


def test_a_compressed_mosaic_of_16_bits_is_refused():
    with pytest.raises(ValueError, match=r"^encoding 'bayer_rggb16' is not supported"):
        image_array(compressed("bayer_rggb16; png compressed ", RGB[..., 0].astype(np.uint16), ".png"))
