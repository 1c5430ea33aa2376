"""Datasets with raw pairs: their files, what the rectified pairs do not notice of them, and what verify finds."""

import json
import re
import shutil

import cv2
import numpy as np
import pytest

from marssim import generate, verify
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import RAW
from marssim.base.files.json_file import as_json
from marssim.generate import main
from marssim.generation import scene_views
from marssim.generation.config import parse_generate

RIG = {
    "width": 64, "height": 48, "fx": 70.0, "fy": 70.0, "cx": 31.5, "cy": 23.5, "baseline": 0.2,
    "distortion_model": "plumb_bob", "distortion_coefficients": [-0.2, 0.05, 0, 0], "vergence_deg": 2.0,
    "rotation_deg": [0.5, 0.2, -0.8],
}  # fmt: skip
FLAGS = ["--pairs", "1", "--scene", "gale", "--size", "12", "--horizon", "16", "--renderer", "scan"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A dataset with a raw pair, and one of the same rig without."""
    folder = tmp_path_factory.mktemp("raw")
    (folder / "rig.json").write_text(json.dumps(RIG))
    for name, more in (("raw", ["--raw"]), ("plain", [])):
        assert main(["--out", str(folder / name), *FLAGS, "--rig-file", str(folder / "rig.json"), *more]) == 0
    return folder


@pytest.fixture
def folder(made, tmp_path):
    """A copy of the dataset with a raw pair that a test may break."""
    return shutil.copytree(made / "raw", tmp_path / "raw")


def test_the_raw_pair_and_its_calibration_lie_beside_the_rest(made):
    view = made / "raw/scenes/00000/00"
    images = [cv2.imread(str(view / name), cv2.IMREAD_UNCHANGED) for name in RAW]
    assert [image.shape for image in images] == [(48, 64, 3)] * 2
    assert len({str(image.mean()) for image in (*images, cv2.imread(str(view / "left.png")))}) == 3
    assert {f.name for f in (made / "raw/calibration").iterdir()} >= {"opencv.yml", "kalibr.yaml", "cahvore_left.lbl"}
    assert "`m3depth.rectify --shift 0`" in (made / "raw/README.md").read_text()


def test_rectified_pairs_are_the_same_with_and_without_raw_ones(made):
    raw, plain = (StereoDataset(made / name)[0] for name in ("raw", "plain"))
    for name in ("left", "right", "depth", "normal", "occluded"):
        assert np.array_equal(getattr(raw, name), getattr(plain, name)), name
    assert raw.meta.pop("raw_sha256").keys() == set(RAW) and raw.meta == plain.meta
    assert "raw" not in plain.meta and not (made / "plain/calibration").exists()


def test_noise_of_raw_images_differs_from_view_to_view(tmp_path, monkeypatch):
    drawn = []

    def render(self, renderer, shader, pose, sensor, rng, rover=None):
        drawn.append(rng.random())
        return (np.zeros((48, 64, 3), np.uint8),) * 2

    monkeypatch.setattr(scene_views.RawRenderer, "render", render)
    (tmp_path / "rig.json").write_text(json.dumps(RIG))
    flags = [*FLAGS, "--rig-file", str(tmp_path / "rig.json"), "--raw", "--pairs", "3", "--views-per-scene", "2"]
    assert main(["--out", str(tmp_path / "set"), *flags]) == 0
    assert len(drawn) == len(set(drawn)) == 3


def test_the_command_in_the_dataset_gives_its_settings(made):
    settings = json.loads((made / "raw/generate.json").read_text())
    flags = re.search(r"python -m marssim.generate --out DIR (.*)", (made / "raw/README.md").read_text())[1].split()
    flags[flags.index("rig.json")] = str(made / "rig.json")
    again = as_json(parse_generate("generate", "", ["--out", "x", *flags]).content())
    assert again["raw"] == settings["raw"] and again["rig"] == settings["rig"]
    assert settings["raw"]["right"]["coefficients"] == [-0.2, 0.05, 0, 0]


def test_a_run_that_stopped_names_the_rig_file_from_any_folder(made, tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(generate, "_generate", stop)
    monkeypatch.chdir(made)
    assert main(["--out", str(tmp_path / "set"), *FLAGS, "--rig-file", "rig.json", "--raw"]) == 130
    command = json.loads((tmp_path / "set/generate.json").read_text())["command"]
    assert f"--rig-file {made / 'rig.json'}" in command


def test_verify_finds_nothing_wrong_and_notices_what_is(made, folder, tmp_path, capsys):
    def findings() -> str:
        verify.main([str(folder), "--out", str(tmp_path / "out")])
        return "".join(capsys.readouterr())

    assert "all files are as the index records them" in findings()
    (folder / "calibration/opencv.yml").write_text("K1: 0")
    (folder / "calibration/kalibr.yaml").unlink()
    image = folder / "scenes/00000/00/raw_right.png"
    image.write_bytes(image.read_bytes()[:-9])
    said = findings()
    assert "calibration/opencv.yml: its content is not what dataset.json records" in said
    assert "calibration/kalibr.yaml: missing" in said and "raw_right.png: truncated" in said


def test_raw_pairs_of_an_ideal_rig_are_refused(made, tmp_path, capsys):
    assert main(["--out", str(tmp_path / "set"), *FLAGS, "--raw"]) == 2
    assert "--raw needs --rig-file with the distortion or the rotation of real cameras" in capsys.readouterr().err
    wide = {**RIG, "distortion_model": "equidistant", "distortion_coefficients": [0, 0, 0, 0], "fx": 20, "fy": 20}
    (tmp_path / "wide.json").write_text(json.dumps(wide))
    assert main(["--out", str(tmp_path / "set"), *FLAGS, "--rig-file", str(tmp_path / "wide.json"), "--raw"]) == 2
    error = capsys.readouterr().err
    assert "wide.json: " in error and "more than 70 deg off its axis" in error and error.count("\n") == 1
    assert not (tmp_path / "set").exists()
