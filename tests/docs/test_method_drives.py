"""Drives of several perceptions, collected in one file: none is lost or counted twice, and the table pairs courses."""

import json
import re
from dataclasses import asdict, replace
from types import ModuleType

import pytest

from envs.drives.episodes import EpisodeRecord
from envs.drives.metrics import paired_difference
from marssim.base.files.json_file import DatasetError

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.15, slope=0", episode=0, outcome="goal", steps=60, distance=0.8,
    start_distance=20.0, shortest=20.0, path_length=25.0, min_clearance=0.5, max_tilt_deg=4.0, reward=12.0,
    step_seconds=1.0, perception_seconds=0.1, redraws=0, goal=[0.0, 20.0], abs_rel=0.02, looks=61, blind=0,
    track=[[0.0, 0.0], [0.5, 1.5]], headings=[0.0, 0.1], relief=[[0.0] * 3] * 3, half=1.5,
)  # fmt: skip
LITE = "m3depth:weights/lite.safetensors"


def folder_of(tmp_path, *drives):
    """Return a folder of envs.evaluate with these drives."""
    folder = tmp_path / f"{drives[0].perception[-5:]}-{drives[0].episode}"
    (folder / "episodes").mkdir(parents=True)
    for drive in drives:
        (folder / "episodes" / f"{drive.episode}.json").write_text(json.dumps(asdict(drive)))
    return folder


def test_folders_of_several_calls_become_one_file_without_what_maps_need(tmp_path, method_drives: ModuleType) -> None:
    file = tmp_path / "drives.jsonl"
    first = folder_of(tmp_path, DRIVE, replace(DRIVE, episode=1, outcome="no_path"))
    other = folder_of(tmp_path, replace(DRIVE, perception=LITE, path_length=20.0))
    method_drives.collect(file, [first])
    drives = method_drives.collect(file, [other, first])  # what the file holds already is not added again
    assert [(drive.perception, drive.episode) for drive in drives] == [(LITE, 0), ("sgbm", 0), ("sgbm", 1)]
    lines = file.read_text().splitlines()
    assert len(lines) == 3 and not {"track", "relief", "obstacles"} & json.loads(lines[0]).keys()
    assert [drive.outcome for drive in method_drives.read_drives(file)] == ["goal", "goal", "no_path"]
    assert method_drives.drives_table(method_drives.read_drives(file), ["lite", "sgbm"]).splitlines()[2:] == [
        "| lite | 1 of 1, 1.00 | - | .020 | - | - | - |",
        "| sgbm | 1 of 1, .80 | - | .020 | - | +0 (-79 to +79) | -.20 |",
    ]


def test_only_courses_that_all_have_driven_are_compared(method_drives: ModuleType) -> None:
    lite = [replace(DRIVE, perception=LITE, episode=n) for n in range(6)]
    rocks = {"rocks": 8, "rocks_missed": 1}
    sgbm = [replace(DRIVE, episode=n, outcome="goal" if n < 4 else "time", **rocks) for n in range(1, 8)]
    *_, row = method_drives.drives_table([*lite, *sgbm], ["lite", "sgbm"]).splitlines()
    assert row.startswith("| sgbm | 3 of 5, .48 | 2 time | .020 | 12.5 | -40 (") and row.count("to") == 2


def test_each_cell_has_its_rows_and_all_together_have_the_last(method_drives: ModuleType) -> None:
    lite = [replace(DRIVE, perception=LITE, episode=n, cell=cell) for cell in ("k=0.15", "k=0.2") for n in range(5)]
    sgbm = [replace(drive, perception="sgbm", outcome="time" if drive.cell == "k=0.2" else "goal") for drive in lite]
    head, _, *rows = method_drives.drives_table([*lite, *sgbm[:-1]], ["lite", "sgbm"]).splitlines()
    assert head.startswith("| courses | perception | goals reached, SPL |")
    assert [row.split(" | ")[:3] for row in rows] == [
        ["| k=0.15", "lite", "5 of 5, .80"], ["| k=0.15", "sgbm", "5 of 5, .80"],
        ["| k=0.2", "lite", "4 of 4, .80"], ["| k=0.2", "sgbm", "0 of 4, .00"],
        ["| all", "lite", "9 of 9, .80"], ["| all", "sgbm", "5 of 9, .44"],
    ]  # fmt: skip
    paired = paired_difference(sgbm[:-1], lite[:-1])
    low, high = (f"{100 * end:+.0f}" for end in paired["interval"])
    assert f"| -44 ({low} to {high}) |" in rows[-1] and paired["courses"] == 5


def test_mistakes_are_one_line(tmp_path, method_drives: ModuleType, capsys) -> None:
    file, empty = tmp_path / "drives.jsonl", tmp_path / "empty"
    empty.mkdir()
    assert method_drives.main(["--file", str(file)]) == 2
    assert "there is no such file, and no --folders to make it of" in capsys.readouterr().err
    assert method_drives.main(["--file", str(file), "--folders", str(empty)]) == 2
    assert f"--folders {empty}: holds no drive of envs.evaluate" in capsys.readouterr().err
    file.write_text('{"driver": "navigator"}\n')
    assert method_drives.main(["--file", str(file)]) == 2
    assert f"--file {file}: line 1 is no drive" in capsys.readouterr().err
    with pytest.raises(ValueError, match="order must name perceptions of the file, sgbm, got lite"):
        method_drives.drives_table([DRIVE], ["lite", "sgbm"])


def test_drives_that_cannot_be_compared_leave_the_file_as_it_is(tmp_path, method_drives: ModuleType) -> None:
    file = tmp_path / "drives.jsonl"
    method_drives.collect(file, [folder_of(tmp_path, replace(DRIVE, perception=LITE))])
    before = file.read_bytes()
    other = LITE.replace("weights", "others")
    for number, (change, message) in enumerate(
        (
            ({"driver": "straight"}, f"--file {file}: can hold the drives of one driver, not of navigator, straight"),
            ({"perception": other}, f"--file {file}: both {other} and {LITE} would be lite in it"),
        )
    ):
        folder = folder_of(tmp_path / str(number), replace(DRIVE, **{"perception": LITE, "episode": 1, **change}))
        with pytest.raises(DatasetError, match=f"^{re.escape(message)}$"):
            method_drives.collect(file, [folder])
        assert file.read_bytes() == before
