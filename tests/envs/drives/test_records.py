import json
import re
from dataclasses import asdict

import pytest

from envs.drives.episodes import EpisodeRecord
from envs.drives.records import read_record
from marssim.base.files.json_file import DatasetError

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1, slope=5", episode=0, outcome="goal", steps=3, distance=0.5,
    start_distance=3.0, shortest=3.0, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=-12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[0.0, 3.0], abs_rel=0.0123,
    obstacles=[[1.0, 1.0, 0.8]], track=[[0.0, 0.0], [0.5, 1.5], [0.0, 2.5]],
)  # fmt: skip


@pytest.fixture
def written(tmp_path):
    def write(**changes):
        path = tmp_path / "drive.json"
        path.write_text(json.dumps({**asdict(DRIVE), **changes}))
        return path

    return write


def test_what_was_written_is_read(written):
    assert read_record(written()) == DRIVE
    assert read_record(written(abs_rel=None, blind=2)).blind == 2


@pytest.mark.parametrize("change", ["another field", "a missing field"])
def test_a_record_of_another_version_is_named(written, change):
    path = written(colour="red") if change == "another field" else written()
    if change == "a missing field":
        path.write_text(json.dumps({name: value for name, value in asdict(DRIVE).items() if name != "outcome"}))
    with pytest.raises(
        DatasetError, match=rf"^{re.escape(str(path))}: not an episode of this version; delete the file"
    ):
        read_record(path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("path_length", "long", "must be a number of 0 or more, got 'long'"),
        ("path_length", float("nan"), "must be a number of 0 or more, got nan"),
        ("distance", -4, "must be a number of 0 or more, got -4"), ("steps", True, "must be a number"),
        ("shortest", None, "must be a number over 0"), ("shortest", 0, "must be a number over 0, got 0"),
        ("reward", [1], "must be a number, got"), ("track", [], "must be rows of 2 numbers, one or more"),
        ("goal", [], "must be two numbers"), ("obstacles", [[1.0, 2.0]], "must be rows of 3 numbers"),
        ("relief", [[1.0], [1.0, 2.0]], "must be rows of as many numbers"),
        ("near_miss", 1, "must be true or false, got 1"),
        ("outcome", 3, "must be a word, got 3"), ("goal", [1, "x"], r"must be two numbers, got \[1, 'x'\]"),
        ("cause", "<b>luck</b>", "must be one of odometry error, known obstacle, .*, got '<b>luck</b>'"),
        ("track", [1.0, 2.0], "must be rows of 2 numbers"),
        ("track", 7, "must be rows of 2 numbers, one or more, got 7"),
    ],
)  # fmt: skip
def test_what_no_drive_gives_is_named(written, name, value, message):
    path = written(**{name: value})
    with pytest.raises(DatasetError, match=f"^{re.escape(str(path))}: {name} {message}.*; delete the file to drive"):
        read_record(path)
