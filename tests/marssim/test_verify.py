import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from marssim import verify as command
from marssim.base.dataset.dataset import SPLITS, StereoDataset, write_index
from marssim.base.files.json_file import read_json, write_json
from marssim.base.results import lock
from marssim.base.results.lock import sole_writer
from marssim.export import ExportConfig, export
from marssim.inspection.agreement import Agreement
from marssim.inspection.cross_check import RendererCheck
from marssim.verify import spread


@pytest.fixture
def folder(closed_form_set, tmp_path) -> Path:
    return shutil.copytree(closed_form_set, tmp_path / "set")


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Let empty files stand for the pictures of statistics and samples."""
    for name in ("statistics_figure", "sample_figure"):
        monkeypatch.setattr(f"marssim.inspection.figures.{name}", lambda *_: b"")


def run(capfd, *args: object) -> tuple[int, str, str]:
    """Return the exit code, the standard output and the standard error of the command."""
    code = command.main([str(a) for a in args])
    captured = capfd.readouterr()
    return code, captured.out, captured.err


def mistake(capfd, *args: object) -> str:
    code, _, err = run(capfd, *args)
    assert code == 2 and len(err.splitlines()) == 1 and err.startswith("error:")
    return err.rstrip("\n")


def test_a_good_dataset(folder, tmp_path, capfd):
    code, out, _ = run(capfd, folder, "--out", tmp_path / "out")
    assert code == 0 and "all files are as the index records them" in out and "within 15 m" in out
    report = json.loads((tmp_path / "out" / "verify.json").read_text())
    assert (
        report["good"] and report["findings"] == [] and report["pairs"] == {"all": 8, "train": 4, "val": 2, "test": 2}
    )
    assert report["digest"] == StereoDataset(folder).digest
    assert {name: s["samples"] for name, s in report["statistics"].items()} == report["pairs"]
    assert "LBP" in report["definitions"]
    whole = report["statistics"]["all"]
    assert whole["sun_elevation_deg"]["least"] == 20 and whole["sun_elevation_deg"]["most"] == 50
    assert whole["within_15m_of_all"] == pytest.approx(np.mean([(s.depth <= 15).mean() for s in StereoDataset(folder)]))
    assert (tmp_path / "out" / "statistics.png").stat().st_size > 10000


@pytest.mark.usefixtures("undrawn")
def test_each_dataset_has_a_folder_for_its_results(folder, tmp_path, capfd, monkeypatch):
    """Results of two datasets with the same folder name do not overwrite each other."""
    monkeypatch.chdir(tmp_path)
    other = shutil.copytree(folder, tmp_path / "elsewhere" / "set")
    write_index(other, {"seed": 3}, StereoDataset(other).names[:4])
    for name in StereoDataset(folder).names[4:]:
        shutil.rmtree(other / "scenes" / name[:5], ignore_errors=True)
    for data in (folder, other, folder):
        code, out, _ = run(capfd, data, "--statistics-of", 2)
        assert code == 0 and f"see out/verify/set-{StereoDataset(data).digest[:8]}" in out
    assert run(capfd, other, "--sample", "00000/01")[0] == 0
    names = {p.relative_to("out/verify").as_posix() for p in Path("out/verify").rglob("*.*")}
    mine, its = (f"set-{StereoDataset(data).digest[:8]}" for data in (folder, other))
    results = {f"{place}/{name}" for place in (mine, its) for name in ("verify.json", "statistics.png")}
    assert names == results | {f"{its}/sample_00000_01.{kind}" for kind in ("png", "ply", "glb")}
    assert json.loads(Path("out/verify", mine, "verify.json").read_text())["pairs"]["all"] == 8


def test_an_unfinished_dataset_is_refused_with_the_command_that_completes_it(folder, tmp_path, capfd):
    (folder / "dataset.json").unlink()
    (folder / "generate.json").write_text('{"command": "--pairs 8 --scene gale"}')
    line = mistake(capfd, folder, "--out", tmp_path / "out")
    assert line.endswith(f"; python -m marssim.generate --out {folder} --pairs 8 --scene gale completes it")


def test_an_export_is_not_taken_for_a_dataset(folder, tmp_path, capfd):
    export(ExportConfig(folder, "eth3d", tmp_path / "eth3d"))
    line = mistake(capfd, tmp_path / "eth3d", "--out", tmp_path / "out")
    assert line.endswith(f"{tmp_path / 'eth3d'}: is an export of format eth3d, not a dataset of marssim.generate")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_a_dataset_that_is_being_written_is_not_checked(folder, tmp_path, capfd):
    """Samples may still be shown, and the lock's file of a killed command does not matter."""
    with sole_writer(folder):
        line = mistake(capfd, folder, "--out", tmp_path / "out")
        assert line.startswith(f"error: {folder}: another command (process ") and line.endswith("let it end first")
        assert not (tmp_path / "out").exists()
        assert run(capfd, folder, "--sample", "00000/00", "--out", tmp_path / "out")[0] == 0
    (folder / ".lock").write_text("process 1 on a machine that was switched off")
    assert run(capfd, folder, "--statistics-of", 0, "--out", tmp_path / "out")[0] == 0


def test_a_changed_sample_json_is_noticed(folder, tmp_path, capfd):
    file = folder / "scenes/00001/01/sample.json"
    file.write_text(file.read_text().replace('"k": 0.07', '"k": 0.08'))
    code, out, _ = run(capfd, folder, "--out", tmp_path / "out", "--statistics-of", 0)
    assert code == 1 and out.startswith("scenes/00001/01/sample.json: its content is not what dataset.json records\n")


def test_results_in_the_dataset_are_not_taken_for_extra_files(folder, capfd):
    for _ in range(2):
        assert run(capfd, folder, "--out", folder / "verify", "--statistics-of", 0)[0] == 0


@pytest.mark.parametrize("place", [".", "scenes", "scenes/../scenes/00000"])
def test_results_among_the_datasets_own_files_are_refused(folder, place, capfd):
    before = sorted(folder.rglob("*"))
    assert f"--out {folder / place}: " in mistake(capfd, folder, "--out", folder / place, "--statistics-of", 0)
    assert sorted(folder.rglob("*")) == before


def test_results_that_cannot_be_written_name_the_flag(folder, tmp_path, capfd, monkeypatch):
    """The message names the default folder if the flag is not given."""
    (tmp_path / "out").write_text("a file in the way")
    for more in ((), ("--sample", "00000/00")):
        below = tmp_path / "out" / "below"
        assert mistake(capfd, folder, "--out", below, *more) == f"error: --out {below}: not a directory"
    monkeypatch.chdir(tmp_path)
    assert mistake(capfd, folder).startswith("error: --out out/verify: ")


def test_a_folder_without_permission_is_reported_before_the_work(folder, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write anywhere
    monkeypatch.setattr(command, "verify_dataset", None)
    for asked in ((folder,), ("--cross-check",)):
        assert mistake(capfd, *asked, "--out", tmp_path) == f"error: --out {tmp_path}: permission denied"


@pytest.mark.usefixtures("undrawn")
def test_a_malformed_field_behind_right_hashes_is_named(folder, tmp_path, capfd):
    file = folder / "scenes/00000/00/sample.json"
    write_json(file, {**read_json(file), "surface_ids": {}})
    write_index(folder, {"seed": 3}, StereoDataset(folder).names)
    code, out, _ = run(capfd, folder, "--out", tmp_path / "out")
    assert code == 1 and out.startswith("scenes/00000/00/sample.json: surface_ids must name the surfaces of rocks\n")


@pytest.mark.usefixtures("undrawn")
def test_broken_files_are_named_and_the_exit_code_is_1(folder, tmp_path, capfd):
    (folder / "scenes/00000/00/left.png").unlink()
    image = folder / "scenes/00001/00/depth.png"
    image.write_bytes(image.read_bytes()[:-5])
    (folder / "scenes/00002/00/old.png").write_bytes(b"x")
    code, out, _ = run(capfd, folder, "--out", tmp_path / "out")
    lines = out.splitlines()
    assert code == 1 and lines[:3] == [
        "scenes/00000/00/left.png: missing",
        "scenes/00001/00/depth.png: truncated",
        "scenes/00002/00/old.png: a file that the index does not list",
    ]
    assert "3 files wrong; delete the folders of these samples, and repeat the command that made" in lines[-1]
    report = json.loads((tmp_path / "out" / "verify.json").read_text())
    assert not report["good"] and report["findings"][1] == {
        "path": "scenes/00001/00/depth.png", "problem": "truncated",
    }  # fmt: skip
    assert report["statistics"]["all"]["samples"] == 6  # of those that are whole


def test_many_findings_are_cut_short_on_the_screen(folder, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(command, "SHOWN", 2)
    for name in ("a", "b", "c", "d"):
        (folder / name).write_text(name)
    code, out, _ = run(capfd, folder, "--out", tmp_path / "out", "--statistics-of", 0)
    assert code == 1 and "and 2 more" in out and "c:" not in out
    assert "4 files wrong; not of samples: a, b, c and others; see" in out and "delete" not in out
    assert len(json.loads((tmp_path / "out" / "verify.json").read_text())["findings"]) == 4


@pytest.mark.usefixtures("undrawn")
def test_only_some_samples_are_decoded(folder, tmp_path, capfd, monkeypatch):
    read, whole = [], command.read_sample

    def counting(path: Path) -> object:
        read.append(path)
        return whole(path)

    monkeypatch.setattr(command, "read_sample", counting)
    assert run(capfd, folder, "--out", tmp_path / "out", "--statistics-of", 4)[0] == 0
    assert len(read) == 4 and {path.parent.name for path in read} > {"00001", "00002"}
    read.clear()
    assert run(capfd, folder, "--out", tmp_path / "none", "--statistics-of", 0)[0] == 0
    assert not read and not (tmp_path / "none" / "statistics.png").exists()


def test_samples_are_spread_over_the_splits():
    split = {f"{n:05d}/00": ("test" if n % 10 == 1 else "val" if n % 10 in (2, 6) else "train") for n in range(100)}
    chosen = spread(split, 20)
    assert [sum(split[name] == part for name in chosen) for part in SPLITS] == [14, 4, 2]
    assert len(set(chosen)) == 20 and chosen == sorted(chosen) and chosen[0] == "00000/00"
    assert len(spread(split, 1)) == 3 and spread(split, 0) == [] and len(spread(split, 1000)) == 100
    assert spread({}, 5) == []


def test_a_sample_is_shown(folder, tmp_path, capfd):
    code, out, _ = run(capfd, folder, "--sample", "00002/01", "--out", tmp_path / "out", "--max-range", 12)
    names = [f"sample_00002_01.{kind}" for kind in ("png", "ply", "glb")]
    assert code == 0 and out.split() == [str(tmp_path / "out" / name) for name in names]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted(names)
    sample = StereoDataset(folder, "val")[1]
    cloud = trimesh.load(tmp_path / "out" / names[1])
    assert len(cloud.vertices) == (sample.depth <= 12).sum()
    mesh = trimesh.load(tmp_path / "out" / names[2], force="mesh")
    assert len(mesh.faces) > len(cloud.vertices) and -mesh.vertices[:, 2].min() <= 12.001


@pytest.mark.usefixtures("undrawn")
def test_a_sample_is_shown_in_a_folder_of_which_the_command_is_the_only_writer(folder, tmp_path, capfd):
    out = tmp_path / "out"
    out.mkdir()
    half = out / ".sample_00000_00.png.123.part"
    half.write_bytes(b"half")
    with sole_writer(out):
        line = mistake(capfd, folder, "--sample", "00000/00", "--out", out)
        assert line.startswith(f"error: {out}: another command (process ") and half.exists()
    assert run(capfd, folder, "--sample", "00000/00", "--out", out)[0] == 0
    assert not half.exists()


def test_the_cross_check_prints_and_writes_what_it_finds(tmp_path, capfd, monkeypatch):
    for surface, code in ((1.0, 0), (0.9, 1)):
        views = Agreement(10, surface, 0.995, np.array([0.01, -0.02]), np.array([0.0, 0.03]))
        checks = {"scan": RendererCheck(views, np.array([0.002, 0.001])), "embree": RendererCheck(None, np.zeros(2))}
        monkeypatch.setattr(command, "cross_check", lambda *_, checks=checks: (checks, ["pybullet: left out"]))
        done, out, _ = run(capfd, "--cross-check", "--scene", "utopia", "--seed", 4, "--out", tmp_path)
        first, _, scan, embree, note = out.splitlines()
        assert done == code and first == "10 views of utopia, seed 4, against Embree's rays"
        assert note == "pybullet: left out"
        words = scan.replace("(", " ").replace(")", " ").replace(",", " ").split()
        shown = ["99.500%", "+0.0000", "+0.0300", "+0.0100", "-0.0200", "+0.0020", "+0.0010"]
        assert words[2:-1] == shown and words[-1] == ("DISAGREES" if code else "agrees")
        assert embree.split()[-1] == "agrees"
        noted = json.loads((tmp_path / "cross_check.json").read_text())
        assert noted["renderers"]["scan"]["good"] == (code == 0) and noted["renderers"]["scan"]["surface"] == surface
        assert noted["renderers"]["embree"] == {"planes_px": [0.0, 0.0], "good": True} and noted["scene"] == "utopia"


@pytest.mark.usefixtures("undrawn")
def test_a_dataset_beside_the_cross_check_is_checked_too(folder, tmp_path, capfd, monkeypatch):
    checks = {"scan": RendererCheck(None, np.zeros(2))}
    monkeypatch.setattr(command, "cross_check", lambda *_: (checks, []))
    arguments = (folder, "--cross-check", "--out", tmp_path / "out")
    code, out, _ = run(capfd, *arguments)
    assert code == 0 and "all files are as the index records them" in out and "agrees" in out
    next(folder.rglob("left.png")).write_bytes(b"broken")
    code, out, _ = run(capfd, *arguments)
    assert code == 1 and "1 file wrong" in out and "agrees" in out
    assert {"verify.json", "cross_check.json"} <= {file.name for file in (tmp_path / "out").iterdir()}


def test_a_folder_that_is_no_dataset_is_refused(folder, tmp_path, capfd):
    assert str(tmp_path / "nowhere") in mistake(capfd, tmp_path / "nowhere")
    assert "dataset.json" in mistake(capfd, tmp_path)
    (folder / "dataset.json").write_text('{"schema": "other"}')
    assert "schema" in mistake(capfd, folder, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("args", "named"),
    [
        ((), "--cross-check"),
        (("--sample", "00000/00"), "--sample"),
        (("--cross-check", "--view"), "--view shows the pairs of a dataset"),
        (("SET", "--sample", "0/7"), "--sample 0/7"),
        (("SET", "--statistics-of", -1), "--statistics-of"),
        (("SET", "--workers", 0), "--workers"),
        (("SET", "--max-range", 0), "--max-range"),
        (("SET", "--max-range", "nan"), "--max-range"),
        (("--cross-check", "--views", 0), "--views"),
        (("somewhere", "--views", 3), "--views describes the views of --cross-check"),
        (("somewhere", "--max-range", 9), "--max-range is of the clouds of --sample and --view"),
        (("somewhere", "--scene", "gale"), "--scene describes"),
        (("--cross-check", "--scene", "olympus"), "--scene"),
    ],
)
def test_bad_values_name_their_flag(folder, tmp_path, args, named, capfd):
    args = [folder if a == "SET" else a for a in args]
    assert named in mistake(capfd, *args, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_view_shows_all_pairs_after_the_check_or_the_sample_alone(folder, tmp_path, capfd, monkeypatch):
    pages = []
    monkeypatch.setattr(command, "check_viewer", lambda: None)
    monkeypatch.setattr(command, "show", lambda shots, title: pages.append((shots, title)))
    assert run(capfd, folder, "--view", "--out", tmp_path / "out", "--statistics-of", 1)[0] == 0
    assert run(capfd, folder, "--sample", "00001/01", "--view", "--out", tmp_path / "out", "--max-range", 4)[0] == 0
    (all_shots, title), ((shot,), _) = pages
    assert [s.name for s in all_shots] == StereoDataset(folder).names and title == "set"
    assert [s.world for s in all_shots] == [name[:5] for name in StereoDataset(folder).names]
    sample = StereoDataset(folder)[StereoDataset(folder).names.index("00001/01")]
    view = shot.load()
    assert shot.name == "00001/01" and np.allclose(shot.pose, sample.meta["pose"])
    assert list(view.layers) == ["image", "depth", "normals"] and len(view.points) == (sample.depth <= 4).sum()
    assert np.array_equal(view.layers["image"].colours, sample.left[sample.depth <= 4])


def test_view_needs_poses_and_names_the_file_without_one(folder, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(command, "check_viewer", lambda: None)
    file = folder / "scenes/00000/00/sample.json"
    write_json(file, {name: value for name, value in read_json(file).items() if name != "pose"})
    error = mistake(capfd, folder, "--sample", "00000/00", "--view", "--out", tmp_path / "out")
    assert error.startswith(f"error: {file}: pose must be")


@pytest.mark.parametrize("corrupt", [lambda f: b"", lambda f: f[:-99], lambda f: f[:-99] + b"?" + f[-98:]])
def test_a_broken_sample_cannot_be_shown(folder, tmp_path, capfd, corrupt):
    file = folder / "scenes/00000/00/normal.png"
    file.write_bytes(corrupt(file.read_bytes()))
    assert "normal.png" in mistake(capfd, folder, "--sample", "00000/00", "--out", tmp_path / "out")


def test_a_folder_that_cannot_be_written_is_reported_before_the_work(folder, tmp_path, capfd, monkeypatch):
    for work in ("verify_dataset", "cross_check"):
        monkeypatch.setattr(command, work, lambda *_: pytest.fail("it was at work"))
    (tmp_path / "file").write_text("in the way")
    for asked in (folder, "--cross-check"):
        assert str(tmp_path / "file") in mistake(capfd, asked, "--out", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "in the way"
