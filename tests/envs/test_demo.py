import shutil
import sys
from dataclasses import replace

import pytest

from envs.demo import DemoConfig, _drive_in_words, demo, main
from envs.drives.episodes import EpisodeRecord
from marssim.base.results.lock import sole_writer
from marssim.scene.presets import preset


class Unused:
    def infer(self, left, right, rig):
        raise AssertionError("no image is to be predicted")


class Reached(Exception):
    """Generation was about to begin."""


@pytest.fixture(autouse=True)
def _no_network(monkeypatch):
    def stop(config):
        config.out.mkdir()
        (config.out / "generate.json").write_text("{}")
        raise Reached

    monkeypatch.setattr("envs.demo.load_estimator", lambda name: Unused())
    monkeypatch.setattr("envs.demo.generate_dataset", stop)


@pytest.mark.parametrize("file_name", ["data/generate.json", "summary.md", "demo_data/thesis.txt", "comparison.png"])
def test_files_of_others_in_the_folder_are_left_alone(tmp_path, file_name):
    """Whatever it holds: the demo's seed may be anyone's."""
    precious = tmp_path / file_name
    precious.parent.mkdir(parents=True, exist_ok=True)
    precious.write_text('{"seed": 20000}')
    with pytest.raises(
        ValueError,
        match=f"^--out {tmp_path}: the folder is not empty and holds no demo of this command; choose another$",
    ):
        demo(DemoConfig(out=tmp_path))
    assert precious.read_text() == '{"seed": 20000}' and len(list(tmp_path.iterdir())) == 1


def test_two_at_once_are_refused(tmp_path, capsys):
    with sole_writer(tmp_path):
        assert main(["--out", str(tmp_path)]) == 2
    assert "another command" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_the_data_of_an_earlier_demo_is_generated_again(tmp_path):
    for _ in range(2):
        with pytest.raises(Reached):
            demo(DemoConfig(out=tmp_path))
        data = tmp_path / "data"
        assert [file.name for file in data.iterdir()] == ["generate.json"]
        (data / "old.png").touch()


def test_a_demo_that_was_killed_while_it_deleted_starts_again(tmp_path, monkeypatch):
    with pytest.raises(Reached):
        demo(DemoConfig(out=tmp_path))
    data = tmp_path / "data"
    (data / "old.png").touch()

    def killed(folder):
        (data / "generate.json").unlink()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(shutil, "rmtree", killed)
        demo(DemoConfig(out=tmp_path))
    assert (data / "old.png").is_file()
    with pytest.raises(Reached):
        demo(DemoConfig(out=tmp_path))
    assert not (data / "old.png").exists()


def test_a_dataset_is_not_drawn_over(tmp_path, capsys):
    (tmp_path / "scenes").mkdir()
    (tmp_path / "generate.json").write_text("{}")
    sheet = tmp_path / "contact_sheet.png"
    sheet.write_bytes(b"of these pairs")
    assert main(["--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: --out {tmp_path}: is a dataset; choose another folder\n"
    assert sheet.read_bytes() == b"of these pairs" and len(list(tmp_path.iterdir())) == 3


def test_a_wrong_number_is_reported_before_anything_is_deleted(tmp_path, capsys):
    with pytest.raises(Reached):
        demo(DemoConfig(out=tmp_path))
    file_name = tmp_path / "data" / "generate.json"
    with pytest.raises(ValueError, match="pairs must"):
        demo(DemoConfig(out=tmp_path, pairs=0))
    for flag in ("--pairs", "--workers"):
        assert main(["--out", str(tmp_path), flag, "0"]) == 2
        assert capsys.readouterr().err == f"error: {flag} must be at least 1, got 0\n"
    assert main(["--out", str(tmp_path), "--goal-distance", "2"]) == 2
    assert capsys.readouterr().err == "error: --goal-distance must lie in [3, 100] m, got 2.0\n"
    assert main(["--out", str(tmp_path), "--goal-distance", "60", "--scene", "jezero"]) == 2
    assert capsys.readouterr().err == (
        "error: --goal-distance 60: the scene of such a drive may have too many rocks in --scene jezero; choose a "
        "smaller one\n"
    )
    assert file_name.is_file()


def test_without_pybullet_it_renders_by_scan_and_says_so_once(tmp_path, capsys, monkeypatch):
    configs = []

    def stop(config):
        configs.append(config)
        raise Reached

    monkeypatch.setattr("envs.demo.generate_dataset", stop)
    monkeypatch.setitem(sys.modules, "pybullet", None)  # as if it were not installed
    with pytest.raises(Reached):
        demo(DemoConfig(out=tmp_path))
    assert configs[0].renderer == "scan"
    assert capsys.readouterr().err.count("PyBullet is not installed here") == 1


def test_the_demo_drives_in_utopia_or_in_a_place_from_a_file(tmp_path, capsys, monkeypatch):
    configs = []

    def stop(config):
        configs.append(config)
        raise Reached

    monkeypatch.setattr("envs.demo.generate_dataset", stop)
    (tmp_path / "my_place.json").write_text('{"preset": "gale", "horizon": 40}')
    for out, scene in (("a", {}), ("b", {"scene": str(tmp_path / "my_place.json")})):
        with pytest.raises(Reached):
            demo(DemoConfig(out=tmp_path / out, **scene))
    assert [config.scenes[0] for config in configs] == [preset("utopia"), preset("gale", horizon=40.0)]
    assert main(["--out", str(tmp_path / "c"), "--scene", "galle"]) == 2
    assert "did you mean gale?" in capsys.readouterr().err and not (tmp_path / "c").exists()


def test_the_summary_says_what_the_drive_is_compared_with():
    record = EpisodeRecord(
        driver="navigator", perception="m3depth", cell="c", episode=0, outcome="goal", steps=40, distance=0.9,
        start_distance=14.0, shortest=14.1, path_length=15.1, min_clearance=2.88, max_tilt_deg=4.0, reward=1.0,
        step_seconds=0.1, perception_seconds=0.05, redraws=0, goal=[0.0, 0.0],
    )  # fmt: skip
    words = " ".join(_drive_in_words(record).split())
    assert "reached its goal and drove 15.1 m. At best, a drive to this goal takes about 13.1 m:" in words
    assert "clearance on the way was 2.88 m, from the rover's footprint to a true obstacle: a rock of 0.3 m" in words
    assert "more than 3 m, from" in _drive_in_words(replace(record, min_clearance=3.0))
    assert "did not reach its goal (stuck)" in _drive_in_words(replace(record, outcome="stuck"))
