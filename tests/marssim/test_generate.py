import json
import multiprocessing
import os
import shlex
import shutil
import sys
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from marssim import generate as command
from marssim.base.camera import NATECAM
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.results import lock
from marssim.base.version import VERSION
from marssim.engines.egl import Egl, probe
from marssim.generate import GenerateConfig, generate_dataset, generate_scene
from marssim.generation import scene_views
from marssim.render.sensor import SensorConfig
from marssim.scene.presets import PRESETS, preset
from marssim.scene.relief import ReliefConfig
from marssim.scene.scene import SceneConfig
from marssim.scene.trajectory import TrajectoryConfig
from marssim.scene.viewpoint import ViewConfig

RIG = NATECAM.resized(48, 48)


FLAGS = ("--pairs", 4, "--views-per-scene", 2, "--renderer", "embree", "--seed", 5, "--rocks.k", 0.02)
FLAGS += ("--rig.width", 48, "--rig.height", 48, "--rig.focal", RIG.camera.fx, "--size", 12, "--horizon", 16)


def place(name: str = "utopia", k: float = 0.02) -> tuple[SceneConfig, ...]:
    """Return a small place, which is cheap to build and to render."""
    return (preset(name, size=12.0, horizon=16.0, rocks=replace(preset(name).rocks, k=k)),)


def config(out: Path, **changes) -> GenerateConfig:
    asked = GenerateConfig(out=out, pairs=4, views_per_scene=2, renderer="embree", seed=5, rig=RIG, scenes=place())
    return replace(asked, **changes)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    return generate_dataset(config(tmp_path_factory.mktemp("made") / "set")).path


@pytest.fixture
def folder(made, tmp_path) -> Path:
    """A copy of the dataset that a test may break."""
    return shutil.copytree(made, tmp_path / "set")


def test_files_of_a_pair_are_small_where_they_compress_least(tmp_path):
    """Uncompressed they would have 17 bytes a pixel. Of 512 x 512 px, gravel has 10.3, jezero 9.7 and utopia 8.2."""
    rig = NATECAM.cropped(128, 192, 256, 256)
    scene = preset("gravel", size=8.0, horizon=16.0)
    made = generate_dataset(config(tmp_path / "set", pairs=1, rig=rig, scenes=(scene,))).path
    size = sum(file.stat().st_size for file in made.glob("scenes/00000/00/*.png"))
    assert size / 256**2 < 11.5


def claimed(config: GenerateConfig) -> GenerateConfig:
    """Prepare the folder as generate does before it starts the workers."""
    with command._folder(config).claim(command=""):
        pass
    return config


def hashes(path: Path) -> dict[str, str]:
    return {s["name"]: s["sha256"] for s in StereoDataset(path).index["samples"]}


def contents(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def run(capfd, *args: object) -> tuple[int, str]:
    """Return the exit code and the standard error of the command."""
    return command.main([str(a) for a in args]), capfd.readouterr().err.strip()


def test_a_dataset_has_its_samples_settings_sheet_and_readme(made):
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
    assert f"rendered by mars-m3depth {VERSION}, not taken on Mars" in readme
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
    generate_dataset(config(tmp_path / "set", workers=2))
    assert contents(tmp_path / "set") == contents(made)


def test_a_stopped_run_goes_on_to_the_same_bytes(made, folder):
    """A sample, one of its files, or the index may be missing or half written."""
    shutil.rmtree(folder / "scenes" / "00000" / "01")
    (folder / "scenes" / "00001" / "00" / "depth.png").unlink()
    (folder / "scenes" / "00001" / "01" / "left.png").write_bytes(b"")
    partial = folder / "scenes" / "00000" / ".01.0123.partial"
    partial.mkdir()
    (partial / "left.png").write_bytes(b"half")
    for name in ("dataset.json", "README.md", "contact_sheet.png"):
        (folder / name).unlink()
    untouched = folder / "scenes" / "00000" / "00" / "left.png"
    before = untouched.stat().st_mtime_ns
    generate_dataset(config(folder))
    assert contents(folder) == contents(made)
    assert untouched.stat().st_mtime_ns == before  # what is there is not made again


def test_more_pairs_later_keep_the_earlier_ones(made, folder):
    bigger = generate_dataset(config(folder, pairs=5))
    assert len(bigger) == 5
    assert {name: h for name, h in hashes(folder).items() if name in hashes(made)} == hashes(made)


def test_an_odd_number_of_pairs_leaves_the_last_scene_short(made, tmp_path):
    folder = tmp_path / "set"
    dataset = generate_dataset(config(folder, pairs=3))
    assert dataset.names == ["00000/00", "00000/01", "00001/00"]
    assert hashes(folder).items() <= hashes(made).items()
    assert "3 stereo pairs" in (folder / "README.md").read_text()


def test_a_view_does_not_depend_on_those_before_it(made, tmp_path):
    assert generate_scene(claimed(config(tmp_path)), 1, [1]) == 1
    again = tmp_path / "scenes" / "00001" / "01"
    assert contents(again) == contents(made / "scenes" / "00001" / "01")


def test_a_rasterised_view_does_not_depend_on_those_before_it(tmp_path):
    """Views 2 and 7 show nearly the same ground, so that state of one view could affect the other."""
    pytest.importorskip("pybullet")
    rig = NATECAM.resized(96, 96)
    large = (preset("utopia", rocks=replace(preset("utopia").rocks, k=0.02)),)
    after, alone = (
        claimed(config(tmp_path / name, renderer="pybullet", seed=1, rig=rig, scenes=large))
        for name in ("after", "alone")
    )
    generate_scene(after, 0, [2, 7])
    generate_scene(alone, 0, [7])
    name = Path("scenes", "00000", "07")
    assert contents(after.out / name) == contents(alone.out / name) and (alone.out / name / "left.png").is_file()


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 6},
        {"scenes": place(k=0.03)},
        {"scenes": place("gale")},
        {"rig": NATECAM},
        {"trajectory": True},
        {"view": ViewConfig(pitch_deg=(10.0, 20.0))},
        {"sensor": SensorConfig(psf=(0.0, 0.0))},
        {"views_per_scene": 3},
        {"renderer": "pybullet"},
    ],
)
def test_other_settings_in_the_same_folder_are_refused(made, change):
    before = contents(made)
    name = next(iter(change))
    with pytest.raises(DatasetError, match=rf"generate\.json: .*other settings \(.*\b{name}\b.*, not .*\);.*--out"):
        generate_dataset(config(made, **change))
    assert contents(made) == before


def test_fewer_pairs_than_are_there_are_refused(made):
    before = contents(made)
    with pytest.raises(DatasetError, match=r"^--pairs 3: .* holds 1 pair more than that"):
        generate_dataset(config(made, pairs=3))
    assert contents(made) == before


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize(
    ("file", "cut", "end", "problem"),
    [("left.png", 100, b"", "truncated"), ("surface.png", None, b"x", "its content is not what sample.json records"),
     ("sample.json", 100, b"", "is not JSON")],
)  # fmt: skip
def test_a_corrupted_sample_is_named_and_rendered_again_without_its_folder(
    folder, made, finished, file, cut, end, problem
):
    image = folder / "scenes/00000/00" / file
    image.write_bytes(image.read_bytes()[:cut] + end)
    if not finished:
        (folder / "dataset.json").unlink()
    with pytest.raises(DatasetError, match=rf"00/{file}: {problem}.*; delete the folder of this sample"):
        generate_dataset(config(folder))
    shutil.rmtree(image.parent)
    generate_dataset(config(folder))
    assert contents(folder) == contents(made)


def test_a_sample_json_that_was_altered_after_the_index_is_named(made, folder):
    """Its images fit the hashes in it, so that only the index tells."""
    file = folder / "scenes/00000/00/sample.json"
    meta = json.loads(file.read_text())
    meta["pose"][0][3] += 5
    file.write_text(json.dumps(meta))
    with pytest.raises(DatasetError, match=r"00/sample\.json: its content is not what dataset\.json records; delete"):
        generate_dataset(config(folder))
    assert hashes(folder) == hashes(made)
    shutil.rmtree(file.parent)
    generate_dataset(config(folder))
    assert contents(folder) == contents(made)


def test_a_broken_index_is_named_and_written_again_once_it_is_deleted(made, folder):
    (folder / "dataset.json").write_text("{")
    with pytest.raises(DatasetError, match=r"dataset\.json: is not JSON.*; delete this file, and the same command"):
        generate_dataset(config(folder))
    (folder / "dataset.json").unlink()
    generate_dataset(config(folder))
    assert contents(folder) == contents(made)


def test_a_half_written_calibration_file_of_a_killed_run_is_deleted(tmp_path):
    half = tmp_path / "set" / "calibration" / ".opencv.yml.123.part"
    claimed(config(tmp_path / "set"))
    half.parent.mkdir()
    half.write_text("K1: ")
    claimed(config(tmp_path / "set"))
    assert half.parent.is_dir() and not half.exists()


def test_the_command_refuses_other_settings_in_one_line(made, capfd):
    code, err = run(capfd, "--out", made, "--seed", 7)
    assert code == 2
    assert err.startswith("error: ") and "generate.json" in err and len(err.splitlines()) == 1


def test_settings_without_samples_are_replaced(made, tmp_path, capfd, monkeypatch):
    """A user may learn of the other renderer from the message, and choose it with the same folder."""
    out = tmp_path / "set"
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pybullet", None)
        patch.delitem(sys.modules, "marssim.render.renderers.pybullet_renderer", raising=False)
        code, err = run(capfd, "--out", out, *FLAGS, "--renderer", "pybullet")
    assert code == 2 and "embree" in err and list(contents(out)) == ["generate.json"]
    (out / "scenes" / "00000" / ".00.0123.partial").mkdir(parents=True)
    (out / "scenes" / "00000" / ".00.0123.partial" / "left.png").write_bytes(b"half")
    assert run(capfd, "--out", out, *FLAGS)[0] == 0
    assert contents(out) == contents(made)


def test_settings_are_not_replaced_where_the_samples_lie_behind_a_link(made, folder, tmp_path, capfd):
    """Of a run that was stopped before it wrote the index."""
    for file in folder.iterdir():
        if file.is_file() and file.name != "generate.json":
            file.unlink()
    (folder / "scenes").rename(tmp_path / "elsewhere")
    (folder / "scenes").symlink_to(tmp_path / "elsewhere")
    code, message = run(capfd, "--out", folder, *FLAGS, "--seed", 6)
    assert code == 2 and f"{folder / 'generate.json'}: the dataset in this folder has other settings" in message


def test_settings_beside_other_files_are_not_replaced(tmp_path):
    claimed(config(tmp_path / "set"))
    (tmp_path / "set" / "notes.txt").write_text("mine")
    before = contents(tmp_path / "set")
    with pytest.raises(DatasetError, match="other settings"):
        generate_dataset(config(tmp_path / "set", seed=6))
    assert contents(tmp_path / "set") == before


def test_no_file_depends_on_the_folders_of_data_and_heightmap(tmp_path):
    """Two folders stand for two machines."""
    written = []
    for name in ("one", "two"):
        file = tmp_path / name / "map.npy"
        file.parent.mkdir()
        np.save(file, np.zeros((40, 40)))
        scene = preset("utopia", size=12.0, horizon=16.0, relief=ReliefConfig(heightmap=str(file), heightmap_scale=1.0))
        generate_dataset(config(tmp_path / name / f"set of {name}", scenes=(scene,), pairs=1))
        written.append(contents(tmp_path / name / f"set of {name}"))
    assert written[0] == written[1]
    assert not [name for name, data in written[0].items() if bytes(tmp_path) in data]
    assert "--relief.heightmap map.npy" in written[0]["README.md"].decode()


def test_a_heightmap_is_found_from_any_folder_and_may_be_moved(tmp_path, monkeypatch):
    """Workers may run in other folders; the dataset records the map's name, not its path."""
    maps = [tmp_path / "here" / "map.npy", tmp_path / "there" / "map.npy"]
    for file in maps:
        file.parent.mkdir()
        np.save(file, np.random.default_rng(0).normal(0, 0.05, (220, 220)))

    def asked(heightmap: str, pairs: int) -> GenerateConfig:
        relief = ReliefConfig(heightmap=heightmap, heightmap_scale=1.0)
        return config(tmp_path / "set", scenes=(replace(place()[0], relief=relief),), pairs=pairs, views_per_scene=1)

    def elsewhere(function, tasks, *more, whole=command.run_tasks):
        monkeypatch.chdir(tmp_path / "there")
        whole(function, tasks, *more)

    monkeypatch.chdir(tmp_path / "here")
    with monkeypatch.context() as patch:
        patch.setattr(command, "run_tasks", elsewhere)
        first = generate_dataset(asked("map.npy", 1))[0].meta["scene_config"]["relief"]
    assert first["heightmap"] == "map.npy"
    maps[0].unlink()
    both = [s.meta["scene_config"]["relief"] for s in generate_dataset(asked(str(maps[1]), 2))]
    assert both == [first, first]
    with pytest.raises(DatasetError, match="other settings"):  # the name is in every sample
        generate_dataset(asked(str(maps[1].rename(tmp_path / "other.npy")), 3))
    np.save(maps[1], np.zeros((220, 220)))
    with pytest.raises(DatasetError, match="other settings"):
        generate_dataset(asked(str(maps[1]), 3))


def test_a_folder_of_other_files_is_left_alone(tmp_path, capfd):
    (tmp_path / "thesis.tex").write_text("years of work")
    code, err = run(capfd, "--out", tmp_path)
    assert code == 2 and str(tmp_path) in err and "--out" in err and len(err.splitlines()) == 1
    assert contents(tmp_path) == {"thesis.tex": b"years of work"}


def test_a_file_in_place_of_the_folder_is_one_line(tmp_path, capfd):
    file = tmp_path / "notes"
    file.write_text("mine")
    for out in (file, file / "below"):
        code, err = run(capfd, "--out", out)
        assert code == 2 and err.startswith(f"error: --out {out}: ") and len(err.splitlines()) == 1
    assert file.read_text() == "mine"


def test_a_broken_record_of_the_settings_is_named(folder, capfd):
    (folder / "generate.json").write_text("{")
    code, err = run(capfd, "--out", folder)
    assert code == 2 and "generate.json" in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--rocks.k", 0.3, "--size", 60, "--horizon", 96), "--rocks.k or --size"),
        (("--rocks.k", 0.4, "--rocks.min-diameter", 0.25, "--rocks.cluster", 0, "--size", 2), "--rocks.k"),
        (("--trajectory", "--size", 3, "--views-per-scene", 20), "--drive.step"),
    ],
)
def test_impossible_scenes_are_refused_before_anything_is_written(flags, message, tmp_path, capfd):
    """More rocks than a dataset can number, no place for a camera, a drive longer than the scene."""
    code, err = run(capfd, "--out", tmp_path / "set", *FLAGS, *flags)
    assert code == 2 and message in err and len(err.splitlines()) == 1
    assert not (tmp_path / "set").exists()


@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_a_second_command_in_the_folder_is_refused_and_harms_nothing(made, folder, tmp_path, capfd):
    """Also if the first has not yet written anything, or has other settings."""
    before = contents(folder)
    (tmp_path / "new").mkdir()
    for out, flags in ((folder, FLAGS), (tmp_path / "new", FLAGS), (folder, (*FLAGS, "--pairs", 5))):
        with lock.sole_writer(out):
            code, err = run(capfd, "--out", out, *flags)
        assert code == 2 and len(err.splitlines()) == 1
        assert err.startswith(f"error: {out}: another command (process {os.getpid()} ")
    assert contents(folder) == before and contents(tmp_path / "new") == {}
    assert run(capfd, "--out", tmp_path / "new", *FLAGS)[0] == 0
    assert hashes(tmp_path / "new") == hashes(made)


@pytest.mark.parametrize("written", ["0.0.9", None])
def test_data_of_another_version_are_not_added_to(folder, written, capfd):
    """Another version may draw other scenes from the same settings."""
    settings = json.loads((folder / "generate.json").read_text())
    settings.pop("marssim")
    (folder / "generate.json").write_text(json.dumps({**settings, **({"marssim": written} if written else {})}))
    before = contents(folder)
    code, err = run(capfd, "--out", folder, *FLAGS)
    assert code == 2 and len(err.splitlines()) == 1 and f"(marssim {written or 'none'}, not " in err
    assert contents(folder) == before


def test_a_sample_that_was_killed_before_it_got_its_name_is_drawn_again(made, folder, capfd):
    """Its files are written, but its folder does not have its final name yet."""
    (folder / "scenes" / "00001" / "01").rename(folder / "scenes" / "00001" / ".01.0123.partial")
    (folder / "dataset.json").unlink()
    assert run(capfd, "--out", folder, *FLAGS)[0] == 0
    assert contents(folder) == contents(made)


def test_the_folder_records_the_command_that_completes_it(made, folder, monkeypatch, capfd):
    """The message on an unfinished dataset has a command line, and that command line works."""
    (folder / "dataset.json").unlink()
    shutil.rmtree(folder / "scenes" / "00001" / "00")
    with pytest.raises(DatasetError, match=r"not finished, it has 3 pairs; .* completes it$") as error:
        StereoDataset(folder)
    words = shlex.split(str(error.value).split("; ")[1].removesuffix(" completes it"))
    assert words[:3] == ["python", "-m", "marssim.generate"]
    assert run(capfd, *words[3:])[0] == 0
    assert contents(folder) == contents(made)


@pytest.mark.parametrize(
    ("args", "named"),
    [
        (("--pairs", 0), "--pairs"),
        (("--workers", 0), "--workers"),
        (("--views-per-scene", 0), "--views-per-scene"),
        (("--seed", -1), "--seed"),
        (("--rocks.k", 0.9), "--rocks.k must"),
        (("--rocks.k", "nan"), "--rocks.k must"),
        (("--scene", "mixed", "--relief.hurst", 1.2), "--relief.hurst must"),
        (("--horizon", 5), "less than twice --horizon, 5 m; got 32.0"),
        (("--horizon", 5), "--size must"),
        (("--size", 100, "--cell", 0.01), "--size must be at most 5000 times --cell, 0.01 m"),
        (("--look.sun-elevation-deg", 0, 10), "--look.sun-elevation-deg must"),
        (("--rig.focal", -1), "--rig.focal must"),
        (("--rig.width", 0), "--rig.width must"),
        (("--rig.focal", 0.0212), "--rig.focal, or fx and fy of a rig file, must"),  # in metres
        (("--rig.focal-y", 0.5), "--rig.focal, or fx and fy of a rig file, must"),
        (("--rig.width", 10**5), "--rig.width must"),
        (("--rig.cx", "1e300"), "--rig.cx must"),
        (("--trajectory", "--drive.speed", "1e300"), "--drive.speed must"),
        (("--trajectory", "--views-per-scene", "1000000"), "--views-per-scene must be at most 10000 in a drive"),
        (("--rig.width", 65536, "--rig.height", 65536), "--rig.width times --rig.height"),
        (
            ("--relief.heightmap-at", 5, 5),
            "--relief.heightmap-at describes a heightmap, so it needs --relief.heightmap",
        ),
        (("--relief.heightmap-scale", 1), "--relief.heightmap-scale describes a heightmap"),
        (("--relief.heightmap-height", 1), "--relief.heightmap-height describes a heightmap"),
        (("--drive.step", 0), "--drive.step must"),
        (("--rig-file", "/no/rig.json"), "/no/rig.json: no such file"),
        (("--scene", "olympus"), "--scene"),
        (("--renderer", "blender"), "--renderer"),
        (("--pairs", "many"), "--pairs"),
        (("--view.pitch-deg", 40, 5), "--view.pitch-deg"),
        (("--view.pitch-deg", 40, 100), "--view.pitch-deg"),
        (("--view.height", -1, 1), "--view.height"),
        (("--view.roll-deg", "nan", 1), "--view.roll-deg"),
        (("--sensor.full-well", 0, 1), "--sensor.full-well must"),
        (("--sensor.psf", 2, 1), "--sensor.psf must"),
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


def test_a_killed_worker_is_one_line_and_the_run_goes_on_later(made, tmp_path, capfd, monkeypatch):
    """One of the workers is killed when the first scene is done, with nearly all scenes left."""
    out, others, killed = tmp_path / "set", set(multiprocessing.active_children()), []

    def kill_one(*_: object) -> None:
        if not killed:
            killed.append((set(multiprocessing.active_children()) - others).pop())
            killed[0].kill()

    def run_with_a_kill(function, tasks, done, *more, whole=command.run_tasks):
        whole(function, tasks, kill_one, *more)

    with monkeypatch.context() as patch:
        patch.setattr(command, "run_tasks", run_with_a_kill)
        code, err = run(capfd, "--out", out, *FLAGS, "--pairs", 40, "--workers", 2)
    lines = [line for line in err.splitlines() if not line.startswith(("generate:", "\r"))]
    assert code == 2 and "worker process was killed" in lines[-1] and "Traceback" not in err
    assert len(list(out.glob("scenes/*/00"))) < 10
    generate_dataset(config(out))
    assert hashes(out) == hashes(made)
    assert all(contents(out)[name] == data for name, data in contents(made).items() if name.startswith("scenes"))


def test_an_interrupt_says_how_to_go_on(tmp_path, monkeypatch, capfd):
    def interrupted(_: GenerateConfig) -> StereoDataset:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "generate_dataset", interrupted)
    code, err = run(capfd, "--out", tmp_path / "set")
    assert code == 130 and "goes on" in err and len(err.splitlines()) == 1


def test_broken_pools_reach_the_caller_of_the_function(tmp_path, monkeypatch):
    def broken(*_: object) -> None:
        raise BrokenExecutor

    monkeypatch.setattr(command, "run_tasks", broken)
    with pytest.raises(BrokenExecutor):
        generate_dataset(config(tmp_path / "set", workers=2))
    assert json.loads((tmp_path / "set" / "generate.json").read_text())["seed"] == 5


def test_mixed_takes_the_places_in_turn(tmp_path):
    small = tuple(place(name)[0] for name in PRESETS)
    asked = config(tmp_path / "set", scenes=small, pairs=len(small), views_per_scene=1)
    made = [s.meta["preset"] for s in generate_dataset(asked)]
    assert sorted(made) == sorted(PRESETS)
    assert made == [asked.scene_config(scene).preset for scene in range(len(small))]


def test_the_command_writes_what_the_function_writes(made, tmp_path, capfd):
    assert command.main([str(a) for a in ("--out", tmp_path / "set", *FLAGS)]) == 0
    assert hashes(tmp_path / "set") == hashes(made)
    out = capfd.readouterr().out
    splits = ", ".join(f"{split} {len(StereoDataset(made, split))}" for split in ("train", "val", "test"))
    assert f"4 pairs in {tmp_path / 'set'} ({splits}), digest {StereoDataset(made).digest[:16]}, see" in out


def test_the_bytes_do_not_depend_on_dask(made, tmp_path):
    """Two workers of two threads each, all in this process."""
    distributed = pytest.importorskip("distributed")
    options = {"processes": False, "dashboard_address": ":0", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, **options) as cluster:
        generate_dataset(config(tmp_path / "set", scheduler=cluster.scheduler_address))
    assert contents(tmp_path / "set") == contents(made)


def test_a_worker_that_cannot_see_the_folder_is_reported(tmp_path):
    with pytest.raises(DatasetError, match="folder that all workers share"):
        generate_scene(config(tmp_path / "elsewhere"), 0, [0])
    assert not (tmp_path / "elsewhere").exists()


def test_a_worker_writes_nothing_more_once_the_folder_is_of_another_dataset(tmp_path, monkeypatch):
    """A worker of a cluster finishes its scene after the command that sent it was interrupted."""
    first = claimed(config(tmp_path / "set"))
    write = scene_views.write_sample

    def written(*given, **named):
        write(*given, **named)
        shutil.rmtree(tmp_path / "set")
        claimed(config(tmp_path / "set", seed=6))

    monkeypatch.setattr(scene_views, "write_sample", written)
    with pytest.raises(DatasetError, match=r"generate\.json: another dataset has taken this folder; this worker stops"):
        generate_scene(first, 0, [0, 1])
    assert [path.name for path in (tmp_path / "set").iterdir()] == ["generate.json"]


def test_a_worker_with_another_marssim_writes_nothing(tmp_path):
    whole = claimed(config(tmp_path / "set"))
    (_, scene, views, sources), *_ = command._shared_out(replace(whole, scheduler="tcp://a:1"), [range(1)])
    assert generate_scene(whole, scene, views, sources) == 1
    with pytest.raises(DatasetError, match=r"the worker on .* has other source files of marssim than this command"):
        generate_scene(whole, 0, [1], "0123456789ab")
    assert [path.name for path in (tmp_path / "set" / "scenes" / "00000").iterdir()] == ["00"]


def test_pairs_of_other_source_files_are_a_warning(tmp_path, capfd, monkeypatch):
    generate_dataset(config(tmp_path / "set", pairs=1))
    mark = tmp_path / "set" / "generate.json"
    (now,) = read_json(mark)["sources"]
    monkeypatch.setattr(command, "source_digest", lambda packages: "0123456789ab")
    generate_dataset(config(tmp_path / "set", pairs=1))  # renders nothing
    assert read_json(mark)["sources"] == [now] and "warning" not in capfd.readouterr().err
    generate_dataset(config(tmp_path / "set", pairs=2))
    warning = next(line for line in capfd.readouterr().err.splitlines() if line.startswith("warning: "))
    assert warning.startswith(
        f"warning: {tmp_path / 'set'}: 1 pair in it came from another version of marssim's source"
    )
    assert read_json(mark)["sources"] == [now, "0123456789ab"]
    monkeypatch.undo()
    generate_dataset(config(tmp_path / "set", pairs=3))  # by the first ones again
    assert "2 pairs in it came from another version" in capfd.readouterr().err


@pytest.mark.parametrize("recorded", [None, "x", [3, None]])
def test_a_dataset_without_a_record_of_its_source_files_can_be_completed(tmp_path, capfd, recorded):
    generate_dataset(config(tmp_path / "set", pairs=1))
    mark = tmp_path / "set" / "generate.json"
    write_json(mark, {**read_json(mark), "sources": recorded})
    generate_dataset(config(tmp_path / "set", pairs=2))
    assert read_json(mark)["sources"][0] == "unknown" and len(read_json(mark)["sources"]) == 2
    assert "warning" not in capfd.readouterr().err


def test_one_pair_is_counted_in_the_singular(tmp_path, capfd):
    assert command.main([str(a) for a in ("--out", tmp_path / "set", *FLAGS, "--pairs", 1)]) == 0
    assert capfd.readouterr().out.startswith("1 pair in ")
    assert "1 stereo pair (" in (tmp_path / "set" / "README.md").read_text()


def test_the_drive_that_is_tried_before_the_folder_is_claimed_is_the_one_that_is_rendered(tmp_path, monkeypatch):
    """For every place of a mixture, the first scene that is drawn from it; and the cameras of its single views."""
    drawn: list[Any] = []

    def kept(function):
        def keep(*args):
            drawn.append(function(*args))
            return drawn[-1]

        return keep

    scenes = tuple(preset(name, size=12.0, horizon=16.0) for name in ("gale", "utopia"))
    for name in ("draw_trajectory", "draw_pose"):
        monkeypatch.setattr(scene_views, name, kept(getattr(scene_views, name)))
    for trajectory in (True, False):
        asked = config(tmp_path / f"{trajectory}", trajectory=trajectory, renderer="scan", scenes=scenes)
        drawn.clear()
        command._check(asked)
        poses = [drive[0] for drive in drawn] if trajectory else drawn
        tried = {np.reshape(of_views, (-1, 4, 4))[0].tobytes() for of_views in poses}
        whole = generate_dataset(asked)
        assert {np.array(whole[i].meta["pose"]).tobytes() for i in (0, 2)} == tried and len(tried) == 2


def test_a_drive_is_one_way_with_its_poses_beside_it(tmp_path):
    drive = TrajectoryConfig(step=0.25, speed=0.05)
    whole = generate_dataset(config(tmp_path / "set", trajectory=True, drive=drive, views_per_scene=3))
    assert {s["name"]: s["split"] for s in whole.index["samples"]} == {
        "00000/00": "train", "00000/01": "train", "00000/02": "train", "00001/00": "test",
    }  # fmt: skip
    drove = [s.meta for s in whole][:3]
    assert drove[0]["sensor"] == drove[2]["sensor"] and drove[0]["sun"] == drove[2]["sun"]
    mounts = {str(m["camera_to_rover"]) for m in drove}  # one place on the rover, whose pose is the camera's by it
    assert len(mounts) == 1 and "rover" not in drove[0]
    lines = (tmp_path / "set" / "scenes" / "00000" / "trajectory.txt").read_text().splitlines()
    table = np.array([line.split() for line in lines if not line.startswith("#")], dtype=float)
    assert np.allclose(table[:, 0], [0, 5, 10])
    assert np.allclose(table[:, 1:4], [np.array(m["pose"])[:3, 3] for m in drove], atol=1e-8)
    assert np.all(np.abs(np.linalg.norm(np.diff(table[:, 1:3], axis=0), axis=1) - 0.25) < 0.15)
    assert "trajectory.txt" in (tmp_path / "set" / "README.md").read_text()
    before = contents(tmp_path / "set")
    shutil.rmtree(tmp_path / "set" / "scenes" / "00000" / "01")
    (tmp_path / "set" / "scenes" / "00000" / "trajectory.txt").unlink()
    generate_dataset(config(tmp_path / "set", trajectory=True, drive=drive, views_per_scene=3))
    assert contents(tmp_path / "set") == before


@pytest.mark.parametrize(("pairs", "workers", "shares"), [(40, 1, 5), (40, 2, 6), (33, 2, 5), (8, 4, 4), (3, 4, 3)])
def test_workers_get_equal_shares(tmp_path, pairs, workers, shares):
    asked = config(tmp_path / "set", pairs=pairs, views_per_scene=8, workers=workers)
    tasks = command._shared_out(asked, command._scenes(asked))
    assert len(tasks) == shares
    assert sorted((scene, view) for _, scene, views, _ in tasks for view in views) == [
        divmod(n, 8) for n in range(pairs)
    ]


def test_a_drive_is_rendered_by_one_worker(tmp_path):
    asked = config(tmp_path / "set", pairs=8, views_per_scene=8, workers=2, trajectory=True)
    assert [views for _, _, views, _ in command._shared_out(asked, command._scenes(asked))] == [list(range(8))]


@pytest.fixture
def bullet(monkeypatch):
    """Return a function that sets the result of the test of EGL: bullet(works, hardware)."""
    pytest.importorskip("pybullet")

    def pretend(works: bool, hardware: bool) -> None:
        state = Egl(works, hardware, "the test ended with -11")
        monkeypatch.setattr(command, "probe", lambda: state)
        monkeypatch.setattr(command, "draws_on_a_card", lambda: hardware)

    return pretend


@pytest.mark.parametrize(("works", "hardware", "drawn_by"), [(0, 0, "tiny"), (1, 0, "tiny"), (1, 1, "egl")])
def test_a_dataset_is_begun_with_egl_where_it_draws_on_a_card(tmp_path, bullet, works, hardware, drawn_by):
    bullet(works, hardware)
    assert command._with_rasterizer(config(tmp_path, renderer="pybullet")).rasterizer == drawn_by
    assert command._with_rasterizer(config(tmp_path, renderer="embree")).rasterizer == "auto"


@pytest.mark.parametrize("first", ["tiny", "egl"])
def test_a_dataset_is_continued_as_it_was_begun(tmp_path, bullet, first):
    """On another machine too, or the command refuses: the two rasterizers differ in a few pixels."""
    asked = config(tmp_path / "set", renderer="pybullet", rasterizer=first)
    claimed(asked)
    sample = tmp_path / "set" / "scenes" / "00000" / "00" / "left.png"
    sample.parent.mkdir(parents=True)
    sample.touch()
    for hardware in (True, False):
        bullet(True, hardware)
        again = command._with_rasterizer(replace(asked, rasterizer="auto"))
        assert again.rasterizer == first and command._folder(again).check() is not None
    other = replace(asked, rasterizer="tiny" if first == "egl" else "egl")
    with pytest.raises(DatasetError, match="other settings"):
        generate_dataset(other)
    bullet(False, False)
    if first == "egl":
        with pytest.raises(ValueError, match=r"generate\.json: the dataset was begun with EGL, which does not work"):
            generate_dataset(replace(asked, rasterizer="auto"))
    else:
        assert command._with_rasterizer(replace(asked, rasterizer="auto")).rasterizer == first


def test_egl_that_is_asked_for_and_does_not_work_is_one_line(tmp_path, bullet, capfd):
    bullet(False, False)
    flags = [*FLAGS, "--renderer", "pybullet", "--rasterizer", "egl"]
    code, err = run(capfd, "--out", tmp_path / "set", *flags)
    assert code == 2 and err == "error: --rasterizer egl: it does not work here: the test ended with -11"
    code, err = run(capfd, "--out", tmp_path / "set", *FLAGS, "--rasterizer", "egl")
    assert code == 2 and err.startswith("error: --rasterizer egl needs --renderer pybullet, not embree")
    assert not (tmp_path / "set").exists()


def test_a_dataset_that_egl_draws_says_so_and_is_completed(tmp_path):
    pytest.importorskip("pybullet")
    if not probe().works:
        pytest.skip(f"EGL does not work here: {probe().message}")
    asked = config(tmp_path / "set", pairs=2, views_per_scene=2, renderer="pybullet", rasterizer="egl")
    dataset = generate_dataset(asked)
    assert dataset[0].meta["rasterizer"] == "egl" and dataset.index["config"]["rasterizer"] == "egl"
    shutil.rmtree(tmp_path / "set" / "scenes" / "00000" / "01")
    assert generate_dataset(replace(asked, rasterizer="auto")).digest == dataset.digest
