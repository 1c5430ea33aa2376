"""Maps of disparity and depth in the file types of datasets."""

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from m3depth.datasets.maps import read_map, read_mask
from marssim.base.files.json_file import DatasetError
from marssim.base.files.pfm import encode_pfm

DEPTH = np.linspace(2, 9, 24, dtype=np.float32).reshape(4, 6)


def put(path: Path, values: np.ndarray) -> None:
    """Write numbers as a file of the type that its name ends in."""
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".exr":
        channels = {name: np.ascontiguousarray(values[..., i]) for i, name in enumerate("RGBA"[: values.shape[2]])}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(path))
    elif path.suffix == ".pfm":
        path.write_bytes(encode_pfm(values))
    else:
        assert cv2.imwrite(str(path), values)


def put_channels(path: Path, channels: dict[str, np.ndarray]) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.ascontiguousarray(values) for name, values in channels.items()}).write(str(path))


@pytest.mark.parametrize(
    "channels",
    [
        {"ViewLayer.Depth.V": 0, "ViewLayer.Normal.X": 1, "ViewLayer.Normal.Y": 1, "ViewLayer.Normal.Z": 1},
        {"View.Depth.Z": 0, "View.Position.X": 1, "View.Position.Y": 1, "View.Position.Z": 1, "View.Combined.R": 1},
        {"Z": 0, "R": 1, "G": 2, "B": 3},
        {"Z": 0, "Mist.Z": 1},
        {"distance.V": 0, "N.X": 1, "N.Y": 1, "N.Z": 1},
    ],
)
def test_the_depth_of_an_exr_file_is_that_of_its_layer(tmp_path, channels) -> None:
    put_channels(tmp_path / "d.exr", {name: DEPTH + add for name, add in channels.items()})
    np.testing.assert_array_equal(read_map(tmp_path / "d.exr", "depth"), DEPTH)


def test_layers_of_an_exr_file_that_do_not_tell_which_is_the_depth_are_named(tmp_path) -> None:
    put_channels(tmp_path / "d.exr", {"near.Z": DEPTH, "far.Z": DEPTH + 1})
    with pytest.raises(DatasetError, match=r"d\.exr: far and near may all hold the depth; the name of one layer must"):
        read_map(tmp_path / "d.exr", "depth")


@pytest.mark.parametrize(("ending", "expected"), [("npy", np.inf), ("tiff", np.inf), ("pfm", np.nan)])
def test_an_infinite_depth_is_sky_but_unknown_in_a_pfm(tmp_path, ending, expected) -> None:
    path = tmp_path / f"depth.{ending}"
    stored = DEPTH.copy()
    stored[0, :2] = np.inf, 1e10  # renderers write the second where there is no surface
    put(path, stored)
    depth = read_map(path, "depth")
    np.testing.assert_array_equal(depth[0, :3], np.float32([expected, np.inf, DEPTH[0, 2]]))


def test_a_depth_of_one_kilometre_and_more_is_sky(tmp_path) -> None:
    put(tmp_path / "depth.npy", np.float32([[999, 1000, 5000]] * 2))
    np.testing.assert_array_equal(read_map(tmp_path / "depth.npy", "depth"), [[999, np.inf, np.inf]] * 2)


@pytest.mark.parametrize("ending", ["npy", "tiff", "pfm", "exr"])
def test_a_map_of_channels_that_differ_is_refused_and_one_of_equal_channels_is_read(tmp_path, ending) -> None:
    path, gaps = tmp_path / f"depth.{ending}", DEPTH.copy()
    gaps[1, 1] = np.nan
    put(path, np.dstack([np.nan_to_num(gaps, nan=np.inf) if ending == "pfm" else gaps] * 3))
    np.testing.assert_array_equal(read_map(path, "depth"), gaps)
    put(path, np.dstack([DEPTH, DEPTH, DEPTH + 1]))
    with pytest.raises(DatasetError, match=rf"depth\.{ending}: has 3 channels that differ; it must hold") as error:
        read_map(path, "depth")
    assert "\n" not in str(error.value)


def test_the_alpha_of_an_image_is_no_channel_of_its_map(tmp_path) -> None:
    stored = np.round(DEPTH * 1000).astype(np.uint16)
    put(tmp_path / "depth.png", np.dstack([stored] * 3 + [np.full_like(stored, 65535)]))
    np.testing.assert_allclose(read_map(tmp_path / "depth.png", "depth"), DEPTH, atol=6e-4)


def test_a_mask_of_colours_is_refused_and_one_of_greys_is_read(tmp_path) -> None:
    mask = np.where(DEPTH > 4, 255, 0).astype(np.uint8)
    put(tmp_path / "mask.png", np.dstack([mask] * 3))
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), mask)
    put(tmp_path / "mask.png", np.dstack([mask, mask, 255 - mask]))
    with pytest.raises(DatasetError, match=r"mask\.png: has 3 channels that differ"):
        read_mask(tmp_path / "mask.png")
