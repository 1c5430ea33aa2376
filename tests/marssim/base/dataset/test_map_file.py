import cv2
import numpy as np
import pytest

from marssim.base.dataset.map_file import MAP_FORMATS, encode_map, find_map, read_map_file

DEPTH = np.array([[1.234, 8.0, np.inf], [np.nan, 60.0, 3.5]], np.float32)
NORMAL = np.array([[[0, 0, -1], [0.6, 0, -0.8]], [[0, -0.6, -0.8], [0, 0, 0]]], np.float32)


@pytest.mark.parametrize("form", MAP_FORMATS)
def test_a_map_reads_back_and_unknown_is_never_a_depth(tmp_path, form):
    path = tmp_path / f"depth.{form}"
    path.write_bytes(encode_map(DEPTH, "depth", form))
    back = read_map_file(path, "depth")
    measured = np.isfinite(DEPTH)
    np.testing.assert_allclose(back[measured], DEPTH[measured], rtol=0 if form != "png" else 1e-3, atol=5e-4)
    assert not np.isfinite(back[~measured]).any()
    if form in ("npy", "tiff"):
        np.testing.assert_array_equal(back, DEPTH)


@pytest.mark.parametrize("form", MAP_FORMATS)
def test_normals_keep_their_axes(tmp_path, form):
    path = tmp_path / f"normal.{form}"
    path.write_bytes(encode_map(NORMAL, "normal", form))
    np.testing.assert_allclose(read_map_file(path, "normal"), NORMAL, atol=2e-5)


def test_other_programs_see_the_units_that_the_guide_states(tmp_path):
    path = tmp_path / "a.png"
    for kind, value, stored in (("depth", 2.5, 2500), ("disparity", 2.5, 640), ("confidence", 1.0, 65535)):
        path.write_bytes(encode_map(np.full((2, 2), value, np.float32), kind, "png"))
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image.dtype == np.uint16 and (image == stored).all()
    path.write_bytes(encode_map(np.full((2, 2, 3), [0, 0, -1], np.float32), "normal", "png"))
    assert (cv2.imread(str(path))[0, 0] == (255, 128, 128)).all()  # blue, green, red: towards the camera
    path.write_bytes(encode_map(np.full((2, 2), 70.0, np.float32), "depth", "png"))
    assert (cv2.imread(str(path), cv2.IMREAD_UNCHANGED) == 0).all()


def test_the_most_exact_file_is_found(tmp_path):
    assert find_map(tmp_path, "depth") is None
    for name in ("depth.pfm", "depth.png"):
        (tmp_path / name).write_bytes(b"")
    assert find_map(tmp_path, "depth").name == "depth.pfm"
    (tmp_path / "depth.npy").write_bytes(b"")
    assert find_map(tmp_path, "depth").name == "depth.npy"


@pytest.mark.parametrize("form", MAP_FORMATS)
def test_a_broken_file_is_named(tmp_path, form):
    path = tmp_path / f"depth.{form}"
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match=rf"depth\.{form}: is not a map of depth"):
        read_map_file(path, "depth")


def test_no_confidence_is_a_confidence_of_zero_in_every_type(tmp_path):
    given = np.array([[0.0, 0.25], [1.0, 0.0]], np.float32)
    for form in MAP_FORMATS:
        path = tmp_path / f"confidence.{form}"
        path.write_bytes(encode_map(given, "confidence", form))
        np.testing.assert_allclose(read_map_file(path, "confidence"), given, atol=1e-5)
