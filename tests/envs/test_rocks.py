"""Rocks in the navigator's map, from a dataset whose rocks are known."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rock_samples import RIG, ahead, rock_sample, without_rocks
from rock_world import RockWorld

from envs.rocks import main
from m3depth.stereo.prediction import Prediction
from marssim.base.dataset.dataset import write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import write_sample

DOMES = ((3.0, -0.5, 0.35, 0.3), (5.0, 0.6, 0.5, 0.4), (6.0, -1.0, 0.4, 0.25))


def world(*more) -> RockWorld:
    return RockWorld(domes=np.array([(*ahead(d, aside), r, h) for d, aside, r, h in (*DOMES, *more)]))


class Melted:
    """Sees the first two rocks, and one where none is; the third is melted into the plain."""

    def infer(self, left, right, rig):
        phantom = rock_sample(world((4.0, 1.0, 0.3, 0.35)))
        depth = without_rocks(phantom, keep=(1, 2, 4)).astype(np.float32)
        return Prediction(depth, rig.depth_to_disparity(depth), None, np.ones(depth.shape, np.float32))


class Halved(Melted):
    def infer(self, left, right, rig):
        whole = super().infer(left, right, rig)
        return replace(whole, depth=whole.depth[::2, ::2])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("rocks")
    sample = rock_sample(world())
    frame = StereoFrame(
        sample.left, sample.right, sample.depth, sample.disparity, sample.normal,
        np.where(np.isinf(sample.depth), -1, sample.rock), sample.occluded, RIG, np.array(sample.meta["pose"]),
    )  # fmt: skip
    bare = replace(frame, surface=np.where(np.isinf(sample.depth), -1, 0), depth=without_rocks(sample))
    for name, content in (("00001/00", frame), ("00001/01", bare)):
        write_sample(path / "scenes" / name, content, {})
    write_index(path, {}, ["00001/00", "00001/01"])
    return path


def test_a_method_that_returns_no_whole_prediction_is_named(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("envs.rocks.load_perception", lambda name, runtime: Halved())
    assert main(["--data", str(folder), "--out", str(tmp_path / "out"), "--perception", "halved"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("error: Halved.infer returned depth of shape")


def test_found_missed_and_false(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("envs.rocks.load_perception", lambda name, _: None if name == "ground_truth" else Melted())
    out = tmp_path / "out"
    args = ["--data", str(folder), "--out", str(out), "--perception", "melted", "ground_truth"]
    assert main(args) == 0
    results = json.loads((out / "results.json").read_text())
    assert results["runtime"] is None  # M3Depth did not run
    assert "Networks ran in" not in (out / "results.md").read_text()
    methods = results["methods"]
    true, melted = (methods[name]["standing_0.2_m_within_8_m"] for name in ("ground_truth", "melted"))
    assert (true["rocks"], true["found"], methods["ground_truth"]["false"]) == (3, 3, 0)
    assert true["height_error_m"] < 0.05
    # the second frame has no rocks: there, the first two of those seen are false as well
    assert (melted["rocks"], melted["found"], methods["melted"]["false"]) == (3, 2, 1 + 3)
    assert "of 3 rocks of 0.2 m and more within 8 m 66.7 % found" in capsys.readouterr().out
    page = (out / "results.md").read_text()
    assert "| melted | 0.2 m and more | 0-8 m | 3 | 2 |" in page
    assert results["sky"]["ground_truth"]["near_ground_as_sky"] == results["sky"]["ground_truth"]["missed"] == 0
    assert results["sky"]["melted"]["near_ground_as_sky"] == 0 and "near ground predicted as sky" in page
    assert cv2.imread(str(out / "rocks.png")).std() > 10


@pytest.mark.usefixtures("undrawn_figures")
def test_the_counts_of_each_pair_are_kept_with_its_scene(folder, tmp_path):
    out = tmp_path / "out"
    assert main(["--data", str(folder), "--out", str(out), "--perception", "ground_truth"]) == 0
    content = json.loads((out / "results.json").read_text())
    first, second = content["per_pair"]
    assert first["scene"] == second["scene"] and first["pair"] != second["pair"]
    assert (len(first["ground_truth"]["rocks"]), len(second["ground_truth"]["rocks"])) == (3, 0)
    height, distance, found, error, both_eyes = first["ground_truth"]["rocks"][0]
    assert height == pytest.approx(0.3, abs=0.02) and distance < 3 and found and abs(error) < 0.05 and both_eyes
    assert first["ground_truth"]["false"] == [] and first["ground_truth"]["edges"] == []


@pytest.mark.usefixtures("undrawn_figures")
def test_several_folders_in_one_count_and_other_heights_of_an_obstacle(folder, tmp_path):
    out = tmp_path / "out"
    args = ["--data", str(folder), str(folder), "--split", "all", "--out", str(out), "--perception", "ground_truth"]
    assert main(args) == 0
    content = json.loads((out / "results.json").read_text())
    assert content["images"] == 4 and content["methods"]["ground_truth"]["standing_0.2_m_within_8_m"]["rocks"] == 6
    steps = content["by_step"]["ground_truth"]
    assert [point["step_m"] for point in steps] == [0.1, 0.12, 0.15, 0.2, 0.25]
    counts = [point["found"] for point in steps]
    assert counts == sorted(counts, reverse=True) and counts[0] == 6
    assert "| ground_truth | 0.12 m | 6 of 6 | 6 of 6 | 0 | 0 | 0 |" in (out / "results.md").read_text()


def test_results_of_drives_are_not_replaced(folder, tmp_path, capsys):
    drives = tmp_path / "results.json"
    drives.write_text('{"differences": []}')
    assert main(["--data", str(folder), "--out", str(tmp_path), "--split", "all", "--perception", "ground_truth"]) == 2
    error = capsys.readouterr().err
    assert (
        error.startswith(f"error: --out {tmp_path}: its results.json is of another command or")
        and error[:-1].isprintable()
    )
    assert drives.read_text() == '{"differences": []}'


@pytest.mark.usefixtures("undrawn_figures")
def test_a_higher_step_finds_fewer(folder, tmp_path):
    out = tmp_path / "out"
    args = ["--data", str(folder), "--out", str(out), "--perception", "ground_truth", "--limit", "1"]
    assert main([*args, "--step", "0.36"]) == 0
    key = json.loads((out / "results.json").read_text())["methods"]["ground_truth"]["standing_0.2_m_within_8_m"]
    assert (key["rocks"], key["found"]) == (3, 1)


NOT_A_POSE = "[[1, 0, 0, 0], [NaN, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"


def without_pose(folder, names, instead=""):
    """Take the pose out of samples, or write the text of another value."""
    for name in names:
        file = folder / "scenes" / name / "sample.json"
        meta = {key: value for key, value in json.loads(file.read_text()).items() if key != "pose"}
        file.write_text((f'{{"pose": {instead}, ' if instead else "{") + json.dumps(meta)[1:])
    return file


@pytest.mark.parametrize("pose", ["null", "3", NOT_A_POSE])
def test_a_pose_that_is_none_is_named(folder, tmp_path, capsys, pose):
    copy = shutil.copytree(folder, tmp_path / "copy")
    file = without_pose(copy, ["00001/01"], pose)
    assert main(["--data", str(copy), "--out", str(tmp_path / "out"), "--perception", "ground_truth"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"error: {file}: pose must be ")


def test_pairs_without_poses_are_reported(folder, tmp_path, capsys):
    copy = shutil.copytree(folder, tmp_path / "copy")
    without_pose(copy, ["00001/00", "00001/01"])
    assert main(["--data", str(copy), "--out", str(tmp_path / "out"), "--perception", "ground_truth"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"error: {copy}: no pair of split ") and error.endswith("holds the pose of its camera")


@pytest.mark.usefixtures("undrawn_figures")
def test_the_number_of_pairs_without_a_pose_is_said(folder, tmp_path, capsys):
    copy = shutil.copytree(folder, tmp_path / "copy")
    without_pose(copy, ["00001/01"])
    assert main(["--data", str(copy), "--out", str(tmp_path / "out"), "--perception", "ground_truth"]) == 0
    assert "\n1 pair left out: no pose" in capsys.readouterr().out
    content = json.loads((tmp_path / "out" / "results.json").read_text())
    assert (content["images"], content["left_out"]) == (1, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"--data": "nowhere"}, "nowhere: no such folder"),
        ({"--split": "val"}, "split val holds no pairs"),
        ({"--step": "0"}, "--step must be positive, got 0.0"),
        ({"--limit": "0"}, "--limit must be at least 1, got 0"),
        ({"--perception": "raft"}, "--perception 'raft' is unknown"),
        ({"--degrade": "fog=1"}, "error: --degrade: unknown field 'fog'"),
    ],
)
def test_mistakes_exit_with_2_and_one_line(folder, tmp_path, capsys, change, message):
    options = {"--data": str(folder), "--out": str(tmp_path / "out"), "--perception": "ground_truth", **change}
    assert main([word for pair in options.items() for word in pair]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()
