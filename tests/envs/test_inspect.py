import json
from dataclasses import asdict, replace

import pytest
from recorded_drives import drive_of, step

from envs import inspect as command
from envs.drives.episodes import EpisodeRecord

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1", episode=0, outcome="goal", steps=1, distance=0.5,
    start_distance=3.0, shortest=3.0, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[0.0, 3.0], track=[[0.0, 0.0], [0.0, 2.5]],
)  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Three courses: on the second, one of two drives ends stuck."""
    (tmp_path / "run/episodes").mkdir(parents=True)
    monkeypatch.setattr(command, "check_viewer", lambda: None)
    stuck = replace(DRIVE, episode=1, outcome="stuck")
    drives = [DRIVE, stuck, replace(stuck, perception="m3depth", outcome="goal"), replace(DRIVE, episode=2)]
    for number, drive in enumerate(drives):
        (tmp_path / f"run/episodes/{number}.json").write_text(json.dumps(asdict(drive)))
    return tmp_path / "run"


def test_a_page_has_all_courses_or_those_of_an_outcome(folder, monkeypatch):
    pages = []
    monkeypatch.setattr(command, "show", lambda shots, title: pages.append((shots, title)))
    assert command.main([str(folder)]) == 0 and command.main([str(folder), "--outcome", "stuck"]) == 0
    (all_shots, title), (stuck, _) = pages
    assert [shot.name[-1] for shot in all_shots] == ["0", "1", "2"] and title == "run"
    assert [shot.name for shot in stuck] == ["k=0.1, course 1"]
    assert {line.name for line in stuck[0].load().lines} == {
        "Goal", "navigator, sgbm: stuck", "navigator, m3depth: goal",
    }  # fmt: skip


def test_recorded_drives_have_their_looks_behind_their_course(folder, monkeypatch):
    pages = []
    monkeypatch.setattr(command, "show", lambda shots, title: pages.append(shots))
    (folder / "drives").mkdir()
    drive_of(folder / "drives/1.zip", [step(looked=True), step(x=1.0, looked=True)])
    assert command.main([str(folder)]) == 0
    names = [shot.name for shot in pages[0]]
    looks = [f"k=0.1, course 1: navigator, sgbm, step {n}" for n in (0, 1)]
    assert names == ["k=0.1, course 0", "k=0.1, course 1", *looks, "k=0.1, course 2"]


def test_a_broken_record_of_a_drive_costs_only_its_looks(folder, monkeypatch, capsys):
    pages = []
    monkeypatch.setattr(command, "show", lambda shots, title: pages.append(shots))
    (folder / "drives").mkdir()
    (folder / "drives/0.zip").write_bytes(b"half a drive")
    drive_of(folder / "drives/1.zip", [step(looked=True), step(x=1.0, looked=True)])
    assert command.main([str(folder)]) == 0
    assert len(pages[0]) == 3 + 2
    assert (
        capsys.readouterr().err
        == f"warning: {folder / 'drives/0.zip'}: is not a whole zip archive, as recorded drives are\n"
    )


def test_a_file_instead_of_a_folder_is_one_line(tmp_path, capsys):
    (tmp_path / "results.json").write_text("{}")
    assert command.main([str(tmp_path / "results.json")]) == 2
    assert "results.json: is a file; give the folder that envs.evaluate wrote" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--outcome", "tilt"], "--outcome tilt: no drive ended so; they ended as goal, stuck"),
        (None, "holds no episodes; give a folder that envs.evaluate wrote"),
    ],
)
def test_mistakes_are_one_line(folder, tmp_path, capsys, arguments, message):
    target = [str(tmp_path / "elsewhere")] if arguments is None else [str(folder), *arguments]
    assert command.main(target) == 2
    error = capsys.readouterr().err
    assert message in error and error.startswith("error: ") and error.count("\n") == 1
