"""Scores without true depth: exact where the answer is known, and the command from patterns to the table."""

import json

import cv2
import numpy as np
import pytest

from m3depth.datasets.config import DataConfig
from m3depth.estimator import EstimatorName
from m3depth.evaluate import main
from m3depth.evaluation.without_truth import run, scoring
from m3depth.evaluation.without_truth.pairs import PairImages, image_pairs
from m3depth.evaluation.without_truth.scoring import means, predictions_of, score_pair, table
from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction
from m3depth.wrapped_estimators import FilledEstimator
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.files.json_file import DatasetError
from tests.m3depth.turned_pairs import RIG, slope, slope_disparity


class Truth:
    """Returns the true disparity of a plane plus an error, in the left image and in the mirrored right one."""

    def __init__(self, sample, error: float = 0.0) -> None:
        self.sample, self.error = sample, error

    def infer(self, left, right, rig):
        s = self.sample
        disparity = s.disparity + np.float32(self.error) * np.isfinite(s.depth)
        if not np.array_equal(left, s.left):  # the right eye, mirrored: the plane as it sees it
            rays = s.rig.camera.rays()
            normal, known = s.normal[np.isfinite(s.depth)][0], np.isfinite(s.depth)
            height = float((s.depth[..., None] * rays @ normal)[known].mean())
            of_right = height - normal[0] * s.rig.baseline
            facing = rays @ normal / of_right
            disparity = np.where(facing > 0, s.rig.fb * facing, 0).astype(np.float32)[:, ::-1]
        depth = rig.disparity_to_depth(disparity)
        return Prediction(depth, disparity, None, np.ones(depth.shape, np.float32))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, plane_samples):
    root = tmp_path_factory.mktemp("images")
    for number, sample in enumerate(plane_samples[:2]):
        for eye in ("left", "right"):
            (root / eye).mkdir(exist_ok=True)
            cv2.imwrite(str(root / eye / f"{number}.png"), getattr(sample, eye)[..., ::-1])
    return root


def command(folder, out, *more) -> list[str]:
    return ["--data", str(folder), "--left", "left/*.png", "--right", "right/*.png", "--focal", "100", "--baseline",
            "0.27", "--out", str(out), *more]  # fmt: skip


def test_the_truth_agrees_and_explains_more_than_an_answer_that_is_off(plane_samples):
    s = plane_samples[0]
    scores = score_pair({"truth": Truth(s), "off": Truth(s, 2.0), "sgbm": SGBM()}, PairImages(s.left, s.right, s.rig))
    assert scores["truth"]["agreement"] > 0.95 and scores["off"]["agreement"] < 0.05
    assert scores["truth"]["residual"] < 0.5 * scores["off"]["residual"]
    assert scores["sgbm"]["residual_ratio"] == pytest.approx(1) and scores["off"]["residual_ratio"] > 2
    sky = float(np.isinf(s.depth).mean())
    assert scores["truth"]["sky"] == pytest.approx(sky) and scores["truth"]["unknown"] == 0
    assert scores["sgbm"]["sky"] == 0 and scores["sgbm"]["unknown"] > 0.05  # what it only filled


class Half(Truth):
    """Wrong in the lower half of the image, or silent there."""

    def __init__(self, sample, silent: bool) -> None:
        super().__init__(sample)
        self.silent, self.sample = silent, sample

    def infer(self, left, right, rig):
        out = super().infer(left, right, rig)
        depth, disparity = out.depth.copy(), out.disparity.copy()
        lower, nan = np.s_[depth.shape[0] // 2 :], np.float32(np.nan)
        if self.silent:
            depth[lower] = disparity[lower] = nan
        elif np.array_equal(left, self.sample.left):
            disparity[lower] += 3
        return Prediction(depth, disparity, None, out.confidence)


def test_pixels_that_a_mask_hides_do_not_count(plane_samples):
    s = plane_samples[0]
    upper = np.arange(s.left.shape[0])[:, None] < s.left.shape[0] // 2
    shown = np.broadcast_to(upper, s.left.shape[:2])
    methods = {"wrong": Half(s, False), "silent": Half(s, True), "truth": Truth(s)}
    for masks in ((shown, None), (shown, shown)):
        scores = score_pair(methods, PairImages(s.left, s.right, s.rig, 0.0, *masks))
        for name in ("agreement", "residual", "sky", "unknown"):
            assert scores["wrong"][name] == scores["silent"][name] == scores["truth"][name]
        assert scores["truth"]["sky"] == pytest.approx(np.isinf(s.depth[shown]).mean())
        assert scores["truth"]["unknown"] == 0
    scores = score_pair(methods, PairImages(s.left, s.right, s.rig, 0.0, None, shown))
    for name in ("agreement", "residual"):  # rows are the same in both images
        assert scores["wrong"][name] == scores["silent"][name] == scores["truth"][name]
    assert scores["silent"]["unknown"] == pytest.approx(0.5, abs=0.01) and scores["truth"]["unknown"] == 0
    nothing = score_pair(methods, PairImages(s.left, s.right, s.rig, 0.0, ~shown & shown))
    assert set(nothing["truth"]) == {"seconds"}


def test_the_masks_beside_the_images_are_read(folder, tmp_path):
    for eye in ("left", "right"):
        (tmp_path / eye).mkdir()
        image = cv2.imread(str(folder / eye / "0.png"))
        valid = np.full(image.shape[:2], 255, np.uint8)
        valid[: len(valid) // 4] = image[: len(image) // 4] = 0
        cv2.imwrite(str(tmp_path / eye / "0.png"), image)
        cv2.imwrite(str(tmp_path / eye / "0_valid.png"), valid)
    (pair,) = image_pairs(tmp_path, DataConfig(left="left/*.png", right="right/*.png", focal=100, baseline=0.27))
    images = pair.read()
    np.testing.assert_array_equal(images.left_valid, valid > 0)
    filled = images.without_upper_margins().left  # so that the sky meets the border
    assert (filled[: len(valid) // 4] == filled[len(valid) // 4]).all() and not images.left[: len(valid) // 4].any()
    assert [path.name for path in pair.files] == ["0.png", "0.png", "0_valid.png", "0_valid.png"]
    (tmp_path / "left/0_valid.png").write_bytes(b"no picture")
    with pytest.raises(DatasetError, match=r"left/0_valid\.png"):
        pair.read()


def test_wide_images_are_scored_though_sgbm_does_not_search_all_of_their_width():
    left, right = np.zeros((2, 40, 2200), np.uint8)
    rig = StereoRig(PinholeCamera.centred(2200, 40, 5000.0), 0.42)
    scores = score_pair({"sgbm": SGBM(disparities=160)}, PairImages(left, right, rig))["sgbm"]
    assert scores["unknown"] == 1 and "residual" not in scores


def test_the_alignment_of_the_rows_counts_to_the_time(plane_samples, monkeypatch):
    s, images, seconds = plane_samples[0], PairImages, [0.0]

    def slow(self):
        seconds[0] += 100
        return self

    monkeypatch.setattr(images, "aligned", slow)
    monkeypatch.setattr("m3depth.evaluation.cost.time.perf_counter", lambda: seconds[0])
    pair = images(s.left, s.right, s.rig)
    assert score_pair({"truth": Truth(s)}, pair, align=True)["truth"]["seconds"] == 100
    assert score_pair({"truth": Truth(s)}, pair)["truth"]["seconds"] == 0


def test_a_method_that_stays_silent_gains_nothing_on_common_pixels(plane_samples):
    s = plane_samples[0]
    scores = score_pair({"wrong": Half(s, False), "silent": Half(s, True)}, PairImages(s.left, s.right, s.rig))
    assert scores["wrong"]["agreement"] < 0.7 < 0.95 < scores["silent"]["agreement"]
    assert scores["wrong"]["common_agreement"] == scores["silent"]["common_agreement"] > 0.95


def test_means_leave_out_pairs_without_a_score_and_the_table_shows_it():
    records = [{"a": {"agreement": 0.5, "sky": 0.2}}, {"a": {"sky": 0.4}}]
    assert means(records, ["a"]) == {"a": {"agreement": 0.5, "sky": pytest.approx(0.3)}}
    text = table(means(records, ["a"]), markdown=True)
    assert text.splitlines()[2] == "| a | 50.0 | - | - | - | 30.0 | - | - |"


def test_the_command_scores_images_alone_and_continues(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("m3depth.evaluation.command.methods.named_estimators", classical)
    assert main(command(folder, tmp_path / "out")) == 0
    printed = capsys.readouterr().out
    assert "eyes agree" in printed and "2 pairs without true depth" in printed
    results = json.loads((tmp_path / "out/results.json").read_text())
    assert results["methods"].keys() == {"SGBM", "SAD"}
    assert [record["pair"] for record in results["per_pair"]] == ["left/0", "left/1"]
    page = (tmp_path / "out/results.md").read_text()
    assert "| left/1 |" in page and "](qualitative.png)" in page
    assert cv2.imread(str(tmp_path / "out/qualitative.png")).std() > 20
    assert not (tmp_path / "out/unfinished.npz").exists()

    calls = []
    scored = run.score_pair

    def stopped(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return scored(*arguments)

    monkeypatch.setattr("m3depth.evaluation.resume.SECONDS", 0.0)
    monkeypatch.setattr(run, "score_pair", stopped)
    assert main(command(folder, tmp_path / "parts")) == 130
    again_calls = []
    monkeypatch.setattr(run, "score_pair", lambda *arguments: again_calls.append(1) or scored(*arguments))
    assert main(command(folder, tmp_path / "parts")) == 0 and len(again_calls) == 1
    again = json.loads((tmp_path / "parts/results.json").read_text())
    for record, other in zip(results["per_pair"], again["per_pair"], strict=True):
        for name in ("SGBM", "SAD"):
            assert {**record[name], "seconds": 0} == {**other[name], "seconds": 0}


def test_a_run_that_is_stopped_while_it_draws_keeps_its_scores(folder, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("m3depth.evaluation.command.methods.named_estimators", classical)
    with monkeypatch.context() as patch:
        patch.setattr("m3depth.figures.side_by_side.draw_side_by_side", stopped)
        assert main(command(folder, tmp_path / "out")) == 130
    monkeypatch.setattr(run, "score_pair", stopped)
    assert main(command(folder, tmp_path / "out")) == 0
    assert (tmp_path / "out/qualitative.png").exists() and not (tmp_path / "out/unfinished.npz").exists()


def test_a_stopped_run_is_not_continued_with_other_baselines(folder, tmp_path, capsys, monkeypatch):
    scores = [{"SGBM": {}, "SAD": {}}]

    def stopped(*arguments):
        if scores:
            return scores.pop()
        raise KeyboardInterrupt

    names = {"SGBM": ("--baselines", EstimatorName("sgbm")), "SAD": ("--estimator", EstimatorName("sad"))}
    monkeypatch.setattr("m3depth.evaluation.command.methods.named_estimators", lambda options: names)
    monkeypatch.setattr("m3depth.evaluation.resume.SECONDS", 0.0)
    monkeypatch.setattr(run, "score_pair", stopped)
    assert main(command(folder, tmp_path / "out")) == 130
    del names["SGBM"]
    capsys.readouterr()
    assert main(command(folder, tmp_path / "out")) == 2
    assert "belongs to an unfinished evaluation with another --baselines; choose" in capsys.readouterr().err


def classical(options):
    """SGBM and one more, without the network, whose loading takes seconds."""
    return {"SGBM": ("--baselines", EstimatorName("sgbm")), "SAD": ("--baselines", EstimatorName("sad"))}


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--degrade", "blur=1"], "--degrade is for pairs with true depth"),
        (["--predictions", "A=x"], "--predictions is for pairs with true depth"),
        (["--split", "val"], "--split is for pairs with true depth"),
        (["--seed", "1"], "--seed is for pairs with true depth"),
        (["--max-disparity", "384"], "--max-disparity is for pairs with true depth"),
        (["--resize", "0.5"], "--resize is for pairs with true depth"),
    ],
)
def test_flags_of_pairs_with_truth_are_refused(folder, tmp_path, capsys, more, message):
    assert main(command(folder, tmp_path / "out", *more)) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1 and not (tmp_path / "out").exists()


def test_a_class_that_is_not_found_is_named_with_its_flag(folder, tmp_path, capsys, monkeypatch):
    names = {"Net": ("--estimator", EstimatorName("nowhere.stereo:Net"))}
    monkeypatch.setattr("m3depth.evaluation.command.methods.named_estimators", lambda options: names)
    assert main(command(folder, tmp_path / "out")) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: --estimator 'nowhere.stereo:Net': No module named 'nowhere'; run python -m in the")
    assert error.count("\n") == 1 and not (tmp_path / "out").exists()


TAKEN_OUT = 200.0  # [px] of all disparities, in images of 320 px


def write_rectified(folder, name="", scale=1.0, **rig):
    """A pair as m3depth.rectify writes it, of cameras that are turned towards each other."""
    (folder / name).mkdir(parents=True, exist_ok=True)
    for eye, image in zip(("left", "right"), slope(), strict=True):
        image = cv2.resize(image, None, fx=scale, fy=scale)
        cv2.imwrite(str(folder / name / f"{eye}.png"), image)
    scaled = RIG.resized(image.shape[1], image.shape[0])
    content = {**scaled.to_dict(), "shift": TAKEN_OUT * scale, **rig}
    (folder / name / "rig.json").write_text(json.dumps(content))
    return folder / name


@pytest.mark.usefixtures("undrawn_figures")
def test_a_common_disparity_stays_out_of_the_images_as_in_a_prediction(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("m3depth.evaluation.command.methods.named_estimators", classical)
    pair = write_rectified(tmp_path)
    images = ["--data", str(tmp_path), "--left", "left.png", "--right", "right.png"]
    assert main([*images, "--calib", str(pair / "rig.json"), "--out", str(tmp_path / "out")]) == 0
    results = json.loads((tmp_path / "out/results.json").read_text())["methods"]
    assert results["SGBM"]["unknown"] < 0.4 and results["SGBM"]["agreement"] > 0.95


def test_depth_and_the_nearest_one_are_those_with_the_common_disparity():
    asked = []

    class Network(SGBM):
        def infer(self, left, right, rig, nearest=None):
            asked.append(nearest)
            return super().infer(left, right, rig)

    images = PairImages(*slope(), RIG, TAKEN_OUT)
    methods = {"network": Network(), "filled": FilledEstimator(Network())}
    depth = predictions_of(methods, images)["network"].depth
    expected = RIG.fb / (slope_disparity(RIG) + TAKEN_OUT)
    assert np.nanmedian(np.abs(depth / expected - 1)) < 0.005
    score_pair(methods, images)
    assert len(asked) == 6 and set(asked) == {RIG.fb}  # 0.84 m lies farther off than all that the images show


@pytest.mark.usefixtures("undrawn_figures")
def test_each_pair_has_the_rig_beside_it_and_pairs_of_two_cameras_are_scored(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("m3depth.evaluation.command.methods.named_estimators", classical)
    write_rectified(tmp_path, "a/rectified")
    write_rectified(tmp_path, "b/rectified", 0.75)
    images = ["--data", str(tmp_path), "--left", "*/rectified/left.png", "--right", "*/rectified/right.png"]
    assert main([*images, "--out", str(tmp_path / "out")]) == 0
    records = json.loads((tmp_path / "out/results.json").read_text())["per_pair"]
    assert [record["pair"] for record in records] == ["a/rectified/left", "b/rectified/left"]
    assert all(record["SGBM"]["agreement"] > 0.9 for record in records)

    def never(*arguments):
        raise AssertionError("a pair is scored")

    capsys.readouterr()
    monkeypatch.setattr(run, "score_pair", never)
    calib = tmp_path / "a/rectified/rig.json"
    assert main([*images, "--calib", str(calib), "--out", str(tmp_path / "other")]) == 2
    line = f"error: {calib}: is for 320 x 256 px, {tmp_path}/b/rectified/left.png is 240 x 192\n"
    assert capsys.readouterr().err == line and not (tmp_path / "other").exists()
    (tmp_path / "b/rectified/rig.json").unlink()
    assert main([*images, "--out", str(tmp_path / "other")]) == 2
    assert f"or a rig.json beside each: {tmp_path}/b/rectified has none" in capsys.readouterr().err


def test_a_calibration_of_raw_cameras_does_not_ask_for_the_flag_that_gave_it(folder, tmp_path, capsys):
    matrix = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [100, 0, 47, 0, 100, 31, 0, 0, 1]\n"
    (tmp_path / "stereo.yml").write_text(f"%YAML:1.0\n---\nK1: {matrix}K2: {matrix}")
    words = ["--data", str(folder), "--left", "left/*.png", "--right", "right/*.png", "--out", str(tmp_path / "out")]
    assert main([*words, "--calib", str(tmp_path / "stereo.yml")]) == 2
    error = capsys.readouterr().err
    assert error.endswith("rectify the images first (m3depth.predict --rectify always, or m3depth.rectify)\n")


def test_the_eyes_are_compared_where_a_moved_right_image_shows_something(monkeypatch):
    begins = []
    whole = scoring.left_right_difference
    monkeypatch.setattr(scoring, "left_right_difference", lambda *a: begins.append(a[5]) or whole(*a))
    score_pair({"SGBM": SGBM()}, PairImages(*slope(), RIG, moved=-6.0))
    assert begins == [6]
