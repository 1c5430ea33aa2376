from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from envs.drivers.builtin import NavigatorDriver, StraightDriver
from envs.drives.film import FPS, MAP_TITLE, PANEL, Film, map_around, navigator_map
from envs.world.eyes import EyesConfig
from envs.world.outside_view import WIDTH
from m3depth.stereo.prediction import Prediction
from marssim.physics.state import Contacts
from nav.command import Command
from nav.ground.map_files import UNKNOWN_COLOUR

EYES = EyesConfig(image_pixels=64, ground_truth_pixels=64, look_every=0.5)
EMPTY = np.zeros((PANEL, PANEL, 3), np.uint8)


@pytest.fixture
def filmed(on_course, make_scene, make_course, tmp_path):
    """An environment at its first step, the navigator that drives it, and a film of that."""
    scene = make_scene(rocks=[(-0.6, 0.0, 1.2, 0.8)])
    course, small = make_course(scene, start=(-3.0, 0.0, 0.0), goal=(3.0, 0.0)), EyesConfig(image_pixels=128)
    env = on_course(course, mast=True, eyes=small)
    driver, film = NavigatorDriver(), Film(tmp_path / "drive.mp4")
    driver.reset(env, 0)
    driver.act(env, env._observation())
    yield env, driver, film
    film.close()


def test_a_frame_shows_rover_eye_depth_normals_and_map(filmed, tmp_path):
    env, driver, film = filmed
    film.watch(env, driver, 0)
    film.watch(env, driver, 1)
    (frame,) = film.stills  # every tenth step
    assert frame.shape == (2 * PANEL, WIDTH + PANEL, 3) == (2 * PANEL, 3 * PANEL, 3) and frame.dtype == np.uint8
    panels = [frame[30:PANEL, :WIDTH], frame[30:PANEL, WIDTH:]]
    panels += [frame[PANEL + 30 :, n * PANEL : (n + 1) * PANEL] for n in range(3)]
    assert all(panel.std() > 5 for panel in panels)  # none is empty
    np.testing.assert_array_equal(panels[4], navigator_map(env, driver)[30:])
    film.close()
    film.close()
    assert len(film.stills) == 1
    video = cv2.VideoCapture(str(tmp_path / "drive.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == FPS and video.get(cv2.CAP_PROP_FRAME_COUNT) == 2
    ok, read = video.read()
    assert ok and read.shape == frame.shape
    assert np.abs(read[..., ::-1].astype(int) - frame).mean() < 12  # a lossy codec
    video.release()


class SkyAbove:
    """An estimator that sees sky in the upper half, and answers level ground's normals everywhere."""

    def infer(self, left, right, rig):
        depth = np.full(left.shape[:2], 5.0, np.float32)
        depth[: len(depth) // 2] = np.inf
        normal = np.broadcast_to(np.array([0, -0.8, -0.6], np.float32), (*depth.shape, 3))
        return Prediction(depth, rig.fb / depth, normal, np.ones_like(depth))


def test_the_sky_has_no_normals(on_course, make_scene, make_course, tmp_path):
    env = on_course(make_course(make_scene()), mast=True, perception=SkyAbove())
    with Film(tmp_path / "drive.mp4") as film:
        film.watch(env, StraightDriver(), 0)
    panel = film.stills[0][PANEL:, PANEL : 2 * PANEL]
    assert (panel[30 : PANEL // 2 - 2] == 0).all() and (panel[PANEL // 2 + 2 :].max(axis=2) > 100).all()


class WithoutNormals(SkyAbove):
    """An estimator that answers no normals."""

    def infer(self, left, right, rig):
        return replace(super().infer(left, right, rig), normal=None)


def test_where_an_estimator_answers_no_normals_their_panel_is_black(on_course, make_scene, make_course, tmp_path):
    env = on_course(make_course(make_scene()), mast=True, perception=WithoutNormals())
    with Film(tmp_path / "drive.mp4") as film:
        film.watch(env, StraightDriver(), 0)
    panel = film.stills[0][PANEL:, PANEL : 2 * PANEL]
    assert (panel[30:] == 0).all()


def pixels_near(picture, x, y, colour, reach=0.6):
    """Pixels of a colour about a place, in metres from the rover; east is right, north is up."""
    scale = PANEL / 24.0
    column, row, half = round(PANEL / 2 + x * scale), round(PANEL / 2 - y * scale), round(reach * scale)
    window = picture[row - half : row + half + 1, column - half : column + half + 1].astype(int)
    return (np.abs(window - colour).max(axis=2) < 60).sum()


def test_the_map_shows_the_rock_the_rover_and_the_goal(filmed):
    env, driver, _ = filmed
    picture = navigator_map(env, driver)
    assert picture.shape == (PANEL, PANEL, 3)
    near, scale = partial(pixels_near, picture), PANEL / 24.0
    assert near(2.4 - 0.5, 0.0, (190, 60, 60)) > 30  # the rock's near side is blocked
    assert near(6.0, 0.0, (80, 200, 255)) > 10
    assert near(0.0, 0.0, (255, 255, 255), 1.0) > 30
    assert near(-4.0, 4.0, UNKNOWN_COLOUR) == (2 * round(0.6 * scale) + 1) ** 2  # never seen
    assert near(-8.0, 8.0, (190, 60, 60)) == (2 * round(0.6 * scale) + 1) ** 2  # beyond the area that it keeps to


def test_the_map_is_drawn_where_the_rover_believes_to_be(filmed):
    """Odometry that is off moves the map with the rover; where it takes the goal to be is elsewhere on it then."""
    env, driver, _ = filmed
    env.believed_pose = env.believed_pose.copy()
    env.believed_pose[:2, 3] += (0.5, -1.5)
    driver.reset(env, 0)
    driver.act(env, env._observation())
    picture = navigator_map(env, driver)
    assert pixels_near(picture, 2.4 - 0.5, 0.0, (190, 60, 60)) > 30
    by_odometry, true = (pixels_near(picture, x, y, (80, 200, 255), 0.3) for x, y in ((5.5, 1.5), (6.0, 0.0)))
    assert 10 < by_odometry < true
    assert pixels_near(picture, 0.0, 0.0, (255, 255, 255), 1.0) > 30


def test_the_true_goal_is_where_it_is_from_the_rover(filmed):
    """6 m to the east of a rover that heads east and believes to head north."""
    env, _, _ = filmed
    goal, pose, believed = env.course.goal[:2], env.vehicle.state().pose, np.eye(4)
    believed[:2, :2] = [[0, -1], [1, 0]]
    picture = map_around(StraightDriver(), env.rover_spec, goal, pose, believed)
    assert pixels_near(picture, 0.0, 6.0, (80, 200, 255), 0.3) > 10
    assert pixels_near(picture, 6.0, 0.0, (80, 200, 255), 0.3) == 0


@pytest.mark.parametrize("ending", ["in the block", "closed", "raised"])
def test_a_film_is_whole_where_the_environment_is_closed_first(filmed, tmp_path, ending):
    env, driver, _ = filmed
    path = tmp_path / "closed.mp4"
    if ending == "raised":
        with pytest.raises(RuntimeError, match="driver failed"), Film(path) as film:
            film.watch(env, driver, 0)
            env.close()
            raise RuntimeError("driver failed")
    elif ending == "closed":
        film = Film(path)
        film.watch(env, driver, 0)
        env.close()
        film.close()
    else:
        with Film(path) as film:
            film.watch(env, driver, 0)
            env.close()
    assert path.exists() == (ending != "raised") and not list(tmp_path.glob(".*closed*"))


def test_a_frame_that_cannot_be_drawn_leaves_no_half_written_file(filmed, tmp_path, monkeypatch):
    env, driver, _ = filmed
    monkeypatch.setattr("envs.drives.film.map_around", lambda *given: 1 / 0)
    film = Film(tmp_path / "half.mp4")
    film.watch(env, driver, 0)
    with pytest.raises(ZeroDivisionError):
        film.close()
    assert not list(tmp_path.glob("*half*")) and not list(tmp_path.glob(".*half*"))


def test_a_driver_without_a_map_has_an_empty_one(filmed):
    env, _, _ = filmed
    picture = navigator_map(env, StraightDriver())
    assert (picture == UNKNOWN_COLOUR).all(axis=2).mean() > 0.95


def test_the_map_of_a_driver_without_one_is_not_shown_as_unknown_ground(filmed, monkeypatch):
    env, driver, film = filmed
    titles = []
    monkeypatch.setattr("envs.drives.film._titled", lambda image, *lines: titles.extend(lines) or image)
    film.watch(env, driver, 0)
    film.watch(env, StraightDriver(), 1)
    film.close()
    assert [title for title in titles if title.startswith("map")] == [MAP_TITLE, "map: this driver keeps none"]


def test_every_frame_says_what_is_driven(filmed, tmp_path, monkeypatch):
    env, driver, _ = filmed
    titles = []
    monkeypatch.setattr("envs.drives.film._titled", lambda image, *lines: titles.append(lines) or image)
    with Film(tmp_path / "named.mp4", "navigator, sgbm: course 3") as film:
        film.watch(env, driver, 7)
    (line,) = [lines for lines in titles if len(lines) > 1]
    assert line[0] == "navigator, sgbm: course 3" and line[1].startswith("step 7 ")


def test_filming_does_not_change_the_drive(make_env, tmp_path):
    """The picture that a film takes for the ground truth's left eye is its own."""
    ends = []
    for watched in (False, True):
        env = make_env(goal_distance=4.0, mast=True)
        env.reset(seed=2)
        if watched:
            with Film(tmp_path / "drive.mp4") as film:
                film.watch(env, StraightDriver(), 0)
        ends.append(env.step(np.array([1.0, 0.2, 0.3]))[0])
    for key in ends[0]:
        np.testing.assert_array_equal(ends[0][key], ends[1][key])


def test_an_interrupted_film_leaves_the_older_file_or_none(filmed, tmp_path):
    env, driver, _ = filmed
    for name, before in (("old.mp4", b"whole"), ("new.mp4", None)):
        path = tmp_path / "films" / name
        path.parent.mkdir(exist_ok=True)
        if before is not None:
            path.write_bytes(before)
        with pytest.raises(KeyboardInterrupt), Film(path) as film:
            film.watch(env, driver, 0)
            assert before is None or path.read_bytes() == before
            raise KeyboardInterrupt
        assert (path.read_bytes() if path.exists() else None) == before
    assert [file.name for file in (tmp_path / "films").iterdir()] == ["old.mp4"]


def test_a_film_has_its_name_once_it_is_whole(filmed, tmp_path):
    env, driver, _ = filmed
    path = tmp_path / "films" / "whole.mp4"
    path.parent.mkdir()
    with Film(path) as film:
        film.watch(env, driver, 0)
        assert not path.exists()
    assert list(path.parent.iterdir()) == [path]
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 1
    video.release()


def test_a_film_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OSError, match=r"none/a\.mp4"):
        Film(tmp_path / "none" / "a.mp4")


def test_every_frame_shows_command_status_and_contact_and_the_last_how_it_ended(filmed, tmp_path, monkeypatch):
    env, driver, _ = filmed
    titles = []
    monkeypatch.setattr("envs.drives.film._titled", lambda image, *lines: titles.append(lines) or image)
    with Film(tmp_path / "ended.mp4") as film:
        film.watch(env, driver, 1)
        env.outcome, driver.command = "no_path", Command(0.0, 0.0, None, "stuck")
        film.watch(env, driver, 1)
        env.outcome = "driving"
        film.watch(env, StraightDriver(), 2)
        film.watch(env, StraightDriver(), 2)
        env.outcome = "collision"
        monkeypatch.setattr(env.vehicle, "contacts", lambda: Contacts(chassis=True))
        film.watch(env, StraightDriver(), 3)
    decided, stuck, quits, going, hit = (lines[2:] for lines in titles if len(lines) > 2)
    assert decided == ("stuck: +0.00 m/s +0 deg/s   no contact", "")
    assert stuck == ("no contact", "ended: no_path (recoveries did not help)")
    assert quits == ("gives up   no contact", "")
    assert going == ("command +0.00 m/s +0 deg/s   no contact", "")
    assert hit == ("contact: chassis", "ended: collision")
    video = cv2.VideoCapture(str(tmp_path / "ended.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3 + 2 * 2 * FPS  # the ends stay for 2 s
    video.release()


def test_a_frame_shows_a_step_as_the_driver_met_it_and_what_it_chose_there(make_env, tmp_path, monkeypatch):
    env, driver, titles, maps = make_env(goal_distance=4.0, mast=True, eyes=EYES), NavigatorDriver(), [], []
    monkeypatch.setattr("envs.drives.film._titled", lambda image, *lines: titles.append(lines) or image)
    monkeypatch.setattr("envs.drives.film.map_around", lambda *given: maps.append(given) or EMPTY)
    observation, _ = env.reset(seed=2)
    driver.reset(env, 2)
    commands, looks, poses = [], [], []
    with Film(tmp_path / "drive.mp4") as film:
        for step in range(4):
            film.watch(env, driver, step)
            looks.append(step if env.gaze.fresh else looks[-1])
            poses.append(env.believed_pose)
            action = driver.act(env, observation)
            commands.append(driver.command)
            observation = env.step(action)[0]
        film.watch(env, driver, 4)
    heads = [lines for lines in titles if len(lines) > 1]
    assert [lines[1].split()[1] for lines in heads] == ["0", "1", "2", "3", "4"]
    for lines, command, given, pose in zip(heads, commands, maps, poses):
        assert lines[2].startswith(f"{command.status}: {command.speed:+.2f} m/s")
        np.testing.assert_array_equal(given[4], pose)
    assert heads[-1][2] == "no contact"  # nothing is decided there
    eyes = [lines[0] for lines in titles if lines[0].startswith("left eye")][:4]
    assert eyes == ["left eye" if look == step else f"left eye of step {look}" for step, look in enumerate(looks)]
    assert looks != [0, 1, 2, 3]  # some steps are without one
