"""The photometric residual of known disparities over that of SGBM, and of the command."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from m3depth.stereo.prediction import Prediction
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.files.json_file import read_json

RIG = StereoRig(PinholeCamera(192, 128, 150.0, 150.0, 95.5, 63.5), 0.27)
SHIFT = 6  # [px]


def wall(seed: int) -> SimpleNamespace:
    """A textured wall and its true disparity, in images with noise."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (128, 192, 3)).astype(np.float32), (0, 0), 1.5)
    texture = 128 + 4 * (texture - texture.mean())
    left, right = (
        np.clip(image + rng.normal(0, 4, texture.shape), 0, 255).astype(np.uint8)
        for image in (texture, np.roll(texture, -SHIFT, 1))
    )
    return SimpleNamespace(left=left, right=right, rig=RIG, disparity=np.full((128, 192), SHIFT, np.float32))


class Off:
    """An estimator that is half a pixel off, and knows nothing of the upper half."""

    def infer(self, left, right, rig):
        disparity = np.full(left.shape[:2], SHIFT + 0.5, np.float32)
        disparity[:64] = np.nan
        return Prediction(rig.fb / disparity, disparity, None, np.ones_like(disparity))


class Pairs(list):
    names = tuple(f"{n:05}/00" for n in range(4))
    scenes = tuple(f"{n:05}" for n in range(4))


def test_the_truth_explains_the_images_better_than_half_a_pixel_beside_it(photometric_residual):
    ratio_of = photometric_residual.ratios(wall(0), {"off": Off()})
    assert 0.9 < ratio_of["truth"] < 1.1 < ratio_of["off"]


def test_the_command_writes_a_row_for_each_dataset(photometric_residual, tmp_path, capsys, monkeypatch):
    pairs = Pairs([wall(n) for n in range(4)])
    monkeypatch.setattr(photometric_residual, "open_pairs", lambda folder, split, reader: pairs)
    out = tmp_path / "out"
    assert photometric_residual.main(["--data", "a", "b/c", "--estimator", "sgbm", "--out", str(out)]) == 0
    record = read_json(out / "residual.json")
    assert record["estimators"] == {"SGBM": {"name": "sgbm", "sha256": None}} and record["runtime"] is None
    assert "numpy" in record["versions"]
    content = record["datasets"]
    assert [(row["data"], row["pairs"], row["scenes"]) for row in content] == [("a", 4, 4), ("b/c", 4, 4)]
    assert content[0]["methods"]["SGBM"]["ratio"] == pytest.approx(1, abs=0.05)
    low, high = content[0]["methods"]["truth"]["interval"]
    assert low <= content[0]["methods"]["truth"]["ratio"] <= high
    table = (out / "residual.md").read_text()
    assert table == capsys.readouterr().out and table.startswith("| pairs | SGBM | truth |") and "| c | " in table


def test_the_truth_is_that_of_the_aligned_pair(photometric_residual, monkeypatch):
    pair = wall(0)
    pair.depth, pair.disparity = np.full((128, 192), RIG.fb / SHIFT), pair.disparity + 1.5  # of the given right image
    straight, aligned = pair.right, photometric_residual.ratios(wall(0), {})["truth"]
    pair.right = np.roll(straight, 2, 0)
    assert photometric_residual.ratios(pair, {})["truth"] > 1.1
    monkeypatch.setattr(photometric_residual, "align_rows", lambda left, right, rig: (straight, "a fit"))
    assert photometric_residual.ratios(pair, {})["truth"] == aligned


def test_pairs_of_three_scenes_have_no_interval(photometric_residual, tmp_path, capsys, monkeypatch):
    pairs = Pairs([wall(n) for n in range(4)])
    pairs.scenes = ("00000", "00000", "00001", "00002")
    monkeypatch.setattr(photometric_residual, "open_pairs", lambda folder, split, reader: pairs)
    assert photometric_residual.main(["--data", "a", "--estimator", "sgbm", "--out", str(tmp_path / "out")]) == 0
    (row,) = read_json(tmp_path / "out/residual.json")["datasets"]
    assert row["scenes"] == 3 and row["methods"]["truth"]["interval"] is None
    assert "(" not in capsys.readouterr().out


def test_a_pair_without_a_shared_pixel_is_left_out(photometric_residual, tmp_path, monkeypatch):
    class Once:
        """Knows the first pair alone."""

        def infer(self, left, right, rig):
            disparity = np.full(left.shape[:2], SHIFT if np.array_equal(left, wall(0).left) else np.nan, np.float32)
            return Prediction(rig.fb / disparity, disparity, None, np.ones_like(disparity))

    pairs, options = Pairs([wall(0), wall(1)]), photometric_residual.Options((tmp_path,), tmp_path)
    monkeypatch.setattr(photometric_residual, "open_pairs", lambda folder, split, reader: pairs)
    of_once = photometric_residual.measure(tmp_path, options, {"once": Once()})["methods"]["once"]
    assert of_once["ratio"] == pytest.approx(photometric_residual.ratios(wall(0), {})["truth"])
    pairs.pop(0), pairs.append(wall(2))
    with pytest.raises(ValueError, match="once and SGBM measure no pixel together in any pair"):
        photometric_residual.measure(tmp_path, options, {"once": Once()})


def test_an_empty_split_is_one_line(photometric_residual, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(photometric_residual, "open_pairs", lambda folder, split, reader: Pairs())
    assert photometric_residual.main(["--data", "a", "--out", str(tmp_path / "out")]) == 2
    assert "--data a: split test holds no pairs" in capsys.readouterr().err
