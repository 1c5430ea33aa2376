"""Lines inside a drive, so that minutes are not silent where there is no terminal."""

import sys

import pytest

import envs.drives.step_lines
from envs.drivers.builtin import StraightDriver
from envs.drives.episodes import Cell, run_episode
from envs.drives.step_lines import StepLines


@pytest.fixture
def drive(make_env, monkeypatch):
    def driven(seconds):
        monkeypatch.setattr(envs.drives.step_lines, "LINE_SECONDS", seconds)
        lines = StepLines("course 3, k=0", lambda: "2 of 7 drives done")
        return run_episode(
            make_env(goal_distance=4.0, mast=True), StraightDriver(), Cell(k=0.0), 1, 0, watch=lines.watch
        )

    return driven


def test_a_line_names_course_step_way_left_and_drives_done(drive, capsys):
    record = drive(0.0)
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == record.steps + 1
    assert printed[0].startswith("course 3, k=0: step 0 of at most 60, 4.0 m to the goal, ")
    assert printed[-1].startswith(
        f"course 3, k=0: step {record.steps} of at most 60, {record.distance:.1f} m to the goal"
    )
    assert all(line.endswith("; 2 of 7 drives done") for line in printed)


def test_a_short_drive_and_a_terminal_get_no_lines(drive, capsys, monkeypatch):
    drive(30.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    drive(0.0)
    assert capsys.readouterr().err == ""
