"""The looks of a recorded drive in 3-D: cloud, map and plans, all of them where they lie in the true world."""

import json
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from recorded_drives import candidates, content, drive_of, look_pictures, pose_rows, step

from envs.drives.episodes import EpisodeRecord
from envs.drives.shots import course_shots
from envs.recording.code_colours import NO_ERROR, UNKNOWN, code_colours
from envs.recording.look_shots import look_shots
from marssim.base.dataset.drive_file import FULL_COST, MAP_CODES, encode_drive, height_codes, picture_name
from marssim.base.files.json_file import DatasetError
from marssim.base.files.png import encode_png
from marssim.base.rover_spec import ZHURONG
from nav.ground.map_files import COSTLY

RECORD = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1", episode=3, outcome="goal", steps=2, distance=0.5,
    start_distance=9.0, shortest=9.2, path_length=9.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[9.0, 0.0], obstacles=[[4.0, 0.5, 0.8]],
    track=[[0.0, 0.0], [1.0, 0.0], [9.0, 0.0]], shortest_path=[[0, 0], [9, 0]], half=10.0, relief=[[0.0] * 21] * 21,
)  # fmt: skip
SECONDS = 120.0  # that a browser on a busy machine may take
CELLS = 16
PLACE = {"west": 2.0, "south": -8.0, "cell": 1.0, "cells": CELLS}
# the rover stands at (1, 0) and looks east; by its odometry it stands at (1, 2) and looks north
SECOND = {"x": 1.0, "believed_pose": pose_rows(1.0, 2.0, np.pi / 2), "map": {**PLACE, "west": -7.0, "south": 0.0}}


def map_pictures(n, blocked_row):
    """A map of level ground at 0.5 m, with a blocked row of 0.9 m, and unknown beyond it. Rows are from the north."""
    code = np.full((CELLS, CELLS), MAP_CODES["free"], np.uint8)
    height = np.full((CELLS, CELLS), 0.5)
    code[blocked_row], height[blocked_row] = MAP_CODES["blocked"], 0.9
    code[:blocked_row], height[:blocked_row] = MAP_CODES["unknown"], np.nan
    return {picture_name("map", n): encode_png(code), picture_name("height", n): encode_png(height_codes(height))}


@pytest.fixture
def path(tmp_path):
    """A drive of three steps; at the second, its odometry is wrong, and the rover looks at a wall 3 m ahead."""
    second = step(
        **SECOND, looked=True, status="drive", reason="way is free", abs_rel=0.031,
        path=[[1.0, 2.0], [1.0, 6.0]], candidates=candidates((0.0, 0.0, 4.0, 9.0), (0.5, 0.0, 2.0, None)), chosen=0,
    )  # fmt: skip
    error = np.full((8, 8), 128, np.uint8)
    error[:, :4] = 0
    pictures = {
        **look_pictures(1, np.full((8, 8), 3.0)), **map_pictures(1, CELLS - 8),
        picture_name("error", 1): encode_png(error),
    }  # fmt: skip
    drive_of(tmp_path / "a.zip", [step(), second, step(x=9.0, outcome="goal")], pictures)
    return tmp_path / "a.zip"


def test_each_look_is_a_shot_from_the_true_place_of_the_left_eye(path):
    (shot,) = look_shots(RECORD, path)
    assert shot.name == "k=0.1, course 3: navigator, sgbm, step 1" and shot.world == shot.name.removesuffix(", step 1")
    assert np.allclose(shot.pose[:3, 3] - [1, 0, 0], ZHURONG.mount.left_eye(0.27)[:3, 3])
    view = shot.load()
    assert view.note == "step 1 of 2; drive: way is free; 8.0 m to the goal; depth error 3.1 %"
    assert {"Goal", "Shortest passable path", "Driven path", "Rover", "Planned path", "Chosen motion"} == {
        line.name for line in view.lines
    }
    assert [surface.name for surface in view.surfaces] == ["Ground", "Rocks that block", "Map of the navigator"]


def test_the_cloud_has_colours_by_error_and_by_the_map(path):
    view = look_shots(RECORD, path)[0].load()
    assert list(view.layers) == ["image", "depth", "confidence", "error", "traversability"]
    assert len(view.points) == 64 and np.allclose(view.points[:, 2], 3.0, rtol=0.005)
    assert (np.abs(view.layers["image"].colours.astype(int) - 120) < 6).all()
    tables = code_colours()
    errors = view.layers["error"].colours.reshape(8, 8, 3)
    assert (errors[:, :4] == tables["error"][0]).all() and (errors[:, 4:] == tables["error"][128]).all()
    # the wall stands 3 m ahead of the eye, on ground that the map has as free
    assert (view.layers["traversability"].colours == tables["map"][MAP_CODES["free"]]).all()


def test_points_beyond_the_map_have_the_colour_of_unknown_ground(path, tmp_path):
    far = step(**{**SECOND, "map": {**PLACE, "west": 100.0}}, looked=True)
    drive_of(tmp_path / "b.zip", [far], {**look_pictures(0, np.full((8, 8), 3.0)), **map_pictures(0, 4)})
    view = look_shots(RECORD, tmp_path / "b.zip")[0].load()
    assert (view.layers["traversability"].colours == UNKNOWN).all()


def test_map_and_plans_lie_around_the_rover_in_the_true_world(path):
    """North of the odometry's frame is east of the world."""
    view = look_shots(RECORD, path)[0].load()
    surface = view.surfaces[-1]
    blocked = np.isclose(surface.vertices[:, 2], 0.9 - 0.03, atol=0.011)
    # rows count from the north: the blocked one is y = 7 to 8 of the odometry's frame, 5.5 m ahead of the rover
    assert blocked.sum() == CELLS and np.allclose(surface.vertices[blocked, 0], 1 + 5.5)
    assert (surface.colours[blocked] == code_colours()["map"][MAP_CODES["blocked"]]).all()
    assert np.allclose(surface.vertices[~blocked, 2], 0.5 - 0.03, atol=0.011) and surface.vertices[:, 0].max() < 6.6
    lines = {line.name: line.points for line in view.lines}
    assert np.allclose(lines["Planned path"], [[1, 0, 0.55], [5, 0, 0.55]], atol=0.011)
    assert np.allclose(lines["Chosen motion"][[0, -1]], [[1, 0, 0.55], [5, 0, 0.55]], atol=0.011)
    assert np.allclose(lines["Driven path"][:, :2], [[0, 0], [1, 0]])
    assert np.allclose(lines["Rover"][:, :2].min(axis=0), [0.2, -0.7])


def test_records_of_earlier_releases_have_no_heights(path, tmp_path):
    look = step(**SECOND, looked=True, path=[[1.0, 2.0], [1.0, 6.0]])
    pictures = {**look_pictures(0, np.full((8, 8), 3.0)), **map_pictures(0, 4)}
    del pictures[picture_name("height", 0)]
    drive_of(tmp_path / "b.zip", [look], pictures)
    view = look_shots(replace(RECORD, half=0.0, relief=[]), tmp_path / "b.zip")[0].load()
    assert [surface.name for surface in view.surfaces] == ["Rocks that block"] and "traversability" in view.layers
    (planned,) = (line.points for line in view.lines if line.name == "Planned path")
    assert np.allclose(planned[:, 2], 0.05)


def test_a_list_of_looks_needs_no_pictures(tmp_path):
    """So that the page of a long evaluation opens at once."""
    path = tmp_path / "d.zip"
    path.write_bytes(encode_drive(content([step(looked=True), step(x=9.0)]), {picture_name("depth", 0): b"none"}))
    (shot,) = look_shots(RECORD, path)
    with pytest.raises(DatasetError, match=r"d\.zip: depth/0000\.png is no PNG file"):
        shot.load()


def test_a_broken_file_is_one_line(tmp_path):
    (tmp_path / "c.zip").write_text(json.dumps({}))
    with pytest.raises(DatasetError, match=r"c\.zip: is not a whole zip archive"):
        look_shots(RECORD, tmp_path / "c.zip")


def test_a_browser_draws_the_look_behind_the_course_and_its_errors(path, browser_3d):
    pytest.importorskip("viser", reason="the extra `view` is not installed")
    from selenium.common.exceptions import TimeoutException

    from marssim.base.view.page import Page

    def pixels_like(colour):
        try:
            data = browser_3d.get_screenshot_as_png()
        except TimeoutException:  # it is still drawing
            return 0
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        return int((np.abs(picture - np.array(colour, int)).max(axis=2) < 8).sum())

    def wait_until(condition):
        end = time.monotonic() + SECONDS
        while not condition():
            assert time.monotonic() < end, "it did not happen"
            time.sleep(0.2)

    with Page([*course_shots([RECORD]), *look_shots(RECORD, path)], "run", 0) as page:
        browser_3d.get(page.address)
        wait_until(lambda: "course 3" in browser_3d.page_source)
        page._slider.value = 2
        wait_until(lambda: "way is free" in browser_3d.page_source)
        assert {"Cloud", "Ground", "Rocks that block", "Map of the navigator", "Planned path"} <= page._boxes.keys()
        wait_until(lambda: pixels_like((120, 120, 120)) > 500)  # the colour of the image
        page._colour.value = "error"
        wait_until(lambda: pixels_like(NO_ERROR) > 600)  # about 300 are of letters


def test_a_chosen_motion_after_a_turn_in_place_begins_in_the_turned_direction(path, tmp_path):
    turned = step(**SECOND, looked=True, candidates=candidates((0.0, np.pi / 2, 4.0, 9.0)), chosen=0)
    pictures = {**look_pictures(1, np.full((8, 8), 3.0)), **map_pictures(1, 2)}
    drive_of(tmp_path / "b.zip", [step(), turned, step(x=9.0, outcome="goal")], pictures)
    (line,) = (line for line in look_shots(RECORD, tmp_path / "b.zip")[0].load().lines if line.name == "Chosen motion")
    assert np.allclose(line.points[[0, -1], :2], [[1, 0], [1, 4]], atol=1e-3)


def test_ground_that_costs_as_much_as_maps_call_costly_has_the_full_colour_of_it():
    free, costly = MAP_CODES["free"], MAP_CODES["costly"]
    colours = code_colours()["map"].astype(int)
    at = int(np.ceil(free + (costly - free) * COSTLY / FULL_COST))
    assert at < costly and (colours[at : costly + 1] == colours[costly]).all()
    assert (np.abs(np.diff(colours[free : at + 1], axis=0)).max(axis=1) > 0).all()
