"""Pairs of image files as cameras write them: depth, channels, and what cannot be a pair."""

import cv2
import numpy as np
import pytest

from m3depth.datasets.image_files import read_pair


def write(path, image):
    assert cv2.imwrite(str(path), image)
    return path


def test_sixteen_bit_is_scaled_by_one_factor_for_both_eyes(tmp_path):
    grey = (np.arange(40 * 50).reshape(40, 50) * 20).astype(np.uint16)
    left, right = read_pair(write(tmp_path / "l.png", grey), write(tmp_path / "r.png", grey // 2))
    assert left.dtype == np.uint8 and left.max() == 255 and abs(int(right.max()) - 128) <= 1


def test_a_hot_pixel_does_not_darken_a_sixteen_bit_pair(tmp_path):
    image = np.full((60, 60), 400, np.uint16)
    image[3, 3] = 65535
    left, right = read_pair(write(tmp_path / "l.png", image), write(tmp_path / "r.png", image))
    assert left[0, 0] == right[0, 0] == 255


def test_grey_beside_colour_becomes_colour(tmp_path):
    blue_on_disk = np.zeros((40, 50, 3), np.uint8)
    blue_on_disk[..., 0] = 200
    grey = np.full((40, 50), 7, np.uint8)
    left, right = read_pair(write(tmp_path / "l.png", grey), write(tmp_path / "r.png", blue_on_disk))
    assert left.shape == right.shape == (40, 50, 3)
    assert right[0, 0].tolist() == [0, 0, 200] and left[0, 0].tolist() == [7, 7, 7]


def test_alpha_is_dropped_and_one_channel_stays_one(tmp_path):
    image = np.random.default_rng(1).integers(0, 255, (20, 30, 4), dtype=np.uint8)
    left, right = read_pair(write(tmp_path / "l.png", image), write(tmp_path / "r.png", image[..., :3]))
    assert np.array_equal(left, right) and np.array_equal(left, image[..., 2::-1])
    left, _ = read_pair(write(tmp_path / "g.png", image[..., 0]), tmp_path / "g.png")
    assert np.array_equal(left, image[..., 0])


def test_images_that_are_not_a_pair_are_named(tmp_path):
    eight = write(tmp_path / "eight.png", np.zeros((20, 30), np.uint8))
    sixteen = write(tmp_path / "sixteen.png", np.zeros((20, 30), np.uint16))
    real = write(tmp_path / "real.tiff", np.zeros((20, 30), np.float32))
    with pytest.raises(
        ValueError, match=r"eight\.png is uint8, .*sixteen\.png is uint16: both images of a pair must have 8 bits"
    ):
        read_pair(eight, sixteen)
    with pytest.raises(ValueError, match=r"real\.tiff: holds float32; images must have 8 or 16 bits"):
        read_pair(real, real)


@pytest.mark.parametrize("ending", [".png", ".tiff"])
def test_a_truncated_file_is_reported_without_messages_of_libraries(tmp_path, capfd, ending):
    path = write(tmp_path / f"cut{ending}", np.zeros((20, 30, 3), np.uint8))
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(ValueError, match=rf"cut\{ending}: not a readable image"):
        read_pair(path, path)
    assert capfd.readouterr().err == ""


def test_a_png_with_a_wrong_checksum_is_reported_without_messages_of_libraries(tmp_path, capfd):
    path = write(tmp_path / "bent.png", np.full((20, 30, 3), 7, np.uint8))
    data = bytearray(path.read_bytes())
    data[-20] ^= 1
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"bent\.png: not a readable image"):
        read_pair(path, path)
    assert capfd.readouterr().err == ""
