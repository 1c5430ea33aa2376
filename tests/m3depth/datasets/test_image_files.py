"""Pairs of image files as cameras write them: depth, channels, and what cannot be a pair."""

import cv2
import numpy as np
import pytest

from m3depth.datasets.image_files import read_pair, read_scene_mask


def write(path, image):
    assert cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("names", ["lr", "rl"])
def test_sixteen_bit_is_scaled_by_one_factor_for_both_eyes(tmp_path, names):
    grey = (np.arange(40 * 50).reshape(40, 50) * 20).astype(np.uint16)
    for name, image in zip(names, (grey, grey // 2)):
        write(tmp_path / f"{name}.png", image)
    eyes = dict(zip("lr", read_pair(tmp_path / "l.png", tmp_path / "r.png")))
    bright, dark = (eyes[name] for name in names)
    assert bright.dtype == np.uint8 and bright.max() == 255 and abs(int(dark.max()) - 128) <= 1


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


@pytest.mark.parametrize("white", [np.uint8(1), np.uint8(255), np.uint16(1), np.uint16(65535)])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_mask_leaves_out_zero_alone_whatever_its_bits(tmp_path, white, channels):
    mask = np.zeros((6, 8, channels), white.dtype)
    mask[:, 3:, 0] = white  # of a mask of colours, blue
    shown = read_scene_mask(write(tmp_path / "mask.png", mask.squeeze()), (6, 8))
    assert shown.dtype == bool and (shown == (np.arange(8) >= 3)).all()


def test_a_mask_of_another_size_names_both(tmp_path):
    mask = write(tmp_path / "mask.png", np.zeros((6, 8), np.uint8))
    with pytest.raises(ValueError, match=r"mask\.png: is 8 x 6, left\.png is 9 x 6: a mask has the image's size"):
        read_scene_mask(mask, (6, 9), "left.png")
    with pytest.raises(FileNotFoundError, match=r"none\.png: no such mask"):
        read_scene_mask(tmp_path / "none.png", (6, 8))
