"""The folder of one prediction."""

import numpy as np

from m3depth.prediction.files import single_folder, trusted_pixels


def test_what_a_killed_run_has_half_written_of_a_rectified_pair_is_deleted(tmp_path):
    (tmp_path / "rectified").mkdir()
    kept = tmp_path / "rectified/left.png"
    halves = [tmp_path / ".depth.npy.71.part", tmp_path / "rectified/.left.png.71.part"]
    for path in (kept, *halves):
        path.write_bytes(b"0")
    with single_folder(tmp_path).claim():
        assert kept.is_file() and not any(path.exists() for path in halves)


def test_a_pixel_as_sure_as_asked_for_becomes_a_point():
    disparity, confidence = np.full((4, 6), 10.0), np.ones((4, 6), np.float32)
    confidence[0], confidence[1] = 0.9, np.nan
    assert trusted_pixels(disparity, confidence, 1.0).all(axis=1).tolist() == [False, False, True, True]
