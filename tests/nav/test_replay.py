"""The navigator on recorded frames: made and written here by ray casting, and read back as a user's would be."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from recorded_drives import drive_of, look_pictures, pose_rows
from recorded_drives import step as drive_step
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.bags.images import image_array
from marssim.base.bags.reader import Bag
from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.map_file import encode_map
from marssim.base.dataset.sample import write_sample
from marssim.base.files.json_file import read_json, write_json
from marssim.base.rover_spec import ZHURONG
from nav import Navigator
from nav import replay as command
from nav.map import main as nav_map
from nav.replay import Frame, dataset_frames, drive_frames, main, replay

WORLD = RockWorld(domes=np.array([[5.0, 0.0, 0.6, 0.6]]))


def keeping(bodies):
    """A Navigator.step that keeps where the rover is."""
    plain = Navigator.step

    def step(navigator, depth, confidence, rig, body, *more):
        bodies.append(body)
        return plain(navigator, depth, confidence, rig, body, *more)

    return step


def frames(steps=8):
    """Driving straight at a rock."""
    for step in range(steps):
        eye = body_pose(0.3 * step, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
        yield Frame(WORLD.depth(SMALL_RIG, eye), None, SMALL_RIG, eye)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("recorded") / "drive"
    names = []
    for number, frame in enumerate(frames()):
        names.append(f"00000/{number:02d}")
        sky = ~np.isfinite(frame.depth)
        image = np.full((192, 192, 3), 90, np.uint8)
        normal = np.where(sky[..., None], 0, np.array([0, 0, -1.0])).astype(np.float32)
        surface = np.where(sky, -1, 0).astype(np.int32)
        disparity = SMALL_RIG.depth_to_disparity(frame.depth)
        look = StereoFrame(image, image, frame.depth, disparity, normal, surface, sky & False, SMALL_RIG,
                           frame.camera_pose)  # fmt: skip
        write_sample(out / "scenes" / names[-1], look, {"scene": 0, "view": number})
    write_index(out, {"seed": 1}, names)
    return out


def test_a_replay_goes_round_the_rock_that_its_frames_show():
    commands = replay(frames(), (20.0, 0.0))
    assert len(commands) == 8 and commands[0].status == "drive"
    assert max(abs(c.yaw_rate) for c in commands) > 0.03
    free = replay((Frame(RockWorld().depth(SMALL_RIG, f.camera_pose), None, SMALL_RIG, f.camera_pose)
                   for f in frames()), (20.0, 0.0))  # fmt: skip
    assert len(free) == 8 and all(abs(c.yaw_rate) < 0.03 and c.status == "drive" for c in free)


@pytest.mark.parametrize("pose", ["missing", None, [[1, 0, 0, 0]] * 4, [[np.nan, 0, 0, 0], *np.eye(4)[1:].tolist()]])
def test_a_sample_without_a_pose_is_named(folder, tmp_path, capsys, pose):
    copy = shutil.copytree(folder, tmp_path / "copy")
    file = copy / "scenes" / "00000" / "02" / "sample.json"
    meta = {name: value for name, value in read_json(file).items() if name != "pose"}
    file.write_text(json.dumps(meta if pose == "missing" else {**meta, "pose": pose}))  # with NaN, unlike write_json
    assert main([str(copy)]) == 2
    error = capsys.readouterr().err
    why = error.removeprefix(f"error: {file}: ")
    assert re.match("pose must be |field 'pose' is missing|has no pose", why) and error.count("\n") == 1, why


def test_a_dataset_is_replayed_as_its_frames_are(folder):
    read = replay(dataset_frames(StereoDataset(folder), 0), (20.0, 0.0))
    for a, b in zip(read, replay(frames(), (20.0, 0.0)), strict=True):
        assert a.status == b.status and a.speed == pytest.approx(b.speed, abs=0.02)
        assert a.yaw_rate == pytest.approx(b.yaw_rate, abs=0.02)


@pytest.mark.parametrize("time", [None, "noon", -1.0, 1e30])
def test_a_time_that_is_none_is_named(folder, tmp_path, capsys, time):
    shutil.copytree(folder, tmp_path / "data")
    file = next((tmp_path / "data").glob("scenes/*/*/sample.json"))
    write_json(file, {**read_json(file), "timestamp": time})
    assert main([str(tmp_path / "data"), "--goal", "20", "0"]) == 2
    error = capsys.readouterr().err
    assert error == f"error: {file}: timestamp must be a number from 0 to 2e+09 s\n"


def test_a_replay_of_a_dataset_writes_a_bag_of_the_same_commands(folder, tmp_path, capsys):
    assert main([str(folder), "--goal", "20", "0"]) == 0
    printed = capsys.readouterr().out
    assert main([str(folder), "--goal", "20", "0", "--bag", str(tmp_path / "bag")]) == 0
    assert capsys.readouterr().out == printed.replace("8 frames", f"8 frames, in {tmp_path / 'bag'}")
    bag = Bag(tmp_path / "bag")
    assert [entry.stamp for entry in bag.entries(["/stereo/left/image_rect"])] == [10**9 * n for n in range(1, 9)]
    ((_, goal),) = bag.messages(["/navigator/goal"])
    _, pose = next(bag.messages(["/ground_truth/pose"]))
    ahead = goal.pose.position.x - pose.pose.position.x, goal.pose.position.y - pose.pose.position.y
    assert 18 < np.hypot(*ahead) < 22 and goal.header.stamp.sec == 1
    depth = image_array(next(bag.messages(["/stereo/depth/image_rect"]))[1])
    np.testing.assert_array_equal(depth, StereoDataset(folder)[0].depth)


def test_frames_close_to_each_other_and_pauses_are_no_obstacles():
    seen = []
    eyes = [body_pose(max(0.05 * (n - 5), 0), 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline) for n in range(12)]
    close = [Frame(RockWorld().depth(SMALL_RIG, eye), None, SMALL_RIG, eye) for eye in eyes]
    commands = replay(close, (20.0, 0.0), watch=lambda frame, navigator, command: seen.append(navigator))
    assert [command.status for command in commands] == 12 * ["drive"] and not seen[-1].recovery.bumps
    own = [replace(f, commanded=(c.speed, c.yaw_rate)) for f, c in zip(close, commands, strict=True)]
    replay(own, (20.0, 0.0), watch=lambda frame, navigator, command: seen.append(navigator))
    assert seen[-1].recovery.bumps  # the rover was to drive so, and stood still


def test_a_replay_does_not_wait_for_a_pan_that_the_recording_never_reaches():
    eyes = [body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)] * 12
    still = [Frame(RockWorld().depth(SMALL_RIG, eye), None, SMALL_RIG, eye) for eye in eyes]
    statuses = [command.status for command in replay(still, (-20.0, 0.0))]
    assert statuses.count("look") <= 2 and "turn" in statuses


def test_a_replay_ends_at_the_goal():
    assert [c.status for c in replay(frames(), (0.7, 0.0))] == ["drive", "arrived"]


def test_the_command_prints_a_line_a_frame_and_needs_no_simulator(folder):
    code = (
        "import sys; sys.modules.update(pybullet=None, embreex=None); from nav.replay import main;"
        "failed = main(sys.argv[1:]); sys.exit(failed or 'torch' in sys.modules)"
    )
    command = [sys.executable, "-c", code, str(folder), "--goal", "20", "0"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "8 commands for 8 frames" and done.stdout.count("m/s") == 8


def test_views_far_from_each_other_are_refused(folder, tmp_path, capsys):
    sample = StereoDataset(folder)[0]
    for number, x in enumerate((0.0, 9.0)):
        eye = body_pose(x, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
        surface = np.where(np.isfinite(sample.depth), 0, -1).astype(np.int32)
        look = StereoFrame(sample.left, sample.right, sample.depth, sample.disparity, sample.normal, surface,
                           sample.occluded, SMALL_RIG, eye)  # fmt: skip
        write_sample(tmp_path / "scenes" / f"00000/{number:02d}", look, {"scene": 0, "view": number})
    write_index(tmp_path, {"seed": 1}, ["00000/00", "00000/01"])
    assert main([str(tmp_path)]) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err == (
        f"error: {tmp_path}: holds no recorded drive, two of its views in a row lie 9.0 m apart; "
        "marssim.generate --trajectory makes one\n"
    )


@pytest.mark.parametrize("number", [1, 8])
def test_a_dataset_of_random_views_is_refused(folder, tmp_path, capsys, number):
    """Also where a scene has a single view."""
    copy = shutil.copytree(folder, tmp_path / "copy")
    names = StereoDataset(folder).names[:number]
    write_index(copy, {"seed": 1, "trajectory": True}, names)
    assert main([str(copy), "--mount", "0.65", "1.2", "20"]) == 0
    assert capsys.readouterr().err == ""
    write_index(copy, {"seed": 1, "trajectory": False}, names)
    assert main([str(copy)]) == 2
    shown = capsys.readouterr()
    assert shown.err == (
        f"error: {copy}: holds no recorded drive, its views are random; marssim.generate --trajectory makes one\n"
    )
    assert shown.out == ""


def test_view_shows_what_the_navigator_saw_and_chose_in_each_frame(folder, capsys, monkeypatch):
    pages = []
    monkeypatch.setattr(command, "check_viewer", lambda: None)
    monkeypatch.setattr(command, "show", lambda shots, title: pages.append((shots, title)))
    assert main([str(folder), "--goal", "20", "0", "--view"]) == 0
    ((shots, title),) = pages
    assert len(shots) == 8 and title == "drive, scene 0" and np.allclose(shots[3].pose, list(frames())[3].camera_pose)
    view = shots[3].load()
    assert list(view.layers) == ["traversability", "image", "depth"] and view.note.startswith("drive, 0.")
    goal, motion = view.lines
    assert goal.name == "Goal" and np.allclose(goal.points[:, 0], shots[0].pose[0, 3] + 20)
    assert motion.name == "Chosen motion" and np.allclose(motion.points[:, 2], 0.05, atol=0.06)
    # the dome ahead is an obstacle in the cloud and in the map, and the ground before it is free
    x, y, _ = (view.points @ shots[3].pose[:3, :3].T + shots[3].pose[:3, 3]).T
    colours = view.layers["traversability"].colours.astype(int)
    assert (colours[np.hypot(x - 5, y) < 0.3] == (190, 50, 45)).all()
    free = (np.abs(x - 3) < 0.3) & (np.abs(y) < 0.3)
    assert free.sum() > 20 and (colours[free, 1] > colours[free, 0]).all()
    (surface,) = view.surfaces
    dome = np.hypot(surface.vertices[:, 0] - 5, surface.vertices[:, 1]) < 0.25
    assert dome.any() and surface.vertices[dome, 2].max() > 0.4
    assert surface.faces.max() == len(surface.vertices) - 1 and len(surface.colours) == len(surface.vertices)


def test_a_recorded_episode_is_replayed_to_its_own_goal(tmp_path, capsys):
    """Every second step without a look, on which the navigator drives by its map."""
    steps, pictures = [], {}
    for n, frame in enumerate(frames()):
        looked = n % 2 == 0
        steps.append(drive_step(x=0.3 * n, looked=looked))
        pictures |= look_pictures(n, frame.depth) if looked else {}
    file = tmp_path / "drive.zip"
    drive = drive_of(file, steps, pictures, rig=SMALL_RIG, goal=(20.0, 0.0))
    commands = replay(drive_frames(drive), (20.0, 0.0))
    assert commands[0].status == "drive" and max(abs(c.yaw_rate) for c in commands) > 0.03
    assert main([str(file)]) == 0
    shown = capsys.readouterr()
    assert shown.out.splitlines()[-1] == "8 commands for 8 frames" and shown.err == ""
    assert main([str(file), "--goal", "-0.5", "0"]) == 0
    assert "arrived" in capsys.readouterr().out.splitlines()[1]


def test_a_map_that_nav_map_made_before_shows_the_rock_to_a_blind_drive(tmp_path, capsys):
    """The same frames without depth, once with the map of the frames with depth."""
    pairs, blind = tmp_path / "pairs", np.full((192, 192), np.nan, np.float32)
    for number, frame in enumerate(frames(3)):
        (pairs / str(number)).mkdir(parents=True)
        (pairs / str(number) / "depth.npy").write_bytes(encode_map(frame.depth, "depth", "npy"))
        pose = frame.camera_pose.tolist()
        (pairs / str(number) / "prediction.json").write_text(json.dumps({"rig": SMALL_RIG.to_dict(), "pose": pose}))
    # the origin of the map's files is not that of the poses
    assert nav_map([str(pairs), "--out", str(tmp_path / "map"), "--origin", "700", "-80"]) == 0
    steps = [drive_step(x=0.3 * n) for n in range(2)]
    pictures = {k: v for n in range(2) for k, v in look_pictures(n, blind).items()}
    file = tmp_path / "drive.zip"
    drive_of(file, steps, pictures, rig=SMALL_RIG, goal=(20.0, 0.0))
    capsys.readouterr()
    assert main([str(file)]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[1] == "blind"
    shots = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Navigator, "step", keeping_maps(shots))
        assert main([str(file), "--prior", str(tmp_path / "map")]) == 0
    tops, low = shots[0]
    assert tops > 0.4 and abs(low) < 0.05
    for fault, flags in (("has cells of 0.2 m; make it with --cell 0.1", ["--cell", "0.2"]), ("frame of a rover", [])):
        if not flags:
            for folder in pairs.iterdir():
                shutil.rmtree(folder) if folder.name != "0" else None
            record = json.loads((pairs / "0/prediction.json").read_text())
            record = {"rig": record["rig"], "camera_to_rover": record["pose"]}
            (pairs / "0/prediction.json").write_text(json.dumps(record))
        assert nav_map([str(pairs), "--out", str(tmp_path / "other"), *flags]) == 0
        assert main([str(file), "--prior", str(tmp_path / "other")]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith(f"error: --prior {tmp_path / 'other'}: ") and fault in error


def keeping_maps(shots):
    """A Navigator.step that keeps the highest point around the rock, and the ground before it."""
    plain = Navigator.step

    def step(navigator, *more):
        command = plain(navigator, *more)
        (left, low), (right, high) = navigator.map.cell_of(np.array([[4.2, -0.5], [5.0, 0.5]]))
        x, y = navigator.map.cell_of(np.array([3.0, 0.0]))
        shots.append((np.nanmax(navigator.map.top[low:high, left:right]), navigator.map.low[y, x]))
        return command

    return step


def test_the_frames_of_a_view_have_the_numbers_of_the_table(tmp_path, capsys, monkeypatch):
    shown = []
    monkeypatch.setattr(command, "check_viewer", lambda: None)
    monkeypatch.setattr(command, "show", lambda shots, title: shown.extend(shots))
    steps = [drive_step(x=0.3 * n, looked=n % 3 == 0) for n in range(7)]
    pictures = {
        k: v for n, frame in enumerate(frames(7)) if n % 3 == 0 for k, v in look_pictures(n, frame.depth).items()
    }
    drive_of(tmp_path / "drive.zip", steps, pictures, rig=SMALL_RIG, goal=(20.0, 0.0))
    assert main([str(tmp_path / "drive.zip"), "--view"]) == 0
    rows = {line.split()[0]: line.split()[1:3] for line in capsys.readouterr().out.splitlines()[1:-1]}
    assert [shot.name for shot in shown] == ["frame 0", "frame 3", "frame 6"]
    for shot in shown:
        status, speed = rows[shot.name.removeprefix("frame ")]
        assert shot.load().note.startswith(f"{status}, {speed} m/s")


@pytest.mark.parametrize("area", [[-9.0, -9.0, 0.5, 9.0], None])
def test_the_area_of_a_recorded_drive_is_kept_to(tmp_path, capsys, area):
    """Without one, as in files of before, the rover drives on."""
    pictures = look_pictures(0, next(iter(frames())).depth)
    limits = {} if area is None else {"area": area}
    drive_of(tmp_path / "drive.zip", [drive_step(looked=True)], pictures, rig=SMALL_RIG, goal=(20.0, 0.0), **limits)
    assert main([str(tmp_path / "drive.zip")]) == 0
    assert ("drive" in capsys.readouterr().out.splitlines()[1]) == (area is None)


def test_an_empty_area_is_named(tmp_path, capsys):
    drive_of(tmp_path / "drive.zip", [drive_step()], area=[1.0, 0.0, 1.0, 2.0])
    assert main([str(tmp_path / "drive.zip")]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'drive.zip'}: area must be x0 < x1 and y0 < y1 [m]")


def test_the_bag_of_a_drive_has_its_times_and_both_poses(tmp_path):
    depth = np.full((8, 8), 3.0)
    steps = [drive_step(x=x, y=0.2, looked=True, believed_pose=pose_rows(x, 0.0, 0.0)) for x in (0.0, 0.4)]
    pictures = look_pictures(0, depth) | look_pictures(1, depth)
    drive_of(tmp_path / "drive.zip", steps, pictures)
    assert main([str(tmp_path / "drive.zip"), "--bag", str(tmp_path / "bag")]) == 0
    bag = Bag(tmp_path / "bag")
    assert [entry.stamp for entry in bag.entries(["/ground_truth/pose"])] == [10**9, 3 * 10**9]
    true = [m.pose.position for _, m in bag.messages(["/ground_truth/pose"])]
    believed = [m.pose.pose.position for _, m in bag.messages(["/odom"])]
    assert [(p.x, p.y) for p in true] == [(0, 0.2), (0.4, 0.2)]
    np.testing.assert_allclose([(p.x, p.y) for p in believed], [(0, 0), (0.4, 0)], atol=1e-9)
    assert "/stereo/left/image_rect" not in bag.topics


def test_the_file_of_a_drive_has_no_scenes(tmp_path, capsys):
    drive_of(tmp_path / "drive.zip", [drive_step()])
    assert main([str(tmp_path / "drive.zip"), "--number", "3"]) == 2
    assert f"--number is for a dataset; {tmp_path / 'drive.zip'} holds one drive" in capsys.readouterr().err


def test_a_recorded_look_without_depth_and_a_foreign_file_are_named(tmp_path, capsys):
    drive_of(tmp_path / "drive.zip", [drive_step(looked=True)])
    (tmp_path / "notes.txt").write_text("no drive")
    for name, fault in (("drive.zip", "steps[0] has no depth"), ("notes.txt", "is not a whole zip archive")):
        assert main([str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"error: {tmp_path / name}: {fault}") and error.count("\n") == 1


def test_a_folder_that_is_no_dataset_says_what_to_name(tmp_path, capsys):
    (tmp_path / "drives").mkdir()
    drive_of(tmp_path / "drives" / "a.zip", [drive_step()])
    for name in (".", "drives"):
        assert main([str(tmp_path / name)]) == 2
        file = tmp_path / "drives" / "a.zip"
        assert capsys.readouterr().err == f"error: {tmp_path / name}: holds recorded drives; name one, such as {file}\n"
    (tmp_path / "left").mkdir()
    assert main([str(tmp_path / "left")]) == 2
    assert "other rovers are replayed in Python, by nav.replay.replay" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["believed_pose", "pose"])
@pytest.mark.parametrize(
    ("entry", "fault"), [(7.0, "a rotation and a translation"), (None, "within 1e+06 m of the ori")]
)
def test_a_broken_pose_of_a_drive_is_named(tmp_path, capsys, name, entry, fault):
    rows = pose_rows(0.4, 0.0, 0.0)
    rows[0][3 if entry is None else 0] = 1e30 if entry is None else entry
    drive_of(tmp_path / "drive.zip", [drive_step(), drive_step(**{name: rows})])
    assert main([str(tmp_path / "drive.zip")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {tmp_path / 'drive.zip'}: steps[1].{name}: pose must ") and fault in error
    assert error.count("\n") == 1


def test_mistakes_exit_with_2_and_one_line(folder, tmp_path, capsys):
    for arguments, named in (
        ([str(folder), "--number", "7"], "scene 7"),
        ([str(folder), "--number", "-1"], "number"),
        ([str(tmp_path / "no")], "no"),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert named in error and error.startswith("error: ") and error.count("\n") == 1


def test_the_cameras_are_where_the_dataset_or_the_flag_says(folder, tmp_path, capsys, monkeypatch):
    """The rock, 0.6 m high and 5 m ahead, is 0.6 m higher or lower if the cameras are."""
    command = [str(folder), "--goal", "20", "0"]
    assert main(command) == 0
    as_on_zhurong = capsys.readouterr()
    assert as_on_zhurong.err.startswith(f"warning: {folder}: does not say where its cameras are on the rover")
    assert main([*command, "--mount", "0.65", "1.2", "20"]) == 0
    assert capsys.readouterr() == (as_on_zhurong.out, "")
    assert main([*command, "--mount", "0.65", "1.2", "45"]) == 0
    assert capsys.readouterr().out != as_on_zhurong.out

    data = tmp_path / "drive"
    shutil.copytree(folder, data)
    for place, pan in ((ZHURONG.mount, 0.0), (replace(ZHURONG.mount, y=-0.1, height=0.5, pitch=0.6), 0.6)):
        mount = place.left_eye(SMALL_RIG.baseline, pan)
        for sample in data.glob("scenes/*/*/sample.json"):
            write_json(sample, {**read_json(sample), "camera_to_rover": mount.tolist()})
        bodies = []
        monkeypatch.setattr(Navigator, "step", keeping(bodies))
        assert main([str(data), "--goal", "20", "0"]) == 0
        assert capsys.readouterr().err == ""
        poses = [read_json(sample)["pose"] for sample in sorted(data.glob("scenes/*/*/sample.json"))]
        np.testing.assert_allclose(bodies @ mount, poses, atol=1e-9)
        monkeypatch.undo()

    for flag in (["0.65", "0", "20"], ["0.65", "1.2", "91"], ["0.65", "1200", "20"]):
        assert main([*command, "--mount", *flag]) == 2
        assert (
            "--mount must be metres ahead, -10 to 10, metres above the ground, 0.001 to 10, and -90 to 90 deg"
            in capsys.readouterr().err
        )


def test_a_goal_lies_ahead_and_to_the_left_of_the_first_image():
    yaw = 0.7
    eye = body_pose(3.0, -1.0, yaw) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    goal = command._world(Frame(None, None, SMALL_RIG, eye), (5.0, 2.0))
    assert goal == pytest.approx(eye[:2, 3] + 5 * ahead + 2 * left)


def test_the_rover_in_view_is_no_ground(folder, tmp_path):
    """A deck that is seen at the lower border would be an obstacle right before the rover."""
    shutil.copytree(folder, tmp_path / "deck")
    for file in (tmp_path / "deck").rglob("surface.png"):
        surface = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        surface[-40:] = 65535
        cv2.imwrite(str(file), surface)
    (frame, *_), (plain, *_) = (list(dataset_frames(StereoDataset(place), 0)) for place in (tmp_path / "deck", folder))
    assert np.isnan(frame.depth[-40:]).all() and np.array_equal(frame.depth[:-40], plain.depth[:-40])
