"""The files of one pair, at any size, and the errors for input that cannot be used."""

import errno
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from m3depth.predict import PredictOptions, main, predict
from m3depth.prediction import one_pair
from m3depth.prediction.files import EDGE_SHARE, point_cloud
from m3depth.runtimes.choice import recorded_runtime
from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.images.depth_edges import depth_edges


class Wall:
    """A wall at 4 m, a nearer block at 2 m, sky above, one unknown pixel; unsure on the left."""

    def infer(self, left, right, rig):
        height, width = left.shape[:2]
        depth = np.full((height, width), 4, np.float32)
        depth[height // 2 :, width // 2 :] = 2
        depth[:3] = np.inf
        depth[5, 20] = np.nan
        disparity = np.where(np.isnan(depth), np.float32(np.nan), rig.depth_to_disparity(depth))
        confidence = np.ones((height, width), np.float32)
        confidence[:, :8] = 0.1
        normal = np.broadcast_to(np.float32([0, 0, -1]), (height, width, 3))
        return Prediction(depth, disparity, normal, confidence)


def write(path, image):
    assert cv2.imwrite(str(path), image)
    return path


@pytest.fixture
def pair(tmp_path):
    rng = np.random.default_rng(0)
    images = (rng.integers(0, 255, (45, 61, 3), dtype=np.uint8) for _ in range(2))
    return [write(tmp_path / f"{name}.png", image) for name, image in zip(("left", "right"), images)]


def options(pair, tmp_path, **changes) -> PredictOptions:
    return PredictOptions(tuple(pair), **{"focal": 80.0, "baseline": 0.2, "out": tmp_path / "out", **changes})


def test_the_word_shipped_is_the_method_without_the_flag(pair, tmp_path):
    named = options(pair, tmp_path, weights=Path("shipped"))
    assert one_pair.method_name(named)[0] == one_pair.method_name(options(pair, tmp_path))[0] == "m3depth"
    assert (
        one_pair.method_name(options(pair, tmp_path, weights=Path("mine.safetensors")))[0] == "m3depth:mine.safetensors"
    )


def test_every_file_is_written_and_reads_back(pair, tmp_path, capsys):
    predict(options(pair, tmp_path), Wall())
    out = tmp_path / "out"
    assert {p.name for p in out.iterdir()} == {
        "depth.npy", "depth.png", "disparity.npy", "disparity.png", "normal.npy", "normal.png", "confidence.npy",
        "confidence.png", "sky.png", "cloud.ply", "figure.png", "prediction.json",
    }  # fmt: skip
    sky = cv2.imread(str(out / "sky.png"), cv2.IMREAD_UNCHANGED)
    assert sky.dtype == np.uint8 and (sky == 255 * np.isposinf(np.load(out / "depth.npy"))).all()
    depth = cv2.imread(str(out / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16 and depth.shape == (45, 61)
    assert (depth[0] == 0).all() and depth[5, 20] == 0 and depth[10, 10] == 4000 and depth[40, 50] == 2000
    disparity = cv2.imread(str(out / "disparity.png"), cv2.IMREAD_UNCHANGED)
    assert disparity[10, 10] == round(80 * 0.2 / 4 * 256) and disparity[0, 0] == 0
    assert np.isinf(np.load(out / "depth.npy")[0]).all()
    # BGR: towards the camera; zero lies between two levels
    assert np.abs(cv2.imread(str(out / "normal.png"))[10, 10] - [255.0, 127.5, 127.5]).max() <= 0.5
    cloud = trimesh.load(out / "cloud.ply")
    assert set(np.unique(np.round(cloud.vertices[:, 2], 3))) == {2.0, 4.0}
    assert "median" in capsys.readouterr().out


def test_cloud_leaves_out_what_cannot_be_trusted(tmp_path):
    rig = StereoRig(PinholeCamera.centred(61, 45, 80.0), 0.2)
    left = np.zeros((45, 61), np.uint8)
    prediction = Wall().infer(left, left, rig)
    points, colour = point_cloud(left, prediction, rig)
    assert len(points) == len(colour) > 1000 and np.isfinite(points).all()
    pixels = np.round(rig.camera.project(points)).astype(int)
    assert pixels[:, 0].min() == 8
    edges = depth_edges(prediction.disparity, share=EDGE_SHARE)
    assert not edges[pixels[:, 1], pixels[:, 0]].any()
    assert edges[30, 30] and edges[30, 29] and not edges[30, 33] and edges[5, 19]
    assert not len(point_cloud(left, prediction, rig, max_range=1.0)[0])


def test_a_cloud_without_points_is_a_file_without_points(pair, tmp_path, capsys):
    predict(options(pair, tmp_path, max_range=1.0), Wall())
    assert (
        b"element vertex 0\n" in (tmp_path / "out/cloud.ply").read_bytes() and "; 0 points" in capsys.readouterr().out
    )


def test_principal_point_moves_the_cloud(pair, tmp_path):
    for name, cx in (("a", None), ("b", 20.0)):
        predict(options(pair, tmp_path, out=tmp_path / name, cx=cx), Wall())
    far = [trimesh.load(tmp_path / name / "cloud.ply").vertices for name in "ab"]
    assert np.allclose(far[1][:, 0] - far[0][:, 0], 10 * far[0][:, 2] / 80, atol=1e-5)


@pytest.mark.parametrize(("shape", "flag"), [((31, 47), "--estimator"), ((33, 90, 3), "--method")])
def test_command_at_any_size_grey_or_colour(tmp_path, shape, flag):
    """--method is the name that --estimator had in release 0.1.0."""
    rng = np.random.default_rng(2)
    pair = [write(tmp_path / f"{i}.png", rng.integers(0, 255, shape, dtype=np.uint8)) for i in (0, 1)]
    args = [*map(str, pair), "--focal", "60", "--baseline", "0.3", "--out", str(tmp_path / "o"), flag, "sgbm"]
    assert main(args) == 0
    assert np.load(tmp_path / "o/depth.npy").shape == shape[:2]
    assert (tmp_path / "o/cloud.ply").read_bytes().startswith(b"ply")


def textured_pair(tmp_path, disparity: int):
    """A wall of noise, `disparity` px farther left in the right eye."""
    wall = np.random.default_rng(4).integers(0, 255, (60, 100), dtype=np.uint8)
    return [write(tmp_path / f"{n}.png", wall[:, n * disparity :][:, :90]) for n in (0, 1)]


@pytest.mark.parametrize("name", ["m3depth", "sgbm"])
def test_the_record_names_the_method_and_what_ran_it(pair, tmp_path, name):
    runtime = recorded_runtime([name])
    predict(options(pair, tmp_path, estimator=name, unchecked=True))
    record = json.loads((tmp_path / "out/prediction.json").read_text())
    assert (record["estimator"], record["runtime"], record["rows_aligned"]) == (name, runtime, None)
    assert (record["sha256"] is None) == (name == "sgbm") and record["versions"]["torch"]


def test_steps_are_drawn_and_recorded(tmp_path):
    predict(options(textured_pair(tmp_path, 8), tmp_path, steps=True, write=("depth",)))
    out = tmp_path / "out"
    assert {p.name for p in out.iterdir()} == {"depth.npy", "depth.png", "prediction.json", "steps.png"}
    record = json.loads((out / "prediction.json").read_text())
    names = [entry["name"] for entry in record["steps"]]
    assert names == ["first map", *(f"step {n}" for n in range(1, 9)), "result"]
    assert record["runtime"].startswith("pytorch ")
    assert cv2.imread(str(out / "steps.png")).std() > 20
    predict(options(textured_pair(tmp_path, 8), tmp_path, write=("depth",)), Wall())
    assert not (out / "steps.png").exists()  # that of another method is not left


def test_exchanged_eyes_are_refused_and_others_are_not(tmp_path, capsys):
    left, right = textured_pair(tmp_path, 8)
    predict(options((left, right), tmp_path), Wall())
    assert not capsys.readouterr().err
    out = tmp_path / "exchanged"
    args = [str(right), str(left), "--focal", "80", "--baseline", "0.2", "--out", str(out), "--estimator", "sgbm"]
    assert main(args) == 2
    error = capsys.readouterr().err
    assert "exchange left and right" in error and error.count("\n") == 1 and not out.exists()
    assert main([*args, "--unchecked"]) == 0
    assert capsys.readouterr().err.startswith("warning: ") and (out / "depth.npy").exists()


def test_rows_that_lie_apart_are_aligned_or_give_a_warning_or_an_error(tmp_path, capsys):
    scene = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 255, (300, 460), dtype=np.uint8), (0, 0), 1.5)
    left = write(tmp_path / "l.png", scene[20:-20, 20:420])
    warning, error = "warning: the rows of", "lie 4.0 px apart"
    for rows, flags, code, wording in (
        (0, [], 0, ""), (1, [], 0, ""), (1, ["--no-align-rows"], 0, warning), (4, [], 2, error),
    ):  # fmt: skip
        right = write(tmp_path / f"r{rows}.png", scene[20 + rows : 280 + rows, 32:432])
        out = tmp_path / f"out{rows}{len(flags)}"
        args = [str(left), str(right), "--focal", "300", "--baseline", "0.2", "--out", str(out), "--estimator", "sgbm"]
        assert main([*args, *flags]) == code
        printed = capsys.readouterr()
        assert wording in printed.err and printed.err.count("\n") == bool(wording)
        assert out.exists() == (code == 0)
        aligned = rows == 1 and not flags
        assert ("rows aligned, which lay apart by 1.0" in printed.out) == aligned
        if code == 0:
            fit = json.loads((out / "prediction.json").read_text())["rows_aligned"]
            assert (fit is not None) == aligned
            assert fit is None or (fit["rms_px"] == pytest.approx(1, abs=0.05) and fit["offset_px"] < -0.9)


def test_aligned_rows_give_the_depth_of_a_rectified_pair(tmp_path):
    scene = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 255, (300, 460), dtype=np.uint8), (0, 0), 1.5)
    left = write(tmp_path / "l.png", scene[20:-20, 20:420])
    right = write(tmp_path / "r.png", scene[22:282, 32:432])  # 12 px of disparity, 2 rows too low
    args = [str(left), str(right), "--focal", "300", "--baseline", "0.2", "--estimator", "sgbm"]
    for out, flags in (("aligned", []), ("given", ["--no-align-rows"])):
        assert main([*args, *flags, "--out", str(tmp_path / out)]) == 0
    aligned, given = (np.load(tmp_path / out / "disparity.npy")[8:-8, 20:] for out in ("aligned", "given"))
    assert np.nanmean(np.abs(aligned - 12)) < 0.1 < np.nanmean(np.abs(given - 12))


def test_normals_of_the_sky_are_none(pair, tmp_path):
    predicted = predict(options(pair, tmp_path), Wall())
    normal = np.load(tmp_path / "out/normal.npy")
    assert np.array_equal(normal, predicted.normal)
    none = ~np.isfinite(predicted.depth)
    assert none.sum() == 3 * 61 + 1 and (normal[none] == 0).all() and (normal[~none] == [0, 0, -1]).all()
    assert (cv2.imread(str(tmp_path / "out/normal.png"))[none] == 0).all()


def test_calibration_file_gives_metres_and_principal_point(tmp_path):
    """Middlebury's: the eyes' principal points differ by 3 px, so 8 px of disparity count 11; the cloud is centred at
    the file's point."""
    pair = textured_pair(tmp_path, 8)
    text = "cam0=[100 0 30; 0 110 20; 0 0 1]\ndoffs=3\nbaseline=550\nwidth=90\nheight=60\n"
    (tmp_path / "calib.txt").write_text(text)
    flags = {"focal": None, "baseline": None, "calib": (tmp_path / "calib.txt",)}
    predicted = predict(options(pair, tmp_path, **flags), SGBM())
    assert np.nanmedian(predicted.depth) == pytest.approx(100 * 0.55 / 11, rel=2e-3)
    cloud = trimesh.load(tmp_path / "out/cloud.ply").vertices
    assert cloud[:, 1].min() == pytest.approx(-20 / 110 * 5, abs=0.12)
    assert cloud[:, 0].max() == pytest.approx((89 - 30) / 100 * 5, abs=0.12)
    predicted = predict(options(pair, tmp_path, **{**flags, "baseline": 1.1}), SGBM())
    assert np.nanmedian(predicted.depth) == pytest.approx(100 * 1.1 / 11, rel=2e-3)


def test_a_right_image_that_is_moved_to_the_right_begins_that_much_later(tmp_path, monkeypatch):
    """Its first 6 columns are repeated ones, on which the eyes cannot agree."""
    begins = []
    whole = one_pair.left_right_difference
    monkeypatch.setattr(one_pair, "left_right_difference", lambda *a: begins.append(a[5]) or whole(*a))
    pair = textured_pair(tmp_path, 10)
    text = "cam0=[100 0 30; 0 110 20; 0 0 1]\ndoffs=-6\nbaseline=550\nwidth=90\nheight=60\n"
    (tmp_path / "calib.txt").write_text(text)
    flags = {"focal": None, "baseline": None, "calib": (tmp_path / "calib.txt",), "left_right": True}
    predicted = predict(options(pair, tmp_path, **flags), SGBM())
    assert begins == [6] and np.isnan(predicted.depth[:, : 6 + 3]).all() and np.isfinite(predicted.depth[30, 40])


def test_a_mask_of_a_right_image_that_is_moved_moves_with_it(tmp_path):
    """The eyes of the given images are 10 px apart, and the right one is moved by 6 px to the right."""
    pair = textured_pair(tmp_path, 10)
    (tmp_path / "calib.txt").write_text(
        "cam0=[100 0 30; 0 110 20; 0 0 1]\ndoffs=-6\nbaseline=550\nwidth=90\nheight=60\n"
    )
    shown = np.full((60, 90), 255, np.uint8)
    hidden = shown.copy()
    hidden[:, 40:50] = 0
    masks = (write(tmp_path / "shown.png", shown), write(tmp_path / "hidden.png", hidden))
    flags = {"focal": None, "baseline": None, "calib": (tmp_path / "calib.txt",), "mask": masks}
    unknown = np.isnan(predict(options(pair, tmp_path, **flags), SGBM()).depth)[30, 30:80]
    assert np.flatnonzero(unknown).tolist() == list(range(20, 30))


def test_natecam_by_name_and_a_flag_that_replaces_its_value(tmp_path):
    """As in training: 595.9 px at 512, so 69.8 px at 60."""
    wall = np.random.default_rng(4).integers(0, 255, (60, 90), dtype=np.uint8)
    pair = [write(tmp_path / f"{n}.png", wall[:, n * 8 :][:, :60]) for n in (0, 1)]
    flags = {"focal": None, "baseline": None, "calib": (Path("natecam"),)}
    predicted = predict(options(pair, tmp_path, **flags), SGBM())
    assert np.nanmedian(predicted.depth) == pytest.approx(595.9 * 60 / 512 * 0.27 / 8, rel=2e-3)
    predicted = predict(options(pair, tmp_path, **{**flags, "baseline": 0.54}), SGBM())
    assert np.nanmedian(predicted.depth) == pytest.approx(595.9 * 60 / 512 * 0.54 / 8, rel=2e-3)
    with pytest.raises(ValueError, match="natecam: the images must be square, these are 90 x 60"):
        predict(options(textured_pair(tmp_path, 8), tmp_path, **flags), SGBM())


@pytest.mark.parametrize("shape", [(1, 900), (900, 1), (900, 3)])
def test_images_of_extreme_shape_are_predicted(tmp_path, capsys, shape):
    wall = np.random.default_rng(2).integers(0, 255, (shape[0], shape[1] + 5), dtype=np.uint8)
    pair = [write(tmp_path / f"{x}.png", wall[:, x:][:, : shape[1]]) for x in (0, 5)]
    flags = ["--focal", str(max(20, shape[1])), "--baseline", "0.2", "--estimator", "sgbm", "--unchecked"]
    assert main([*map(str, pair), *flags, "--out", str(tmp_path / "o")]) == 0
    assert "Traceback" not in capsys.readouterr().err
    assert np.load(tmp_path / "o/depth.npy").shape == shape
    assert max(cv2.imread(str(tmp_path / "o/figure.png")).shape) < 5000


@pytest.mark.parametrize(("level", "tone"), [(0, "black"), (90, "of one grey level")])
def test_an_image_without_contrast_is_refused(tmp_path, capsys, level, tone):
    flat = np.full((40, 60), level, np.uint8)
    other = np.random.default_rng(5).integers(0, 255, (40, 60), dtype=np.uint8)
    pair = [write(tmp_path / "a.png", other), write(tmp_path / "b.png", flat)]
    with pytest.raises(ValueError, match=f"b.png is {tone}: there is nothing to match; nothing was written"):
        predict(options(pair, tmp_path), Wall())
    predict(options(pair, tmp_path, unchecked=True), Wall())
    assert tone in capsys.readouterr().err


def test_two_images_of_different_things_are_refused(tmp_path, capsys):
    rng = np.random.default_rng(6)
    smooth = (cv2.GaussianBlur(rng.standard_normal((300, 400)).astype(np.float32), (0, 0), 2) for _ in range(2))
    images = [cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8) for image in smooth]
    arguments = options([write(tmp_path / f"{i}.png", image) for i, image in enumerate(images)], tmp_path, focal=300.0)
    with pytest.raises(ValueError, match=r"match: is it a pair\?; nothing was written"):
        predict(arguments, Wall())
    predict(replace(arguments, unchecked=True), Wall())
    assert "match: is it a pair?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--video"], "--video is of many pairs, and this is a single one"),
        (["--pose-axes", "camera"], "--pose-axes is of the poses in a file: give --poses"),
        (["--mount", "0", "0.0005", "0"], "--mount must be metres ahead, -10 to 10, metres above the ground, 0.001 to"),
    ],
)
def test_flags_that_a_single_pair_cannot_use_are_refused(tmp_path, capsys, flags, message):
    pair = map(str, textured_pair(tmp_path, 8))
    assert main([*pair, "--focal", "60", "--baseline", "0.3", "--out", str(tmp_path / "o"), *flags]) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("sizes", "both images of a rectified pair must have the same size"),
        ("broken", "broken.png: not a readable image"),
        ("empty", "empty.png: not a readable image"),
        ("missing", "missing.png: no such file"),
        ("focal", "--focal must be positive"),
        ("millimetres", "--focal 4.6 px makes images of 61 px 163 deg wide; it is counted in pixels"),
        ("wide", "--baseline 12 m is out of [0.001, 10] m"),
        ("third", "third.txt: a pair has two calibration files at most"),
        ("confidence", "--min-confidence must be 0 to 1, got 7"),
        ("confidence nan", "--min-confidence must be 0 to 1, got nan"),
        ("range", "--max-range must be positive, got -1"),
        ("baseline", "--baseline 200 m is out of [0.001, 10] m; give --baseline in metres"),
        ("centre", "--cx must be finite"),
        ("centre far off", "--cy 999 px lies far outside of images of 61 x 45 px"),
        ("no focal", "--focal is missing: give it, or a calibration file with --calib"),
        ("calib", "calib.txt: is for images of 90 x 60 px"),
        ("unit", "calib.txt: baseline 0.00012 m is out of"),
        ("weights", "w.safetensors: no such weights file; give a weights.safetensors that m3depth.train wrote"),
        ("weights by name", "v.safetensors: no such weights file"),
        ("weights of another", "--weights is of m3depth, not of --estimator sgbm"),
        ("weights folder", "is a folder, not a weights file"),
        ("image folder", "is a folder, not a file"),
        ("dataset", "set: is a dataset; choose another folder"),
        ("no number", "--focal must be a number, got 'abc'"),
        ("nearest", "--nearest must lie in [0.01, 1000] m, got -1"),
        ("nearest to nothing", "--nearest must lie in [0.01, 1000] m, got 1e-300"),
        ("pixels", "--max-pixels must be at least 2048, got 0"),
        ("not its own", "--nearest: --estimator sgbm takes no such setting"),
        ("method", "--estimator 'raft' is unknown; choose from m3depth, sgbm"),
        ("no steps", "--steps: sgbm has no maps of refinement steps; leave it out"),
        ("steps elsewhere", "--steps runs in PyTorch: leave out --runtime openvino"),
        ("out", "is not a folder"),
    ],
)
def test_mistakes_exit_with_2_and_one_line(pair, tmp_path, capsys, case, message):
    left, right = map(str, pair)
    extra: list[str] = []
    focal, baseline, out = ["--focal", "80"], ["--baseline", "0.2"], tmp_path / "out"
    if case == "sizes":
        right = str(write(tmp_path / "small.png", np.zeros((9, 9), np.uint8)))
    elif case in ("broken", "empty"):
        (tmp_path / f"{case}.png").write_bytes(b"no image" if case == "broken" else b"")
        right = str(tmp_path / f"{case}.png")
    elif case == "missing":
        left = str(tmp_path / "missing.png")
    elif case == "focal":
        focal = ["--focal", "-1"]
    elif case == "millimetres":
        focal = ["--focal", "4.6"]
    elif case == "baseline":
        baseline = ["--baseline", "200"]
    elif case == "wide":
        baseline = ["--baseline", "12"]
    elif case == "third":
        extra = ["--calib", *(str(tmp_path / f"{name}.txt") for name in ("first", "second", "third"))]
    elif case.startswith("confidence"):
        extra = ["--min-confidence", "nan" if "nan" in case else "7"]
    elif case == "range":
        extra = ["--max-range", "-1"]
    elif case == "centre":
        extra = ["--cx", "nan"]
    elif case == "centre far off":
        extra = ["--cy", "999"]
    elif case == "no focal":
        focal = []
    elif case in ("calib", "unit"):
        focal, baseline, extra = [], [], ["--calib", str(tmp_path / "calib.txt")]
        size = "width=90\nheight=60\n" if case == "calib" else ""
        (tmp_path / "calib.txt").write_text(f"cam0=[80 0 30; 0 80 20; 0 0 1]\nbaseline=0.12\n{size}")
    elif case == "weights":
        extra = ["--weights", str(tmp_path / "w.safetensors")]
    elif case == "weights by name":
        extra = ["--estimator", f"m3depth:{tmp_path / 'v.safetensors'}"]
    elif case == "weights of another":
        extra = ["--weights", str(tmp_path / "w.safetensors"), "--estimator", "sgbm"]
    elif case == "weights folder":
        extra = ["--weights", str(tmp_path)]
    elif case == "image folder":
        left = str(tmp_path)
    elif case == "dataset":
        out = tmp_path / "set"
        (out / "scenes").mkdir(parents=True)
        (out / "generate.json").write_text("{}")
    elif case == "no number":
        focal = ["--focal", "abc"]
    elif case == "nearest":
        extra = ["--nearest", "-1"]
    elif case == "nearest to nothing":
        extra = ["--nearest", "1e-300"]
    elif case == "pixels":
        extra = ["--max-pixels", "0"]
    elif case == "not its own":
        extra = ["--nearest", "2", "--estimator", "sgbm"]
    elif case == "no steps":
        extra = ["--steps", "--estimator", "sgbm"]
    elif case == "steps elsewhere":
        extra = ["--steps", "--runtime", "openvino"]
    elif case == "method":
        extra = ["--estimator", "raft"]
    else:
        out.write_text("a file")
    assert main([left, right, *focal, *baseline, "--out", str(out), *extra]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_pixels_that_the_other_eye_contradicts_lose_their_confidence(plane_samples, tmp_path, capsys):
    """On a plane, SGBM finds the same disparity from either eye where both see it."""
    sample = plane_samples[0]
    left, right = (write(tmp_path / f"{name}.png", getattr(sample, name)) for name in ("left", "right"))
    flags = [str(left), str(right), "--focal", str(sample.rig.camera.fx), "--baseline", str(sample.rig.baseline),
             "--estimator", "sgbm", "--out", str(tmp_path / "out")]  # fmt: skip
    assert main([*flags, "--left-right"]) == 0
    printed = capsys.readouterr().out
    share = float(re.search(r"the eyes agree within 1 px on ([\d.]+) % of what is compared", printed)[1])
    difference, confidence = (np.load(tmp_path / "out" / f"{name}.npy") for name in ("left_right", "confidence"))
    record = json.loads((tmp_path / "out/prediction.json").read_text())
    assert record["eyes_agree_share"] == pytest.approx(share / 100, abs=1e-3)
    depth = np.load(tmp_path / "out/depth.npy")
    assert record["depth_m"]["percentile_50"] == pytest.approx(np.nanmedian(depth), rel=1e-3)
    assert record["share_with_depth"] == pytest.approx(np.isfinite(depth).mean(), abs=1e-3)
    assert share > 95 and difference.shape == confidence.shape
    assert (confidence[~(difference <= 1)] == 0).all() and (confidence > 0).any() and np.isnan(difference[:, 0]).all()
    assert main(flags) == 0
    assert "agree" not in capsys.readouterr().out and not (tmp_path / "out" / "left_right.npy").exists()


def test_normals_of_an_earlier_run_do_not_stay_beside_a_prediction_without(pair, tmp_path):
    class Bare(Wall):
        def infer(self, left, right, rig):
            return replace(super().infer(left, right, rig), normal=None)

    predict(options(pair, tmp_path), Wall())
    predict(options(pair, tmp_path), Bare())
    assert not [path.name for path in (tmp_path / "out").iterdir() if path.name.startswith("normal")]


def test_files_that_are_of_no_prediction_are_not_replaced(pair, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("notes.txt", "figure.png"):
        (out / name).write_text("mine")
    with pytest.raises(ValueError, match=r"out: its figure\.png would be replaced, and no prediction\.json says"):
        predict(options(pair, tmp_path, write=("depth",)), Wall())
    assert sorted(path.name for path in out.iterdir()) == ["figure.png", "notes.txt"]
    (out / "figure.png").unlink()
    predict(options(pair, tmp_path, write=("depth",)), Wall())
    assert "% of the pixels\n" in capsys.readouterr().out  # no points are counted without a cloud
    assert (out / "notes.txt").read_text() == "mine" and (out / "depth.npy").is_file()


def test_a_killed_prediction_starts_over_and_a_new_one_says_what_it_deletes(pair, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"

    def killed(*arguments):
        raise SystemExit

    with monkeypatch.context() as patched, pytest.raises(SystemExit):
        patched.setattr("m3depth.prediction.files.prediction_figure", killed)
        predict(options(pair, tmp_path), Wall())
    assert (out / "cloud.ply").is_file() and "rig" not in json.loads((out / "prediction.json").read_text())
    predict(options(pair, tmp_path), Wall())
    assert "rig" in json.loads((out / "prediction.json").read_text())
    capsys.readouterr()
    predict(options(pair, tmp_path, write=("depth", "normal"), map_format=("npy",)), Wall())
    deleted = (
        "depth.png, disparity.npy, disparity.png, normal.png, confidence.npy, confidence.png, sky.png, cloud.ply, "
        "figure.png"
    )
    assert capsys.readouterr().err.splitlines()[-1] == f"note: {out}: deleted {deleted} of the earlier prediction"


def test_a_missing_gpu_is_one_line(pair, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    words = [*map(str, pair), "--focal", "80", "--baseline", "0.2", "--out", str(tmp_path / "out"), "--device", "cuda"]
    assert main(words) == 2
    printed = capsys.readouterr().err.strip()
    assert printed.endswith("--device cuda: no GPU was found; choose cpu or auto") and "\n" not in printed


def test_a_full_disk_is_reported_and_leaves_no_half_written_file(pair, tmp_path, capsys, monkeypatch):
    out, files = tmp_path / "out", []

    def full(file):
        files.append(file)
        if len(files) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    assert main([*map(str, pair), "--focal", "80", "--baseline", "0.2", "--out", str(out), "--estimator", "sgbm"]) == 2
    message = f"error: --out {out}: {out / 'depth.png'}: no space left on device\n"
    assert capsys.readouterr().err.endswith(message)
    assert sorted(file.name for file in out.iterdir()) == ["depth.npy", "prediction.json"]
    assert "rig" not in json.loads((out / "prediction.json").read_text())


def test_pixels_that_a_mask_hides_do_not_count_to_the_share_that_agrees(plane_samples, tmp_path, capsys, monkeypatch):
    """Where the right image shows something else, the eyes disagree, and here the method is less sure."""
    sample, infer = plane_samples[0], SGBM.infer

    def doubting(self, left, right, rig, **settings):
        prediction = infer(self, left, right, rig, **settings)
        prediction.confidence[half:] *= 0.5
        return prediction

    monkeypatch.setattr(SGBM, "infer", doubting)
    half, noise = len(sample.left) // 2, np.random.default_rng(0).integers(0, 256, sample.left.shape, dtype=np.uint8)
    right_image, valid = sample.right.copy(), np.full(sample.left.shape[:2], 255, np.uint8)
    right_image[half:], valid[half:] = noise[half:], 0
    left, right = write(tmp_path / "left.png", sample.left), write(tmp_path / "right.png", right_image)
    flags = [str(left), str(right), "--focal", str(sample.rig.camera.fx), "--baseline", str(sample.rig.baseline),
             "--estimator", "sgbm", "--unchecked", "--left-right", "--no-align-rows"]  # fmt: skip
    mask = write(tmp_path / "mask.png", np.repeat(valid[..., None], 3, axis=2))
    shares = []
    for number, more in enumerate(([], ["--mask", str(mask)], ["--min-confidence", "0.9"])):
        out = tmp_path / f"out{number}"
        assert main([*flags, "--out", str(out), *more]) == 0
        shares.append(json.loads((out / "prediction.json").read_text())["eyes_agree_share"])
    assert shares[0] < 0.995 < 0.999 < shares[1]
    assert shares[2] == shares[0]  # a limit of the confidence is no mask: what both eyes see stays the same
