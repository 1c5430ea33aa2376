import json
import multiprocessing
import shutil
import threading
import time
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from marssim import generate as command
from marssim.camera import NATECAM
from marssim.dataset import DatasetError, StereoDataset
from marssim.generate import GenerateConfig, generate, generate_scene
from marssim.render.sensor import SensorConfig
from marssim.viewpoint import ViewConfig

RIG = NATECAM.resized(48, 48)


def config(out: Path, **changes) -> GenerateConfig:
    return replace(GenerateConfig(out, pairs=4, views_per_scene=2, renderer="embree", k=0.02, seed=5), **changes)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    return generate(config(tmp_path_factory.mktemp("made") / "set"), RIG).path


@pytest.fixture
def folder(made, tmp_path) -> Path:
    """A copy that a test may break."""
    return shutil.copytree(made, tmp_path / "set")


def hashes(path: Path) -> dict[str, str]:
    return {s["name"]: s["sha256"] for s in StereoDataset(path).index["samples"]}


def contents(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def run(capfd, *args: object) -> tuple[int, str]:
    """Exit code and standard error of the command."""
    return command.main([str(a) for a in args]), capfd.readouterr().err.strip()


def test_what_is_written(made):
    dataset = StereoDataset(made)
    assert dataset.names == ["00000/00", "00000/01", "00001/00", "00001/01"]
    assert {s.meta["scene"] for s in dataset} == {0, 1} and {s.meta["seed"] for s in dataset} == {5}
    sample = dataset[0]
    assert sample.rig == RIG and sample.left.shape == (48, 48, 3)
    for field in ("preset", "scene_config", "sun", "sun_elevation_deg", "optical_depth", "sensor", "pose", "renderer"):
        assert field in sample.meta
    assert sample.meta["scene_config"]["rocks"]["k"] == 0.02
    sheet = cv2.imread(str(made / "contact_sheet.png"))
    assert sheet is not None and sheet.std() > 10
    readme = (made / "README.md").read_text()
    assert dataset.digest in readme and "4 stereo pairs" in readme and "contact_sheet.png" in readme
    assert not list(made.rglob("*partial*"))


def test_views_differ_and_scenes_differ(made):
    dataset = StereoDataset(made)
    assert len(set(hashes(made).values())) == 4
    poses = [tuple(np.ravel(s.meta["pose"])) for s in dataset]
    assert len(set(poses)) == 4
    suns = [tuple(s.meta["sun"]) for s in dataset]
    assert suns[0] == suns[1] and suns[2] == suns[3] and suns[0] != suns[2]


def test_the_bytes_do_not_depend_on_the_number_of_workers(made, tmp_path):
    generate(config(tmp_path / "set", workers=2), RIG)
    assert contents(tmp_path / "set") == contents(made)


def test_a_stopped_run_goes_on_to_the_same_bytes(made, folder):
    """Whatever is missing or half written: a sample, one of its files, the index."""
    shutil.rmtree(folder / "scenes" / "00000" / "01")
    (folder / "scenes" / "00001" / "00" / "depth.png").unlink()
    (folder / "scenes" / "00001" / "01" / "left.png").write_bytes(b"")
    partial = folder / "scenes" / "00000" / ".01.partial"
    partial.mkdir()
    (partial / "left.png").write_bytes(b"half")
    for name in ("dataset.json", "README.md", "contact_sheet.png"):
        (folder / name).unlink()
    untouched = folder / "scenes" / "00000" / "00" / "left.png"
    before = untouched.stat().st_mtime_ns
    generate(config(folder), RIG)
    assert contents(folder) == contents(made)
    assert untouched.stat().st_mtime_ns == before  # what is there is not made again


def test_more_pairs_later_keep_the_earlier_ones(made, folder):
    bigger = generate(config(folder, pairs=5), RIG)
    assert len(bigger) == 5
    assert {name: h for name, h in hashes(folder).items() if name in hashes(made)} == hashes(made)


def test_an_odd_number_of_pairs_leaves_the_last_scene_short(made, folder):
    dataset = generate(config(folder, pairs=3), RIG)
    assert dataset.names == ["00000/00", "00000/01", "00001/00"]
    assert hashes(folder).items() <= hashes(made).items()
    assert "3 stereo pairs" in (folder / "README.md").read_text()


def test_a_view_does_not_depend_on_those_before_it(made, tmp_path):
    assert generate_scene(config(tmp_path), 1, [1], RIG) == 1
    again = tmp_path / "scenes" / "00001" / "01"
    assert contents(again) == contents(made / "scenes" / "00001" / "01")


def test_a_rasterised_view_does_not_depend_on_those_before_it(tmp_path):
    """Views 2 and 7 look at nearly the same ground, so that a shadow map of the one would serve the other."""
    pytest.importorskip("pybullet")
    rig = NATECAM.resized(96, 96)
    after, alone = (config(tmp_path / name, renderer="pybullet", seed=1) for name in ("after", "alone"))
    generate_scene(after, 0, [2, 7], rig)
    generate_scene(alone, 0, [7], rig)
    name = Path("scenes", "00000", "07")
    assert contents(after.out / name) == contents(alone.out / name) and (alone.out / name / "left.png").is_file()


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 6},
        {"k": 0.03},
        {"scene": "gale"},
        {"view": ViewConfig(pitch_deg=(10.0, 20.0))},
        {"sensor": SensorConfig(psf=(0.0, 0.0))},
        {"views_per_scene": 3},
        {"renderer": "pybullet"},
    ],
)
def test_other_settings_in_the_same_folder_are_refused(made, change):
    before = contents(made)
    with pytest.raises(DatasetError, match=r"generate\.json: .*other settings.*--out"):
        generate(config(made, **change), RIG)
    assert contents(made) == before


def test_other_cameras_in_the_same_folder_are_refused(made):
    with pytest.raises(DatasetError, match="other settings"):
        generate(config(made), NATECAM)


def test_the_command_refuses_other_settings_in_one_line(made, capfd):
    code, err = run(capfd, "--out", made, "--seed", 7)
    assert code == 2
    assert err.startswith("error: ") and "generate.json" in err and len(err.splitlines()) == 1


def test_a_foreign_folder_is_left_alone(tmp_path, capfd):
    (tmp_path / "thesis.tex").write_text("years of work")
    code, err = run(capfd, "--out", tmp_path)
    assert code == 2 and str(tmp_path) in err and "--out" in err and len(err.splitlines()) == 1
    assert contents(tmp_path) == {"thesis.tex": b"years of work"}


def test_a_file_in_the_way(tmp_path, capfd):
    file = tmp_path / "notes"
    file.write_text("mine")
    for out in (file, file / "below"):
        code, err = run(capfd, "--out", out)
        assert code == 2 and str(file) in err and len(err.splitlines()) == 1
    assert file.read_text() == "mine"


def test_a_broken_record_of_the_settings_is_named(folder, capfd):
    (folder / "generate.json").write_text("{")
    code, err = run(capfd, "--out", folder)
    assert code == 2 and "generate.json" in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("args", "named"),
    [
        (("--pairs", 0), "--pairs"),
        (("--workers", 0), "--workers"),
        (("--views-per-scene", 0), "--views-per-scene"),
        (("--seed", -1), "--seed"),
        (("--k", 0.9), "--k"),
        (("--k", "nan"), "--k"),
        (("--scene", "olympus"), "--scene"),
        (("--renderer", "blender"), "--renderer"),
        (("--pairs", "many"), "--pairs"),
        (("--view.pitch-deg", 40, 5), "--view.pitch-deg"),
        (("--view.pitch-deg", 40, 100), "--view.pitch-deg"),
        (("--view.height", -1, 1), "--view.height"),
        (("--view.roll-deg", "nan", 1), "--view.roll-deg"),
        (("--sensor.full-well", 0, 1), "full_well"),
        (("--sensor.psf", 2, 1), "psf"),
    ],
)
def test_bad_values_name_their_flag(args, named, tmp_path, capfd):
    out = tmp_path / "set"
    code, err = run(capfd, "--out", out, *args)
    assert code == 2 and named in err and err.startswith("error: ") and len(err.splitlines()) == 1
    assert not out.exists()


def test_without_a_folder_the_command_says_what_is_missing(capfd):
    code, err = run(capfd)
    assert code == 2 and "--out" in err


def kill_a_worker_at_work(out: Path) -> None:
    """Kill one of the pool's processes once files are being written: by then all of them have been started."""
    while not list(out.glob("scenes/*/*")):
        time.sleep(0.02)
    multiprocessing.active_children()[0].kill()


def test_a_killed_worker_is_one_line_and_the_run_goes_on_later(made, tmp_path, monkeypatch, capfd):
    out = tmp_path / "set"
    killer = threading.Thread(target=kill_a_worker_at_work, args=(out,), daemon=True)
    killer.start()
    with monkeypatch.context() as patch:
        patch.setattr(command, "generate", lambda asked: generate(asked, RIG))
        code, err = run(capfd, "--out", out, "--pairs", 4000, "--views-per-scene", 2, "--renderer", "embree",
                        "--k", 0.02, "--seed", 5, "--workers", 2)  # fmt: skip
    lines = [line for line in err.splitlines() if not line.startswith(("generate:", "\r"))]
    assert code == 2 and "worker" in lines[-1] and "Traceback" not in err
    generate(config(out), RIG)
    assert hashes(out) == hashes(made)
    assert all(contents(out)[name] == data for name, data in contents(made).items() if name.startswith("scenes"))


def test_an_interrupt_says_how_to_go_on(tmp_path, monkeypatch, capfd):
    def interrupted(_: GenerateConfig) -> StereoDataset:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "generate", interrupted)
    code, err = run(capfd, "--out", tmp_path / "set")
    assert code == 130 and "goes on" in err and len(err.splitlines()) == 1


def test_broken_pools_reach_the_caller_of_the_function(tmp_path, monkeypatch):
    def broken(*_: object) -> None:
        raise BrokenExecutor

    monkeypatch.setattr(command, "_run_pool", broken)
    with pytest.raises(BrokenExecutor):
        generate(config(tmp_path / "set", workers=2), RIG)
    assert json.loads((tmp_path / "set" / "generate.json").read_text())["seed"] == 5


def test_mixed_draws_the_place_of_each_scene(tmp_path):
    dataset = generate(config(tmp_path / "set", scene="mixed", pairs=2, views_per_scene=1), RIG)
    assert len({s.meta["preset"] for s in dataset}) > 1
