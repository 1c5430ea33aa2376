from dataclasses import replace

import cv2
import numpy as np
import pytest

from envs.episodes import EpisodeRecord
from envs.report import OUTCOME_COLOURS, plot_tracks, table, write_report

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="", episode=0, outcome="goal", steps=3, distance=0.5,
    start_distance=3.0, shortest=3.0, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[0.0, 3.0], track=[[0.0, 0.0], [0.5, 1.5], [0.0, 2.5]],
)  # fmt: skip
ROW = {
    "driver": "navigator", "perception": "sgbm", "cell": {"k": 0.07, "slope_deg": None}, "episodes": 20,
    "success_rate": 0.85, "success_interval": [0.6396, 0.9476], "spl": 0.754, "soft_spl": 0.812,
    "collision_rate": 0.1, "step_seconds": 0.356,
}  # fmt: skip


def test_a_row_of_the_table():
    head, rule, row = table([ROW]).splitlines()
    assert head.count("|") == rule.count("|") == row.count("|")
    assert row == "| navigator | sgbm | 0.07 | preset | 20 | 85 % (64-95) | 0.75 | 0.81 | 10 % | 0.36 |"


def green(image):
    """Pixels of the colour that means goal."""
    colour = [int(OUTCOME_COLOURS["goal"][i : i + 2], 16) for i in (5, 3, 1)]
    return (np.abs(image.astype(int) - colour).max(axis=2) < 40).sum()


def test_tracks_are_drawn_in_the_colour_of_their_end(tmp_path):
    plot_tracks(tmp_path / "goal.png", [DRIVE])
    plot_tracks(tmp_path / "tilt.png", [replace(DRIVE, outcome="tilt")])
    assert green(cv2.imread(str(tmp_path / "goal.png"))) > 30
    assert green(cv2.imread(str(tmp_path / "tilt.png"))) == 0


def test_a_panel_for_each_driver_and_perception(tmp_path):
    widths = []
    for records in ([DRIVE], [DRIVE, replace(DRIVE, perception="m3depth"), replace(DRIVE, outcome="time")]):
        plot_tracks(tmp_path / "map.png", records)
        widths.append(cv2.imread(str(tmp_path / "map.png")).shape[1])
    assert widths[1] == pytest.approx(2 * widths[0], abs=4)


def test_drives_are_turned_so_that_the_goal_is_to_the_right(tmp_path):
    """The same drive in another direction is the same picture."""
    turned = replace(DRIVE, goal=[-3.0, 0.0], track=[[-y, x] for x, y in DRIVE.track])
    pictures = []
    for record in (DRIVE, turned):
        plot_tracks(tmp_path / "map.png", [record])
        pictures.append(cv2.imread(str(tmp_path / "map.png")))
    np.testing.assert_array_equal(*pictures)


def test_every_end_has_a_colour():
    assert set(OUTCOME_COLOURS) == {"goal", "collision", "tilt", "stuck", "time", "out_of_bounds", "no_path"}
    assert len(set(OUTCOME_COLOURS.values())) == len(OUTCOME_COLOURS)


def test_both_files_are_written(tmp_path):
    write_report(tmp_path, [ROW], [DRIVE])
    assert (tmp_path / "results.md").read_text() == table([ROW]) and (tmp_path / "map.png").is_file()
