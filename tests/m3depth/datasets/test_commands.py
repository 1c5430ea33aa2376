"""m3depth.train and m3depth.evaluate read any layout by the same flags."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from plane_pairs import plane_sample
from small_network import SMALL

from m3depth import evaluate, train
from m3depth.network import model as model_module
from m3depth.network.model import M3Depth
from m3depth.stereo.classical import SGBM
from marssim.export import ExportConfig, export

pytestmark = pytest.mark.usefixtures("undrawn_figures")

TINY = replace(SMALL, refine_steps=1, fine_width=0)

TREE = "KITTI"


@pytest.fixture(scope="module")
def kitti(plane_set, tmp_path_factory):
    out = tmp_path_factory.mktemp("tree") / TREE
    export(ExportConfig(plane_set, "kitti", out))
    return out


def test_training_on_two_layouts_at_once_without_normals(kitti, plane_set, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(model_module.PRESETS, "lite", TINY)
    run = tmp_path / "run"
    sizes = ["--max-steps", "2", "--batch", "2", "--crop", "32", "64", "--validate-samples", "4"]
    assert train.main(["--data", str(kitti), str(plane_set), "--out", str(run), "--device", "cpu", *sizes]) == 0
    output = capsys.readouterr()
    assert "8 samples" in output.err and "averaged weights of step 2" in output.out
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert all(record["loss"] > 0 for record in records if record["kind"] == "train")
    run = tmp_path / "blind"
    assert train.main(["--data", str(kitti), "--out", str(run), "--device", "cpu", *sizes]) == 0
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert [record["normal"] for record in records if record["kind"] == "train"] == [0.0]
    assert "EPE" in capsys.readouterr().out
    run = tmp_path / "fitted"
    assert train.main(["--data", str(kitti), "--out", str(run), "--device", "cpu", "--normals", "depth", *sizes]) == 0
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert all(record["normal"] > 0 for record in records if record["kind"] == "train")


def test_flags_of_the_reader_go_to_the_data_beside_those_of_marssim(
    kitti, plane_set, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.setitem(model_module.PRESETS, "lite", TINY)
    sizes = ["--max-steps", "1", "--batch", "2", "--crop", "32", "64", "--validate-samples", "4", "--device", "cpu"]
    files = "*/training/{}/*_10.png"
    flags = ["--left", files.format("image_2"), "--right", files.format("image_3"), "--focal", "70"]
    flags += ["--baseline", "0.27", "--disparity", files.format("disp_occ_0"), "--normals", "depth"]
    data = ["--data", str(plane_set), str(kitti)]
    assert train.main([*data, "--out", str(tmp_path / "run"), *flags, *sizes]) == 0
    printed = capsys.readouterr()
    assert "8 samples" in printed.err
    scores = [line for line in printed.out.splitlines() if line.startswith("score them: ")]
    assert "--focal" not in scores[0] and str(plane_set) in scores[0]
    assert "--focal 70" in scores[1] and str(kitti) in scores[1]
    arguments = ["--data", str(plane_set), str(plane_set), "--out", str(tmp_path / "alone"), *flags[4:6], *sizes]
    assert train.main([*arguments, "--baseline", "0.27"]) == 2
    assert f"{plane_set}: --focal does not belong to layout marssim" in capsys.readouterr().err


def test_scoring_a_folder_by_patterns(kitti, tmp_path) -> None:
    torch.manual_seed(0)
    M3Depth(TINY).save_pretrained(tmp_path / "net.safetensors")
    files = "*/training/{}/*_10.png"
    arguments = ["--data", str(kitti), "--out", str(tmp_path / "out"), "--weights", str(tmp_path / "net.safetensors")]
    arguments += ["--baselines", "none", "--split", "all", "--limit", "2", "--focal", "70", "--baseline", "0.27"]
    arguments += ["--left", files.format("image_2"), "--right", files.format("image_3")]
    assert evaluate.main([*arguments, "--disparity", files.format("disp_occ_0"), "--depth-range", "0.5", "9"]) == 0
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["depth_range_m"] == [0.5, 9.0]
    assert "Scored: every pixel of true depth 0.5 to 9 m and at most" in (tmp_path / "out" / "results.md").read_text()
    assert results["pairs"] == 2 and results["per_pair"][0]["pair"].endswith("000000_10")
    scored = results["methods"]["net"]
    assert scored["depth"]["all"]["pooled"]["epe"] > 0
    assert not scored["normal"]["all"]["pooled"], "there is nothing to compare normals with"


@pytest.mark.parametrize("command", [train.main, evaluate.main])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "holds no dataset of marssim, KITTI"),
        (["--format", "kitti"], "holds no pairs of layout kitti"),
        (["--left", "*.png", "--right", "*.png", "--depth", "*.npy"], "layout folder needs --calib"),
        (["--focal", "3"], "--focal and --baseline belong together"),
        (["--resize", "2"], "--resize must be over 0"),
    ],
)
def test_what_cannot_be_read_is_one_line_and_exit_2(command, arguments, message, tmp_path, capsys) -> None:
    limit = ["--max-steps", "1"] if command is train.main else []
    assert command(["--data", str(tmp_path), "--out", str(tmp_path / "out"), *limit, *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and message in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "what is known is sky, 1000 m and farther; if the maps hold millimetres, give --unit 1000"),
        (["--unit", "-1"], "check the maps, --unit and --depth-range"),
    ],
)
@pytest.mark.parametrize("command", [train.main, evaluate.main])
def test_maps_without_a_depth_that_can_be_used_end_a_command_in_one_line(
    kitti, tmp_path, monkeypatch, capsys, command, arguments, message
) -> None:
    """Depth in millimetres in npy files counts as sky."""
    monkeypatch.setitem(model_module.PRESETS, "lite", TINY)
    monkeypatch.setattr("m3depth.evaluation.command.methods.load_estimator", lambda *_, **__: SGBM())
    for folder, file in (("image_2", "l"), ("image_3", "r")):
        (tmp_path / "data" / file).mkdir(parents=True)
        for path in (kitti / "train/training" / folder).glob("*_10.png"):
            shutil.copy(path, tmp_path / "data" / file / path.name)
    for path in (tmp_path / "data/l").iterdir():
        np.save(tmp_path / "data" / f"{path.stem}.npy", np.full(cv2.imread(str(path)).shape[:2], 4000, np.float32))
    out = tmp_path / "out"
    words = ["--data", str(tmp_path / "data"), "--out", str(out), "--focal", "70", "--baseline", "0.27"]
    words += ["--left", "l/*.png", "--right", "r/*.png", "--depth", "*.npy", "--device", "cpu", *arguments]
    words += ["--max-steps", "1", "--crop", "32", "64"] if command is train.main else ["--split", "all"]
    assert command(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("error: ") and lines[-1].endswith(message)
    assert [line for line in lines if line.startswith("error")] == lines[-1:]
    assert not out.exists() or not list(out.iterdir())


@pytest.mark.parametrize("command", [train.main, evaluate.main])
def test_depth_that_does_not_fit_the_images_gives_a_warning(tmp_path, monkeypatch, capsys, command) -> None:
    monkeypatch.setitem(model_module.PRESETS, "lite", TINY)
    monkeypatch.setattr("m3depth.evaluation.command.methods.load_estimator", lambda *_, **__: SGBM())
    data = tmp_path / "data"
    data.mkdir()
    for seed in range(2):
        sample = plane_sample(seed, 96, 192, 150.0)
        cv2.imwrite(str(data / f"l{seed}.png"), sample.left)
        cv2.imwrite(str(data / f"r{seed}.png"), sample.right)
        rays = sample.rig.camera.rays()
        np.save(data / f"{seed}.npy", sample.depth * np.linalg.norm(rays, axis=-1))
    words = ["--data", str(data), "--left", "l*.png", "--right", "r*.png", "--depth", "*.npy"]
    words += ["--focal", "150", "--baseline", "0.27", "--device", "cpu"]
    words += ["--max-steps", "1", "--crop", "32", "64"] if command is train.main else ["--split", "all"]
    warning = "does not fit the images: the maps hold the distance along the ray"
    assert command([*words, "--out", str(tmp_path / "axis")]) == 0
    error = capsys.readouterr().err
    assert warning in error and f"warning: {data}: the true depth of " in error
    assert command([*words, "--out", str(tmp_path / "ray"), "--depth-along", "ray"]) == 0
    assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize("command", [train.main, evaluate.main])
def test_sparse_maps_warn_that_they_give_no_normals(kitti, tmp_path, monkeypatch, capsys, command) -> None:
    monkeypatch.setitem(model_module.PRESETS, "lite", TINY)
    monkeypatch.setattr("m3depth.evaluation.command.methods.load_estimator", lambda *_, **__: SGBM())
    warning = "--normals depth gives no normals, since it needs maps without gaps"
    words = ["--normals", "depth", "--device", "cpu"]
    words += ["--max-steps", "1", "--crop", "32", "64", "--validate-samples", "0"] if command is train.main else []
    for sparse in (False, True):
        data = tmp_path / f"data{sparse}"
        shutil.copytree(kitti, data)
        for path in data.rglob("disp_occ_0/*.png") if sparse else ():
            disparity = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            disparity[::5] = 0
            cv2.imwrite(str(path), disparity)
        assert command(["--data", str(data), "--out", str(tmp_path / f"out{sparse}"), *words]) == 0
        assert (warning in capsys.readouterr().err) == sparse
