import io
import zipfile

import cv2
import numpy as np
import pytest
from rock_world import body_pose

from envs.drivers.builtin import StraightDriver
from envs.drivers.driver import Stop
from envs.drives.episodes import Cell, run_episode
from envs.recording.recorder import THUMBNAIL, Recorder, _reduced_map, _sampled
from envs.world.eyes import EyesConfig
from marssim.base.camera import NATECAM
from marssim.base.dataset.drive_file import MAP_CODES, height_codes
from nav.ground.elevation import ElevationConfig
from nav.navigator import Navigator, NavigatorConfig
from nav.replay import area_of, drive_frames, replay


def test_every_step_of_an_arrival_has_its_decision(arrival):
    drive, record = arrival
    assert record.outcome == "goal" and len(drive.steps) == record.steps + 1
    assert [s["outcome"] for s in drive.steps] == ["driving"] * record.steps + ["goal"]
    np.testing.assert_allclose([[row[3] for row in s["pose"][:2]] for s in drive.steps], record.track, atol=1e-4)
    assert drive.steps[-1]["way"] == pytest.approx(record.path_length, abs=1e-3)
    assert min(s["clearance"] for s in drive.steps) == pytest.approx(record.min_clearance, abs=1e-3)
    assert drive.content["episode"]["obstacles"] == record.obstacles
    rover = drive.content["rover"]
    assert rover["pan_limit"] == pytest.approx(np.pi / 2)
    for s in drive.steps[:-1]:
        command, action = s["command"], s["action"]
        assert s["status"] in ("drive", "turn", "look") and s["reason"]
        assert action[0] * rover["max_speed"] == pytest.approx(command["speed"], abs=2e-4)
        assert action[1] * rover["max_yaw_rate"] == pytest.approx(command["yaw_rate"], abs=2e-4)
        assert s["candidates"]["cost"][s["chosen"]] == min(cost for cost in s["candidates"]["cost"] if cost is not None)
    last = drive.steps[-1]
    assert last["action"] is last["command"] is last["candidates"] is last["map"] is None


def test_the_costs_of_a_candidate_are_the_sum_of_their_parts(arrival):
    drive, _ = arrival
    listed = drive.steps[2]["candidates"]
    total = np.sum(list(listed["parts"].values()), axis=0)
    free = [n for n, cost in enumerate(listed["cost"]) if cost is not None]
    np.testing.assert_allclose(total[free], [listed["cost"][n] for n in free], atol=1e-3)


def test_pictures_are_kept_of_looks_only(arrival):
    drive, record = arrival
    looks = [n for n, s in enumerate(drive.steps) if s["looked"]]
    assert len(looks) == record.looks < len(drive.steps)
    for layer in ("left", "depth", "confidence"):
        assert [n for n in range(len(drive.steps)) if drive.picture(layer, n)] == looks
    picture = cv2.imdecode(np.frombuffer(drive.picture("left", 0), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (THUMBNAIL, THUMBNAIL, 3) and picture.std() > 3
    assert drive.picture("error", 0) is None and drive.steps[0]["abs_rel"] is None  # the truth has no error


def test_the_map_shows_the_rock_where_it_lies(arrival):
    drive, _ = arrival
    codes, place = drive.codes("map", 1), drive.steps[1]["map"]

    def code_at(x, y):
        row = place["cells"] - 1 - int((y - place["south"]) / place["cell"])
        return codes[row, int((x - place["west"]) / place["cell"])]

    assert code_at(-0.5, 0.0) == MAP_CODES["blocked"]  # its near side
    assert code_at(-3.0, 0.3) == MAP_CODES["free"] and code_at(-3.0, 5.0) == MAP_CODES["unknown"]


def test_looks_keep_the_heights_of_the_map(arrival):
    drive, _ = arrival
    kept = [n for n in range(len(drive.steps)) if drive.heights(n) is not None]
    assert kept == [n for n, s in enumerate(drive.steps) if s["looked"] and s["map"]] and len(kept) > 2
    heights, codes = drive.heights(0), drive.codes("map", 0)
    assert heights.shape == codes.shape and 0.3 < np.nanmax(heights) < 1.0  # the rock
    assert np.nanmax(np.abs(heights[codes == MAP_CODES["free"]])) < 0.1 and np.isnan(heights[0, 0])


def test_a_collision_says_what_was_touched_and_how_wrong_the_depth_was(crash):
    drive, record = crash
    assert record.outcome == "collision" and drive.steps[-1]["contact"] in ("chassis", "obstacle")
    assert {s["contact"] for s in drive.steps[:-1]} == {"none"}
    errors = [s["abs_rel"] for s in drive.steps]
    assert np.mean(errors) == pytest.approx(record.abs_rel, abs=1e-4)
    codes = drive.codes("error", 0)
    assert np.median(codes[codes > 0]) == pytest.approx(128 + 100 * np.log(1.1), abs=2)  # level ground, 10 % too far
    assert codes[:, 8:].max() > 150  # the rock, behind which the level ground lies
    unknown = np.isnan(drive.depth(0))
    assert unknown[:, :4].all() and not unknown[:, 8:].any()
    near = codes[-30:]  # rows of ground within range
    assert (near[:, :4] == 255).all() and (near[:, 8:] < 255).all()  # unknown depth counts as 80 m
    assert drive.steps[0]["action"] is not None and drive.steps[0]["status"] is None
    assert drive.steps[0]["map"] is None and drive.picture("map", 0) is None


def test_a_driver_that_stops_has_the_last_word(on_course, make_scene, make_course):
    class Quitter(StraightDriver):
        def act(self, env, observation):
            return Stop.NO_PATH if env.way.length > 0.5 else super().act(env, observation)

    env, calls = on_course(make_course(make_scene()), mast=True, eyes=EyesConfig(64, 64)), []
    recorder = Recorder(lambda env, driver, step: calls.append((step, env.outcome)))
    record = run_episode(env, Quitter(), Cell(k=0.0), 5, 0, watch=recorder.watch)
    assert calls[-2:] == [(record.steps, "driving"), (record.steps, "no_path")]
    with zipfile.ZipFile(io.BytesIO(recorder.drive_file(record, {}))) as archive:
        assert b'"outcome": "no_path", "action": null' in archive.read("drive.json")


def test_a_recorded_drive_can_be_replayed(arrival):
    """The navigator decides in each place as it did in the drive, but for what codes and true places round."""
    drive, _ = arrival
    area = area_of(drive)
    commands = replay(drive_frames(drive), drive.content["episode"]["goal"], area=area)
    assert area is not None and area[0] == area[1] == -area[2] == -area[3] < -3.5  # about the start and the goal
    assert len(commands) == len(drive.steps)
    assert [c.status for c in commands[:-1]] == [s["status"] for s in drive.steps[:-1]]
    speeds = [s["command"]["speed"] for s in drive.steps[:-1]]
    np.testing.assert_allclose([c.speed for c in commands[:-1]], speeds, atol=0.05)


@pytest.mark.parametrize("width", [40, 192, 1024])
def test_the_kept_pixels_have_their_own_rays(width):
    rig = NATECAM.resized(width, width)
    part, kept = _sampled(rig)
    np.testing.assert_allclose(kept.camera.rays(), rig.camera.rays()[part], atol=1e-12)


def test_the_kept_map_lies_around_the_place_that_is_asked_for():
    navigator = Navigator(config=NavigatorConfig(elevation=ElevationConfig(size=24.0)))
    unseen = np.full((48, 48), np.nan)
    navigator.step(unseen, None, NATECAM.resized(48, 48), body_pose(0, 0, 0), np.array([8.0, 0.0]))
    pictures, place = _reduced_map(navigator, np.array([3.0, -2.0]))
    assert navigator.map.known.any() and (pictures["height"] == height_codes(np.array(np.nan))).all()  # only assumed
    half = place["cells"] * place["cell"] / 2
    assert np.allclose([place["west"] + half, place["south"] + half], [3, -2], atol=place["cell"])
