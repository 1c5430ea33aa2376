import json
import os
import re
import shutil
import subprocess
import sys
import traceback
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from envs.drives.episodes import Cell
from envs.evaluate import evaluate, main
from envs.evaluation import driving
from envs.evaluation.config import LOOK_FLAGS, SETTINGS, EvaluateConfig, Task
from envs.evaluation.driving import drive, drives_done
from envs.suites.conditions import under
from envs.world.eyes import EyesConfig
from envs.world.user_code import UserCodeError
from marssim.base.bags.reader import Bag
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.results.lock import sole_writer
from marssim.scene.look import LookConfig
from marssim.scene.presets import preset

pytestmark = pytest.mark.usefixtures("undrawn_figures")

QUICK = {
    "driver": ("straight",), "perception": ("ground_truth",), "dynamics": "kinematic", "goal_distance": 3.0,
    "k": (0.01,), "videos": False, "eyes": EyesConfig(image_pixels=64, ground_truth_pixels=64),
}  # fmt: skip
FLAGS = ["--driver", "straight", "--perception", "ground_truth", "--dynamics", "kinematic", "--goal-distance", "3"]
FLAGS += ["--k", "0.01", "--no-videos", "--image-pixels", "64", "--ground-truth-pixels", "64"]


def without_times(value):
    """Without what differs from run to run."""
    if isinstance(value, dict):
        varying = ("step_seconds", "perception_seconds", "config", "versions")
        return {k: without_times(v) for k, v in value.items() if k not in varying}
    return [without_times(v) for v in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("evaluation")
    return out, evaluate(EvaluateConfig(out, episodes=2, seed=3, **QUICK))


def test_results_hold_the_settings_and_the_drives(finished):
    out, content = finished
    results = json.loads((out / "results.json").read_text())
    assert results == content
    (row,) = results["results"]
    assert (row["driver"], row["perception"], row["episodes"]) == ("straight", "ground_truth", 2)
    assert row["cell"] == {"k": 0.01, "slope_deg": None}
    for name in ("success_rate", "spl", "collision_rate"):
        assert 0 <= row[name] <= 1
    assert row["step_seconds"] > row["perception_seconds"] >= 0
    assert results["config"]["seed"] == 3 and results["config"]["driver"] == ["straight"]
    assert results["versions"]["numpy"]
    assert "straight" in (out / "results.md").read_text() and len(list((out / "maps").iterdir())) == 1
    assert len(list((out / "episodes").glob("*.json"))) == 2


def test_an_evaluation_continues_where_it_was_stopped(finished, monkeypatch):
    out, content = finished
    lost, unchanged = sorted((out / "episodes").glob("*.json"))
    lost.unlink()
    before = unchanged.stat().st_mtime_ns
    driven = []
    monkeypatch.setattr(driving, "drive", lambda config, task, watch: driven.append(task) or drive(config, task))
    again = evaluate(EvaluateConfig(out, episodes=2, seed=3, **QUICK))
    assert without_times(again) == without_times(content)
    assert [task.file for task in driven] == [lost.name] and unchanged.stat().st_mtime_ns == before


def test_a_damaged_record_is_named(tmp_path, monkeypatch):
    config = EvaluateConfig(tmp_path, episodes=1, **QUICK)
    monkeypatch.setattr("envs.evaluation.driving.run_episode", lambda *_: pytest.fail("it is there already"))
    (tmp_path / "episodes").mkdir()
    (tmp_path / SETTINGS).write_text(json.dumps({**config.content(), "weights": {}}))
    file = tmp_path / "episodes" / Task("straight", "ground_truth", config.cells[0], 0).file
    for content in ("{", '{"driver": "straight"}'):
        file.write_text(content)
        with pytest.raises(DatasetError, match=re.escape(str(file)) + ".*delete the file to drive this episode again"):
            evaluate(config)


def test_a_record_of_another_drive_is_named(finished, tmp_path):
    out = shutil.copytree(finished[0], tmp_path / "copy")
    first, second = sorted((out / "episodes").glob("*.json"))
    shutil.copy(first, second)
    message = (
        f"{second}: is the record of straight, ground_truth, course 0; delete the file to drive this episode again"
    )
    with pytest.raises(DatasetError, match=f"^{re.escape(message)}$"):
        evaluate(EvaluateConfig(out, episodes=2, seed=3, **QUICK))


def run(capsys, *arguments):
    """Exit code and what was printed."""
    code = main([str(argument) for argument in arguments])
    return code, capsys.readouterr().err


def test_a_folder_of_other_settings_is_refused(finished, capsys):
    out, _ = finished
    before = (out / "results.json").read_text()
    code, message = run(capsys, "--out", out, "--episodes", 2, "--seed", 4, "--drift", 0.1, *FLAGS)
    assert code == 2 and str(out) in message and message.count("\n") == 1
    assert "other settings (--seed 3, not 4; --drift none, not 0.1); choose another --out" in message
    assert (out / "results.json").read_text() == before


@pytest.mark.parametrize(
    ("flags", "named"),
    [
        (["--perception", "m3depht"], "--perception 'm3depht' is unknown (did you mean m3depth?); choose from"),
        (["--driver", "navigater"], "--driver 'navigater' is unknown (did you mean navigator?); choose from"),
        (["--driver", "nowhere:Wary"], "--driver 'nowhere:Wary' cannot be made: No module named 'nowhere'; run python"),
        (
            ["--driver", "./my_driver.py:Wary"],
            "--driver './my_driver.py:Wary' cannot be made: No module named './my_driver.py'; name it as package",
        ),
        (["--perception", "nowhere:Net"], "--perception 'nowhere:Net': No module named 'nowhere'; run python -m in"),
        (["--perception", "magic"], "magic"), (["--perception", "m3depth:/no/such.safetensors"], "no/such"),
        (["--perception", "json:Nothing"], "Nothing"), (["--driver", "magic"], "--driver"),
        (["--film-courses", "10"], "--film-courses"), (["--bag-courses", "10"], "--bag-courses must lie in [0, 9]"),
        (["--shard", "2/4", "--film-courses", "0"], "--film-courses 0: --shard 2/4 drives no course of this number"),
        (["--shard", "2/4", "--bag-courses", "2"], "--bag-courses 2: --shard 2/4 drives no course of this number"),
        (["--episodes", "0"], "--episodes"), (["--workers", "0"], "--workers"), (["--seed", "-1"], "--seed"),
        (["--k", "0.9"], "k must"), (["--k", "0.1", "0.1"], "--k"), (["--slope-deg", "-4"], "slope"),
        (["--goal-distance", "1"], "distance must"), (["--goal-distance", "nan"], "distance must"),
        (["--driver", "straight", "straight"], "--driver"), (["--driver", "/no/such.zip"], "/no/such.zip"),
        (["--driver", "json:Nothing"], "Nothing"), (["--grid"], "--grid"), (["--drift", "-1"], "drift"),
        (["--drift", "1.1"], "--drift must lie in [0, 1], got 1.1"), (["--disparity-noise", "11"], "--disparity-noise"),
        (["--slip", "sand", "--slip-measured", "1.5"], "--slip-measured must lie in [0, 1], got 1.5"),
        (["--driver", "d\udcff/p.zip"], r"--driver 'd\udcff/p.zip': is not UTF-8 text; rename the file"),
        (["--k", "0", "0.4", "--goal-distance", "40"], "--k 0.4 with a --goal-distance of 40 m: the scene may have"),
        (["--slip-measured", "0.5"], "--slip-measured needs --slip"), (["--slip", "mud"], "--slip"),
        (["--split", "test"], "--split needs --suite"), (["--condition", "ditch"], "ditch needs a --goal-distance of"),
        (["--condition", "dense_rocks"], "--k does not go with --condition dense_rocks, which has its own k"),
        (["--condition", "far_goal"], "--k does not go with --condition far_goal"),
        (["--yaw-drift-deg", "nan"], "--yaw-drift-deg must lie in [0, 45]"),
        (["--sun-elevation-deg", "0"], "--sun-elevation-deg must"), (["--texture-strength", "9"], "--texture"),
    ],
)  # fmt: skip
def test_mistakes_are_named_before_anything_is_written(monkeypatch, capsys, tmp_path, flags, named):
    monkeypatch.setattr("envs.evaluate._run", lambda *_: pytest.fail("it began to drive"))
    code, message = run(capsys, "--out", tmp_path / "out", *FLAGS, "--workers", 2, *flags)
    assert code == 2 and named in message
    assert message.startswith("error: ") and message.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_word_for_a_number_names_its_flag(capsys, tmp_path):
    code, message = run(capsys, "--out", tmp_path / "out", "--episodes", "many")
    assert code == 2 and "--episodes" in message


def test_help_lists_every_flag(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    shown = capsys.readouterr().out
    assert "--grid \\" in shown  # the example can be copied
    for flag in ("--out", "--driver", "--perception", "--episodes", "--k", "--slope-deg", "--dynamics", "--workers"):
        assert flag in shown


def test_cells_are_the_grid():
    config = EvaluateConfig(None, k=(0.05, 0.1), slope_deg=(0.0, 10.0))
    assert config.cells == [Cell(0.05, 0.0), Cell(0.05, 10.0), Cell(0.1, 0.0), Cell(0.1, 10.0)]
    assert EvaluateConfig(None).cells == [Cell()]
    assert len(EvaluateConfig(None, grid=True).cells) == 20 and Cell(0.2, 15.0) in EvaluateConfig(None, grid=True).cells


def test_a_look_that_is_asked_for_is_the_scenes_and_of_other_drives():
    plain, low = EvaluateConfig(None), EvaluateConfig(None, sun_elevation_deg=8.0, texture_strength=0.1)
    assert plain.scene_config() == preset("utopia") and "sun_elevation_deg" not in plain.content()
    scene = low.scene_config()
    assert scene.look.sun_elevation_deg == (8.0, 8.0) and scene.look.texture_strength == (0.1, 0.1)
    assert scene.rocks == plain.scene_config().rocks
    assert low.content().items() - plain.content().items() == {("sun_elevation_deg", 8.0), ("texture_strength", 0.1)}


def test_a_look_that_is_asked_for_holds_under_conditions_with_a_place_or_a_sun_of_their_own(monkeypatch):
    class Made(Exception):
        pass

    def make(*_, condition, **__):
        raise Made(condition)

    monkeypatch.setattr(driving, "MarsNavEnv", make)
    config = EvaluateConfig(None, condition=("ledges", "low_sun"), optical_depth=5.0, sun_elevation_deg=30.0, **QUICK)
    looks = []
    for task in config.tasks[:2]:
        with pytest.raises(Made) as made:
            drive(config, task)
        place, _, _ = under(made.value.args[0], config.scene_config(), config.course_config(), config.eyes)
        looks.append((place.look.optical_depth, place.look.sun_elevation_deg))
    assert sorted(looks) == [((5.0, 5.0), (8.0, 8.0)), ((5.0, 5.0), (30.0, 30.0))]


def test_drives_without_aligned_rows_are_other_drives():
    aligned, given = EvaluateConfig(None), EvaluateConfig(None, align_rows=False)
    assert given.content().items() - aligned.content().items() == {("align_rows", False)}


def test_wheels_that_slip_are_of_other_drives(tmp_path):
    plain = EvaluateConfig(tmp_path / "out", episodes=1, seed=3, **QUICK)
    sand = replace(plain, slip="sand", slip_measured=0.5)
    assert not {"slip", "slip_measured"} & plain.content().keys()
    assert sand.content().items() - plain.content().items() == {("slip", "sand"), ("slip_measured", 0.5)}
    content = evaluate(sand)
    record = json.loads(next((tmp_path / "out" / "episodes").glob("*.json")).read_text())
    assert 0 < record["slip"] < 0.5 and record["energy"] > 100
    assert content["driven_with"]["slip"] == "sand" and "--slip sand" in (tmp_path / "out" / "results.md").read_text()
    assert without_times(evaluate(sand)) == without_times(content)  # and the drive is there already
    for other in (plain, replace(sand, slip_measured=1.0)):
        with pytest.raises(DatasetError, match="other settings"):
            evaluate(other)


def test_a_place_from_a_file_is_noted_by_its_content(tmp_path):
    """Other spaces, or another folder, are the same place; another value is another place."""
    files = [tmp_path / folder / "my_place.json" for folder in ("a", "b", "c")]
    for file, text in zip(files, ['{"preset": "gale"}', '{ "preset" : "gale" }', '{"preset": "gale", "horizon": 40}']):
        file.parent.mkdir()
        file.write_text(text)
    first, same, other = (EvaluateConfig(None, scene=str(file)).content() for file in files)
    assert first == same and first["scene"] == "my_place.json"
    assert first.items() ^ other.items() == {(key, c[key]) for c in (first, other) for key in ("scene_sha256",)}
    assert EvaluateConfig(None, scene=str(files[2])).scene_config() == preset("gale", horizon=40.0)


def test_the_true_depth_has_the_pixels_of_the_images_where_other_perceptions_drive_too(tmp_path):
    def pixels(*perceptions, **changes):
        config = EvaluateConfig(tmp_path, perception=perceptions, **changes).with_true_pixels()
        return config.eyes.ground_truth_rig.camera.width, config.content().get("ground_truth_pixels")

    assert pixels("ground_truth") == (128, None)
    assert pixels("ground_truth", "sgbm") == (512, 0)
    assert pixels("ground_truth", "sgbm", eyes=EyesConfig(image_pixels=256)) == (256, 0)
    assert pixels("ground_truth", "sgbm", eyes=EyesConfig(ground_truth_pixels=128)) == (128, None)
    assert pixels("sgbm", "m3depth") == (128, None)


def test_a_folder_of_the_earlier_default_place_is_refused_in_one_line(finished, capsys):
    """Release 0.1 drove in gale where no --scene was given."""
    out, _ = finished
    settings = json.loads((out / SETTINGS).read_text())
    (out / SETTINGS).write_text(json.dumps({**settings, "scene": "gale"}))
    try:
        code, message = run(capsys, "--out", out, *FLAGS, "--episodes", 2, "--seed", 3)
    finally:
        (out / SETTINGS).write_text(json.dumps(settings))
    assert code == 2 and message.count("\n") == 1
    assert "--scene gale" in message and "choose another --out" in message


def test_every_flag_of_the_look_changes_the_scene():
    assert set(LOOK_FLAGS) == vars(LookConfig()).keys() & vars(EvaluateConfig(None)).keys()


@pytest.mark.parametrize("name", LOOK_FLAGS)
def test_every_flag_of_the_look_is_a_field_of_the_scenes(name):
    config = EvaluateConfig(None, **{name: 0.7})
    assert getattr(config.scene_config().look, name) == (0.7, 0.7)
    assert config.content()[name] == 0.7
    with pytest.raises(ValueError, match=f"--{name.replace('_', '-')} must lie in"):
        EvaluateConfig(None, **{name: -1.0})


def test_every_task_has_a_file_of_its_own():
    drivers = ("navigator", "a=1.zip", "a_1.zip", "a 1.zip")
    perceptions = ("m3depth", "m3depth:runs/a", "m3depth:runs_a", "m3depth:runs a", "pkg.module:Class")
    cells = (Cell(), Cell(0.1), Cell(0.1, 5), Cell(0.1234567), Cell(0.1234568))
    files = {Task(d, p, c, e).file for d in drivers for p in perceptions for c in cells for e in (0, 1)}
    assert len(files) == len(drivers) * len(perceptions) * len(cells) * 2
    assert all(set(file) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_") for file in files)


@pytest.mark.parametrize("letter", ["a", "\u00e4", "\u706b"])
def test_the_files_of_long_names_have_names_that_a_disk_takes(tmp_path, letter):
    folder = "/".join([letter * 60] * 4)
    tasks = [Task(f"/{n}/{folder}/policy.zip", f"m3depth:/{folder}/{n}", Cell(0.1, 5), 0) for n in range(3)]
    for task in tasks:
        write_json(tmp_path / task.file, {})
    assert len(list(tmp_path.iterdir())) == 3


@pytest.fixture
def films(monkeypatch):
    """Name of the file, driver and title of each film that is made, of empty pictures."""
    made = []

    class NoFilm:
        def __init__(self, path, title):
            self.path, self.title = path, title

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.path.write_bytes(b"film")

        def watch(self, env, driver, step):
            if step == 0:
                made.append((self.path.name, type(driver).__name__, self.title))

    monkeypatch.setattr("envs.drives.film.Film", NoFilm)
    return made


def test_the_best_and_the_worst_are_filmed_once(films, tmp_path, monkeypatch):
    config = EvaluateConfig(tmp_path, episodes=2, seed=3, **{**QUICK, "driver": ("straight", "random"), "videos": True})
    content = evaluate(config)
    assert [name for name, *_ in films] == ["best.mp4", "worst.mp4"] and films[1][1] == "RandomDriver"
    title = films[1][2]
    assert title.startswith("random, ground_truth: course ") and title.endswith(", k=0.01, slope=preset")
    evaluate(replace(config, film_courses=(0, 1)))  # adds to them; two of the four drives are filmed already
    assert sorted(driver for _, driver, _ in films[2:]) == ["RandomDriver", "StraightDriver"]
    assert len({title for *_, title in films}) == 4
    assert {file.read_bytes() for file in (tmp_path / "videos").iterdir()} == {b"film"}
    page = (tmp_path / "results.html").read_text()
    for film in ("best.mp4", "worst.mp4", *(f"videos/{file.name}" for file in (tmp_path / "videos").iterdir())):
        assert f'<a href="{film}">' in page
    assert len(list((tmp_path / "videos").iterdir())) == 4 and not list(tmp_path.rglob(".*"))
    assert [(d["driver"], d["less"]) for d in content["differences"]] == [("random", ["straight", "ground_truth"])]
    monkeypatch.setattr("envs.evaluation.driving.run_episode", lambda *_: pytest.fail("it was filmed already"))
    evaluate(replace(config, film_courses=(0, 1)))


def test_the_courses_that_are_named_are_written_as_bags_once(tmp_path, monkeypatch):
    config = EvaluateConfig(tmp_path, episodes=1, seed=3, bag_courses=(0,), **QUICK)
    evaluate(config)
    (path,) = (tmp_path / "bags").iterdir()
    (record,) = (json.loads(file.read_text()) for file in (tmp_path / "episodes").glob("*-0000.json"))
    bag = Bag(path)
    assert path.name.endswith("-0000") and bag.topics["/stereo/left/image_rect"] == "sensor_msgs/Image"
    assert len(bag.entries(["/ground_truth/pose"])) == record["steps"] + 1
    places = [(m.pose.position.x, m.pose.position.y) for _, m in bag.messages(["/ground_truth/pose"])]
    np.testing.assert_allclose(places, record["track"], atol=1e-6)  # the drive of the record
    *_, (_, last) = bag.messages(["/navigator/status"])
    assert last.data == record["outcome"]
    monkeypatch.setattr("envs.evaluation.driving.run_episode", lambda *_: pytest.fail("it was written already"))
    evaluate(config)


@pytest.mark.parametrize(("driver", "film"), [("straight", "best.mp4"), ("random", "worst.mp4")])
def test_a_single_drive_is_filmed_once(films, tmp_path, driver, film):
    """As the best one if it arrived, else as the worst."""
    evaluate(EvaluateConfig(tmp_path, episodes=1, seed=3, **{**QUICK, "driver": (driver,), "videos": True}))
    assert [name for name, *_ in films] == [film] == [file.name for file in tmp_path.glob("*.mp4")]
    assert list(json.loads((tmp_path / "videos.json").read_text())) == [film]


@pytest.mark.parametrize("other", [False, True])
def test_a_drive_that_is_repeated_to_be_recorded_is_filmed_again_if_it_is_another(films, tmp_path, other):
    config = EvaluateConfig(tmp_path, episodes=1, seed=3, **{**QUICK, "driver": ("straight",), "videos": True})
    evaluate(config)
    (file,) = (tmp_path / "episodes").glob("*-0000.json")
    record = json.loads(file.read_text())
    write_json(file, {**record, "code": "0123456789ab", "path_length": record["path_length"] + other})
    evaluate(replace(config, record="all"))
    assert len(films) == 1 + other and json.loads(file.read_text())["path_length"] == record["path_length"]


@pytest.mark.parametrize("videos", [False, True])
def test_a_film_that_is_no_longer_the_worst_is_deleted_or_at_least_not_shown(films, tmp_path, videos):
    config = EvaluateConfig(tmp_path, episodes=1, seed=3, **{**QUICK, "driver": ("straight", "random"), "videos": True})
    evaluate(config)
    assert {file.name for file in tmp_path.glob("*.mp4")} == {"best.mp4", "worst.mp4"}
    evaluate(replace(config, driver=("straight",), videos=videos))
    page = (tmp_path / "results.html").read_text()
    assert "best.mp4" in page and "worst.mp4" not in page and len(films) == 2
    if videos:
        assert [file.name for file in tmp_path.glob("*.mp4")] == ["best.mp4"]
        assert list(json.loads((tmp_path / "videos.json").read_text())) == ["best.mp4"]


def test_the_progress_of_a_film_names_it(films, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("marssim.base.command.progress.LINE_SECONDS", 0.0)
    config = EvaluateConfig(tmp_path, episodes=2, seed=3, film_courses=(0, 1), **{**QUICK, "videos": True})
    evaluate(config)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("filming ")]
    assert {line.rpartition(": ")[0] for line in lines} == {"filming best drive", "filming worst drive"}
    (tmp_path / "videos.json").unlink()
    evaluate(replace(config, videos=False))
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("filming ")]
    for file in (tmp_path / "episodes").iterdir():
        record = json.loads(file.read_text())
        words = f"filming course {record['episode']}, k=0.01, slope=preset, straight, ground_truth"
        looks = record["steps"] + 1
        counts = [line for line in lines if line.startswith(f"{words}: ")]
        assert len(counts) == looks and counts[-1].startswith(f"{words}: {looks}/{looks} steps, ")


def test_what_a_killed_film_left_is_deleted(finished, tmp_path):
    out = shutil.copytree(finished[0], tmp_path / "copy")
    for left in (out / ".worst.mp4.123.part", out / "videos" / ".straight-0.mp4.123.part"):
        left.mkdir(parents=True)
        (left / "half.mp4").write_bytes(b"half")
    evaluate(EvaluateConfig(out, episodes=2, seed=3, **QUICK))
    assert not list(out.rglob(".*"))


def test_every_environment_is_closed(monkeypatch, tmp_path):
    closed = []
    monkeypatch.setattr("envs.evaluation.driving.run_episode", lambda env, *_: closed.append(env))
    monkeypatch.setattr("envs.evaluation.driving.MarsNavEnv.close", lambda env: closed.append(env))
    for episode in range(3):
        driving.drive(EvaluateConfig(tmp_path, **QUICK), Task("straight", "sgbm", Cell(), episode))
    assert len(closed) == 6 and closed[0::2] == closed[1::2]


def test_drives_compute_in_one_thread(monkeypatch, tmp_path):
    """The depth of a network depends on the number of threads, in its last bits."""

    def counts():
        return cv2.getNumThreads(), torch.get_num_threads()

    threads, before = [], counts()
    monkeypatch.setattr(driving, "run_episode", lambda *_: threads.append(counts()))
    cv2.setNumThreads(2)
    torch.set_num_threads(2)
    try:
        config = EvaluateConfig(tmp_path, episodes=1, **QUICK)
        drive(config, config.tasks[0])
        assert threads == [(1, 1)] and counts() == (2, 2)
    finally:
        cv2.setNumThreads(before[0])
        torch.set_num_threads(before[1])


def test_dask_does_not_change_results(finished, tmp_path):
    distributed = pytest.importorskip("distributed")
    options = {"processes": False, "dashboard_address": ":0", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, **options) as cluster:
        content = evaluate(EvaluateConfig(tmp_path, episodes=2, seed=3, scheduler=cluster.scheduler_address, **QUICK))
    assert without_times(content) == without_times(finished[1])


def test_the_command_by_its_name_drives_in_workers_and_says_one_row(finished, tmp_path):
    """As users run it, where the module is called __main__."""
    command = [sys.executable, "-m", "envs.evaluate", "--out", str(tmp_path), "--episodes", "2", "--seed", "3"]
    done = subprocess.run([*command, "--workers", "2", *FLAGS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *table, last = done.stdout.strip().splitlines()
    assert last.startswith("1 row in ") and last.endswith(f"; {tmp_path / 'results.md'} defines the columns")
    assert [line[:10] for line in table] == ["Driven wit", "", "| driver |", "|---|---|-", "| straight", ""]
    assert "\nSuccess: the rover came within" in (tmp_path / "results.md").read_text()
    assert without_times(json.loads((tmp_path / "results.json").read_text())) == without_times(finished[1])


def test_an_exception_of_a_users_driver_in_a_worker_shows_its_traceback(tmp_path, monkeypatch):
    """Python prints what ends a command."""
    (tmp_path / "broken.py").write_text(
        "class Driver:\n    def reset(self, env, seed): ...\n    def act(self, env, observation):\n"
        "        return self.steer_by_feel()\n    def steer_by_feel(self):\n        raise ValueError('no feeling')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)  # of the workers
    flags = [*FLAGS, "--episodes", "1", "--workers", "2", "--driver", "broken:Driver", "--out", str(tmp_path / "out")]
    with pytest.raises(UserCodeError) as error:
        main(flags)
    printed = "".join(traceback.format_exception(error.value))
    assert "in steer_by_feel" in printed
    last = printed.strip().splitlines()[-1]
    message = r"envs\.world\.user_code\.UserCodeError: step 1 of course \d, .* by broken:Driver and ground_truth: "
    assert re.match(message + "broken:Driver raised ValueError: no feeling$", last)


def test_each_drive_has_its_own_instance_of_a_users_class(tmp_path, monkeypatch):
    """So what it remembers of one drive cannot reach the next, in whatever order they are driven."""
    (tmp_path / "remembering.py").write_text(
        "import numpy as np\nfrom m3depth import Prediction\nfirst_of_each = []\n"
        "class Method:\n    last = None\n    def infer(self, left, right, rig):\n"
        "        if self.last is None:\n            first_of_each.append(self)\n        self.last = left\n"
        "        depth = np.full(left.shape[:2], 5, np.float32)\n"
        "        return Prediction(depth, rig.fb / depth, None, np.ones_like(depth))\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    flags = {**QUICK, "perception": ("remembering:Method",), "eyes": EyesConfig(image_pixels=64)}
    evaluate(EvaluateConfig(tmp_path / "out", episodes=2, seed=3, **flags))
    assert len(set(map(id, sys.modules["remembering"].first_of_each))) == 2


def test_values_that_name_one_cell_are_refused(tmp_path, capsys):
    code, message = run(capsys, "--out", tmp_path / "out", "--k", "0.1", "0.1000000000000001")
    assert code == 2
    assert message == (
        "error: --k has values that are the same in 12 digits: 0.1, 0.1000000000000001; give each once\n"
    )


def test_an_out_that_is_a_file_exits_with_one_line(tmp_path, capsys):
    (tmp_path / "notes").write_text("mine")
    code, message = run(capsys, "--out", tmp_path / "notes" / "out", *FLAGS)
    assert code == 2 and message.startswith(f"error: --out {tmp_path / 'notes' / 'out'}: ") and "[Errno" not in message
    assert message.count("\n") == 1 and (tmp_path / "notes").read_text() == "mine"


def test_two_at_once_in_one_folder_and_a_folder_of_other_results_are_refused(tmp_path, capsys):
    mine, other = tmp_path / "mine", tmp_path / "other"
    with sole_writer(mine):
        assert main(["--out", str(mine), "--driver", "straight"]) == 2
    assert "another command" in capsys.readouterr().err and not (mine / "episodes").exists()
    other.mkdir()
    (other / "results.md").write_text("of envs.rocks")
    assert main(["--out", str(other), "--driver", "straight"]) == 2
    error = capsys.readouterr().err
    assert f"--out {other}" in error and len(error.strip().splitlines()) == 1
    assert (other / "results.md").read_text() == "of envs.rocks" and not (other / "episodes").exists()


WITHOUT_PYBULLET = """
import sys
sys.modules["pybullet"] = None  # as if it were not installed
from envs.evaluate import main
a, b, *flags = sys.argv[1:]
print(main([*flags, "--out", a]))
sys.exit(main([*flags, "--out", b, "--dynamics", "physics"]))
"""


def test_without_pybullet_it_drives_by_kinematic_dynamics_and_says_so(tmp_path):
    flags = ["--driver", "straight", "--perception", "ground_truth", "--goal-distance", "4", "--k", "0.01"]
    flags += ["--no-videos", "--episodes", "1"]
    command = [sys.executable, "-c", WITHOUT_PYBULLET, str(tmp_path / "a"), str(tmp_path / "b"), *flags]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "0", done.stderr
    assert done.stderr.count("note: PyBullet is not installed here, so the dynamics are kinematic") == 1
    assert json.loads((tmp_path / "a" / SETTINGS).read_text())["dynamics"] == "kinematic"
    assert done.returncode == 2 and not (tmp_path / "b").exists()
    *_, refused = done.stderr.splitlines()
    assert refused == "error: --dynamics physics needs PyBullet, which is not installed; choose kinematic instead"


def test_only_drives_of_the_evaluation_count_as_done(tmp_path):
    config = EvaluateConfig(tmp_path, driver=("straight",), episodes=3)
    (tmp_path / "episodes").mkdir()
    for name in (config.tasks[1].file, "of-another-shard.json"):
        (tmp_path / "episodes" / name).touch()
    assert drives_done(config) == "1 of 3 drives done"
