"""Raw images and their masks."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from m3depth.prediction.masks import read_valid
from m3depth.rectification.raw_image import RawImage, _in_16_bits, for_matching, masked, read_raw_pair


@pytest.mark.parametrize("white", [np.uint8(1), np.uint16(1), np.uint16(65535)])
def test_rectify_and_predict_read_one_mask_alike(tmp_path, white):
    mask = np.zeros((6, 8), white.dtype)
    mask[:, 4:] = white
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    image = RawImage(Path("left.png"), np.zeros((6, 8), np.uint8), np.ones((6, 8), bool))
    expected = np.broadcast_to(np.arange(8) >= 4, (6, 8))
    np.testing.assert_array_equal(masked(image, tmp_path / "mask.png").valid, expected)
    np.testing.assert_array_equal(read_valid(None, tmp_path / "mask.png", (6, 8)), expected)


def test_images_that_opencv_does_not_resample_are_refused(tmp_path):
    for name, width in (("left.png", 32766), ("right.png", 32767)):
        cv2.imwrite(str(tmp_path / name), np.zeros((4, width), np.uint8))
    with pytest.raises(
        ValueError, match=r"right\.png: is 32767 x 4: images with sides of at most 32766 px can be rect"
    ):
        read_raw_pair(tmp_path / "left.png", tmp_path / "right.png")


@pytest.mark.parametrize("names", [("left.png", "right.png"), ("right.png", "left.png")])
def test_the_floats_of_both_eyes_have_one_black_and_one_white(tmp_path, monkeypatch, names):
    narrow = np.linspace(50, 100, 48, dtype=np.float32).reshape(6, 8)
    wide = np.linspace(0, 200, 48, dtype=np.float32).reshape(6, 8)
    given = dict(zip(names, (narrow, wide)))
    for name in names:
        (tmp_path / name).touch()
    monkeypatch.setattr("m3depth.rectification.raw_image.read_image", lambda path: given[path.name])
    for image in read_raw_pair(tmp_path / "left.png", tmp_path / "right.png"):
        assert image.pixels.dtype == np.uint16
        np.testing.assert_allclose(image.pixels, given[image.path.name] * 325, atol=1)  # 65000 at 200


def test_pixels_without_data_do_not_set_the_black_and_white_of_floats():
    pixels, valid = np.linspace(10, 20, 48, dtype=np.float32).reshape(6, 8), np.ones((6, 8), bool)
    pixels[0, 0], valid[0, 0] = -1e6, False
    for image in _in_16_bits(*(RawImage(Path(f"{eye}.png"), pixels, valid) for eye in ("left", "right"))):
        low, high = pixels[valid].min(), pixels.max()
        np.testing.assert_allclose(image.pixels[valid], (pixels[valid] - low) / (high - low) * 65000, atol=1)


def test_what_holds_no_data_does_not_take_contrast_from_the_rest():
    pixels = np.zeros((40, 60), np.uint16)
    pixels[:, 30:] = np.random.default_rng(0).integers(1000, 1100, (40, 30))
    shown = for_matching(pixels, pixels > 0)[:, 30:]
    assert shown.min() == 0 and shown.max() == 255 and 100 < np.median(shown) < 155
