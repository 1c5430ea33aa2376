"""The error after each refinement step: of known maps, and of the command."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from small_network import SMALL

from m3depth.evaluation.bootstrap import interval, resampled_means
from m3depth.network.model import M3Depth
from m3depth.stereo.prediction import StepMap
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.files.json_file import read_json

RIG = StereoRig(PinholeCamera(128, 64, 90.0, 90.0, 63.5, 31.5), 0.27)


def truth(disparity: float, occluded_columns: int) -> SimpleNamespace:
    """A wall, of which the right camera does not see the first columns, in images of noise."""
    shape = RIG.camera.height, RIG.camera.width
    images = np.random.default_rng(0).integers(0, 256, (2, *shape, 3), dtype=np.uint8)
    occluded = np.zeros(shape, dtype=bool)
    occluded[:, :occluded_columns] = True
    return SimpleNamespace(
        left=images[0], right=images[1], rig=RIG, depth=np.full(shape, RIG.fb / disparity, np.float32),
        disparity=np.full(shape, disparity, np.float32), occluded=occluded, valid=np.ones(shape, dtype=bool),
        rock=np.zeros(shape, dtype=np.int32), surface=np.zeros(shape, dtype=np.int32),
    )  # fmt: skip


class Pairs(list):
    """Pairs of two scenes."""

    names = ("00000/00", "00000/01", "00001/00")
    scenes = ("00000", "00000", "00001")


@pytest.fixture
def pairs(refinement_steps, monkeypatch) -> Pairs:
    """Three pairs, which the command reads from any folder."""
    pairs = Pairs([truth(6, 10), truth(8, 0), truth(12, 20)])
    monkeypatch.setattr(refinement_steps, "open_pairs", lambda folder, split, reader: pairs)
    return pairs


def test_errors_of_known_maps_by_kind_of_pixel(refinement_steps):
    sample = truth(6, 10)
    disparity = np.where(sample.occluded, 4.0, 6.5)
    assert refinement_steps.errors(disparity, sample) == pytest.approx([0.5, 2.0])
    disparity[:, 10:] = np.nan  # as a disparity of 0
    assert refinement_steps.errors(disparity, sample) == pytest.approx([6.0, 2.0])
    visible, occluded = refinement_steps.errors(disparity, truth(6, 0))
    assert visible == pytest.approx((6 * 118 + 2 * 10) / 128) and np.isnan(occluded)


def test_means_leave_out_pairs_without_such_pixels(refinement_steps):
    rows = np.array([[1.0, 4.0], [2.0, np.nan], [6.0, 8.0], [3.0, 5.0], [3.0, 7.0]])
    means = refinement_steps.summary(rows, list("aabcd"))
    assert means["non-occluded"]["epe_px"] == 3 and means["occluded"]["epe_px"] == 6
    known = rows[[0, 2, 3, 4], 1]
    assert means["occluded"]["interval"] == interval(resampled_means(known), 6.0, 4, within=(0, np.inf))
    three_scenes = refinement_steps.summary(rows, list("aabcc"))["occluded"]
    assert three_scenes["interval"] is None and three_scenes["epe_px"] == means["occluded"]["epe_px"]
    assert refinement_steps.summary(rows[1:2], ["a"])["occluded"] == {"epe_px": None, "interval": None}


def test_the_command_writes_the_error_after_each_step_of_each_network(refinement_steps, pairs, tmp_path, capsys):
    for name, steps in (("two", 2), ("three", 3)):
        torch.manual_seed(0)
        M3Depth(replace(SMALL, refine_steps=steps)).save_pretrained(tmp_path / f"{name}.safetensors")
    weights = [str(tmp_path / f"{name}.safetensors") for name in ("two", "three")]
    out = tmp_path / "out"
    assert refinement_steps.main(["--data", "any", "--split", "all", "--out", str(out), "--weights", *weights]) == 0
    record = read_json(out / "steps.json")
    assert (record["pairs"], record["scenes"]) == (3, 2)
    assert [*record["networks"]["two"]] == ["first map", "step 1", "step 2", "result"]
    assert [*record["networks"]["three"]] == ["first map", "step 1", "step 2", "step 3", "result"]
    expected = M3Depth.from_pretrained(tmp_path / "two.safetensors").infer_steps(pairs[0].left, pairs[0].right, RIG)
    visible = [refinement_steps.errors(step.disparity, pairs[0])[0] for step in expected]
    assert all(np.isfinite(visible))
    one = tmp_path / "one"
    assert refinement_steps.main(["--data", "any", "--limit", "1", "--out", str(one), "--weights", weights[0]]) == 0
    steps = read_json(one / "steps.json")["networks"]["two"].values()
    assert [step["non-occluded"]["epe_px"] for step in steps] == pytest.approx(visible)
    table = (out / "steps.md").read_text()
    assert "| three | step 3 |" in table and table in capsys.readouterr().out
    assert cv2.imread(str(out / "steps.png")).std() > 10


def test_datasets_of_one_folder_name_have_scenes_of_their_own(refinement_steps, pairs, tmp_path, monkeypatch):
    flat = StepMap("step 1", (64, 128), pairs[0].disparity)
    network = SimpleNamespace(infer_steps=lambda left, right, rig: [flat])
    monkeypatch.setattr(refinement_steps, "load_networks", lambda options: {"a": network})
    assert refinement_steps.main(["--data", "one/gale", "two/gale", "--out", str(tmp_path)]) == 0
    record = read_json(tmp_path / "steps.json")
    assert (record["pairs"], record["scenes"]) == (6, 4)


def test_the_figure_begins_where_a_network_has_a_first_map(refinement_steps, tmp_path, drawn_figures):
    of_step = {kind: {"epe_px": 1.0, "interval": [1.0, 1.0]} for kind in refinement_steps.KINDS.values()}
    content = {"a": {"first map": of_step, "step 1": of_step}, "b": {"step 1": of_step, "step 2": of_step}}
    refinement_steps.steps_figure(content, tmp_path / "steps.png")
    lines = drawn_figures[0].axes[0].get_lines()
    assert [line.get_xdata().tolist() for line in lines] == [[0, 1], [1, 2]]


def test_steps_at_several_sizes_are_named_by_them(refinement_steps):
    empty = np.zeros((1, 1))
    one = [StepMap("first map", (64, 128), empty), StepMap("step 1", (64, 128), empty)]
    assert refinement_steps.titles(one) == ["first map", "step 1"]
    both = [*one, StepMap("step 1", (128, 256), empty)]
    assert refinement_steps.titles(both) == ["first map, 128 px wide", "step 1, 128 px wide", "step 1, 256 px wide"]


def test_mistakes_are_one_line(refinement_steps, pairs, tmp_path, capsys):
    for flags, message in (
        (["--limit", "0"], "--limit must be at least 1"),
        (["--weights", "none.safetensors"], "none.safetensors: no such weights file"),
    ):
        assert refinement_steps.main(["--data", "any", "--out", str(tmp_path / "out"), *flags]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and message in error
    pairs.clear()
    assert refinement_steps.main(["--data", "any", "--out", str(tmp_path / "out")]) == 2
    assert "--data any: split test holds no pairs" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_networks_without_steps_are_refused(refinement_steps, pairs, tmp_path, capsys):
    M3Depth(replace(SMALL, refine_steps=0, lookup_levels=0)).save_pretrained(tmp_path / "plain.safetensors")
    flags = ["--data", "any", "--out", str(tmp_path / "out"), "--weights", str(tmp_path / "plain.safetensors")]
    assert refinement_steps.main(flags) == 2
    assert "plain.safetensors: m3depth does not refine disparity step by step" in capsys.readouterr().err


def test_pairs_of_several_sizes_are_refused(refinement_steps, pairs, tmp_path, capsys, monkeypatch):
    steps = iter([[64], [64], [64, 128]])

    class Network:
        def infer_steps(self, left, right, rig):
            return [StepMap("step 1", (size, size), pairs[0].disparity) for size in next(steps)]

    monkeypatch.setattr(refinement_steps, "load_networks", lambda options: {"a": Network()})
    assert refinement_steps.main(["--data", "any", "--out", str(tmp_path / "out")]) == 2
    assert "00001/00: is not of the size of the first pair" in capsys.readouterr().err
