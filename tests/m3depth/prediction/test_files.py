"""The folder of one prediction."""

from m3depth.prediction.files import single_folder


def test_what_a_killed_run_has_half_written_of_a_rectified_pair_is_deleted(tmp_path):
    (tmp_path / "rectified").mkdir()
    kept = tmp_path / "rectified/left.png"
    halves = [tmp_path / ".depth.npy.71.part", tmp_path / "rectified/.left.png.71.part"]
    for path in (kept, *halves):
        path.write_bytes(b"0")
    with single_folder(tmp_path).claim():
        assert kept.is_file() and not any(path.exists() for path in halves)
