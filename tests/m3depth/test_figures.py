"""Figures hold what they should; how they look is for eyes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.evaluation import evaluate
from m3depth.figures.comparison import comparison_figure
from m3depth.figures.drawing import depth_scale
from m3depth.figures.errors import distribution_figure, interval_figure, sparsification_figure
from m3depth.figures.example import Example
from m3depth.figures.prediction import prediction_figure
from m3depth.figures.qualitative import hard_parts, qualitative_figure, zoom_figure
from m3depth.figures.rocks import rocks_figure
from m3depth.figures.worst import worst_figure
from m3depth.matching import SGBM
from m3depth.metrics import pixel_kinds
from m3depth.prediction import Prediction


def example(sample, **methods) -> Example:
    told = Prediction(sample.depth, sample.disparity, sample.normal, np.ones(sample.depth.shape, np.float32))
    return Example(0, sample.left, sample.right, sample, methods or {"truth": told})


def patchy(plane_sample):
    """A big plane with a bare patch, a dark one, and one with depth edges, each in its own corner."""
    rng = np.random.default_rng(0)
    left = rng.integers(100, 220, (200, 240, 3), dtype=np.uint8)
    left[120:180, 10:70] = 150
    left[10:70, 10:70] //= 4
    depth = np.full((200, 240), 6.0, np.float32)
    depth[130:190:8, 150:210] = 3.0
    rig = plane_sample.rig.resized(240, 200)
    return replace(
        plane_sample, left=left, right=left, depth=depth, disparity=rig.depth_to_disparity(depth), rig=rig,
        normal=np.zeros((200, 240, 3), np.float32), valid=depth > 0, occluded=depth < 0, rock=np.zeros((200, 240), int),
    )  # fmt: skip


def inside(part, rows, columns) -> bool:
    row, column, side = part
    return (
        rows[0] - 8 <= row
        and row + side <= rows[1] + 8
        and columns[0] - 8 <= column
        and column + side <= columns[1] + 8
    )


def test_hard_parts_are_where_it_is_hard(plane_samples):
    parts = hard_parts(example(patchy(plane_samples[0])))
    assert inside(parts["least texture"], (120, 180), (10, 70))
    assert inside(parts["darkest"], (10, 70), (10, 70))
    assert inside(parts["most edges"], (120, 200), (140, 220))


@given(st.integers(0, 100))
@settings(max_examples=10)
def test_hard_parts_lie_apart_in_what_is_scored(plane_samples, seed):
    sample = patchy(plane_samples[0])
    valid = cv2.resize(np.random.default_rng(seed).random((4, 5)), (240, 200), interpolation=cv2.INTER_NEAREST) > 0.3
    sample = replace(sample, valid=valid)
    used = np.zeros(valid.shape, int)
    for row, column, side in hard_parts(example(sample)).values():
        used[row : row + side, column : column + side] += 1
        assert pixel_kinds(sample)["all"][row : row + side, column : column + side].mean() >= 0.9
    assert used.max(initial=0) <= 1


def test_without_anything_scored_there_are_no_parts_and_still_figures(plane_samples, tmp_path):
    sample = replace(plane_samples[0], valid=np.zeros_like(plane_samples[0].valid))
    assert hard_parts(example(sample)) == {}
    for draw in (zoom_figure, qualitative_figure, comparison_figure, worst_figure):
        draw([example(sample)], tmp_path / "figure.png")
        assert cv2.imread(str(tmp_path / "figure.png")).std() > 5


def test_every_method_has_its_place_in_every_figure(plane_samples, tmp_path):
    done = evaluate(plane_samples, {"SGBM": SGBM(), "again": SGBM(block=5), "third": SGBM(block=7)}, examples=2)
    qualitative_figure(done.examples, tmp_path / "q.png")
    qualitative_figure([e.only(["SGBM"]) for e in done.examples], tmp_path / "q1.png")
    wide, narrow = (cv2.imread(str(tmp_path / name)) for name in ("q.png", "q1.png"))
    assert wide.shape[1] > 1.4 * narrow.shape[1]
    for draw in (interval_figure, distribution_figure, sparsification_figure):
        draw(done.results, tmp_path / "figure.png")
        assert cv2.imread(str(tmp_path / "figure.png")).std() > 5
    rocks_figure({name: result["rocks"] for name, result in done.results.items()}, tmp_path / "rocks.png")
    assert cv2.imread(str(tmp_path / "rocks.png")).min() < 128  # it says that there are none


def test_the_worst_are_drawn_with_their_error_and_what_they_lack(plane_samples, tmp_path, monkeypatch):
    sample = plane_samples[0]
    off = Prediction(sample.depth, sample.disparity + 2, None, np.full(sample.depth.shape, 0.25, np.float32))
    drawn = []
    monkeypatch.setattr("m3depth.figures.worst.save", lambda figure, path: drawn.append(figure))
    worst_figure([example(sample, off=off), example(sample)], tmp_path / "worst.png")
    first, second = (drawn[0].axes[row * 7 : row * 7 + 7] for row in range(2))
    scored = pixel_kinds(sample)["all"]
    error, confidence = (ax.images[0].get_array() for ax in first[3:5])
    np.testing.assert_allclose(np.asarray(error)[scored], 2, atol=1e-5)
    assert not np.isfinite(np.ma.filled(error, np.nan))[~scored].any() and (confidence == 0.25).all()
    assert [text.get_text() for text in first[3].texts] == ["2.00 px"]
    assert not first[6].images and second[6].images


@pytest.mark.parametrize("normal", [True, False])
def test_a_prediction_of_nothing_can_be_drawn(tmp_path, normal):
    unknown = np.full((20, 30), np.nan, np.float32)
    nothing = Prediction(unknown, unknown, np.zeros((20, 30, 3), np.float32) if normal else None, unknown * 0)
    prediction_figure(np.zeros((20, 30), np.uint8), nothing, tmp_path / "figure.png")
    assert cv2.imread(str(tmp_path / "figure.png")) is not None


def test_depth_scales_span_what_is_there():
    scale = depth_scale(np.array([np.nan, np.inf, 0.0, 2.0, 20.0]), whole=True)
    assert (scale.vmin, scale.vmax) == (2.0, 20.0)
    assert depth_scale(np.array([90.0, 100.0])).vmax == pytest.approx(37.5)
    assert depth_scale(np.linspace(50, 100, 100), farthest=300).vmax == pytest.approx(99, abs=1)
    assert depth_scale(np.zeros(0)).vmin == 1.0
