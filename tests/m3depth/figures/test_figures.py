"""Figures contain the right values; their look is judged by eye."""

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import Normalize

from m3depth.evaluation.example import Example
from m3depth.evaluation.metrics import angle_between, pixel_kinds
from m3depth.evaluation.rock_scores import RockCounts, RockOutcome
from m3depth.evaluation.scores import ScoredPair, Scores
from m3depth.evaluation.scoring import evaluate
from m3depth.figures.comparison import comparison_figure
from m3depth.figures.drawing import LONGEST, depth_scale, legend_labels, method_styles
from m3depth.figures.errors import distribution_figure, interval_figure, sparsification_figure
from m3depth.figures.pairs import pairs_figure, scale_text
from m3depth.figures.qualitative import hard_parts, qualitative_figure, zoom_figure
from m3depth.figures.rocks import rocks_figure
from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction
from marssim.base.images.colours import NORMAL_TITLE


def example(sample, **methods) -> Example:
    exact = Prediction(sample.depth, sample.disparity, sample.normal, np.ones(sample.depth.shape, np.float32))
    return Example(0, sample.left, sample.right, sample, methods or {"truth": exact})


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


def test_hard_parts_lie_at_bare_dark_and_broken_ground(plane_samples):
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


def image_in(ax) -> np.ma.MaskedArray:
    (shown,) = ax.images
    return np.ma.masked_invalid(shown.get_array())


def test_without_anything_scored_there_are_no_parts_and_still_figures(plane_samples, tmp_path, drawn_figures):
    sample = replace(plane_samples[0], valid=np.zeros_like(plane_samples[0].valid))
    assert hard_parts(example(sample)) == {}
    for draw in (zoom_figure, qualitative_figure, comparison_figure, pairs_figure):
        draw([example(sample)], tmp_path / "figure.png")
        assert cv2.imread(str(tmp_path / "figure.png")) is not None
    zoom, qualitative, comparison, worst = drawn_figures
    assert len(zoom.axes) == 1 and not zoom.axes[0].patches
    np.testing.assert_array_equal(image_in(qualitative.axes[0]), sample.left)
    assert image_in(comparison.axes[3]).mask.all() and image_in(worst.axes[3]).mask.all()


def test_whole_pairs_are_shown_with_every_method_on_one_scale(plane_samples, tmp_path, drawn_figures):
    sample = plane_samples[0]
    exact = example(sample).predictions["truth"]
    methods = {"exact": exact, "far": replace(exact, depth=exact.depth * 2)}
    qualitative_figure([example(sample, **methods)], tmp_path / "figure.png")
    row = drawn_figures[0].axes[:4]
    assert [ax.get_title() for ax in row] == ["left image", "truth", "exact", "far"]
    known = np.isfinite(sample.depth)
    for ax, depth in zip(row[1:], (sample.depth, sample.depth, sample.depth * 2), strict=True):
        shown = image_in(ax)
        np.testing.assert_array_equal(shown.mask, ~known)
        np.testing.assert_allclose(shown[known], depth[known])
    assert len({(ax.images[0].norm.vmin, ax.images[0].norm.vmax) for ax in row[1:]}) == 1


def test_errors_are_drawn_beside_predictions(plane_samples, tmp_path, drawn_figures):
    sample = plane_samples[0]
    exact = example(sample).predictions["truth"]
    turned = np.roll(np.eye(3, dtype=np.float32), 1, 0)  # by 120 deg about the diagonal
    off = replace(exact, depth=exact.depth * np.float32(1.02), normal=exact.normal @ turned)
    comparison_figure([example(sample, off=off, blind=replace(exact, normal=None))], tmp_path / "figure.png")
    upper, lower = drawn_figures[0].axes[:6], drawn_figures[0].axes[6:12]
    titles = ["images", "truth", "off", "off: error", "blind", "blind: error"]
    assert [ax.get_title() for ax in upper] == titles
    scored = pixel_kinds(sample)["all"]
    relative, angle = image_in(upper[3]), image_in(lower[3])
    np.testing.assert_array_equal(relative.mask, ~scored)
    np.testing.assert_allclose(relative[scored], 2, rtol=1e-3)
    expected = angle_between(sample.normal @ turned, sample.normal)[scored]
    assert expected.min() > 10
    np.testing.assert_allclose(angle[scored], expected, rtol=1e-4)
    names = [[text.get_text() for text in ax.texts] for ax in (*upper[:4], *lower)]
    assert names == [
        ["left image"], ["true depth"], ["depth"], ["depth error: mean 2.0 %"],
        ["right image"], ["true normals"], ["normals"], [f"angle error: mean {expected.mean():.1f}°"],
        ["no normals"], ["no normals"],
    ]  # fmt: skip
    assert np.ptp(image_in(lower[5])) == 0  # nothing to compare
    np.testing.assert_array_equal(image_in(lower[0]), sample.right)


def test_methods_without_a_column_are_counted(plane_samples, tmp_path, drawn_figures):
    pair = example(plane_samples[0], a=example(plane_samples[0]).predictions["truth"])
    pair = replace(pair, predictions={name: pair.predictions["a"] for name in "abc"})
    for most, words in ((2, ["and 1 method more"]), (3, [])):
        comparison_figure([pair], tmp_path / "figure.png", most=most)
        titles = [ax.get_title() for ax in drawn_figures[-1].axes]
        assert [name for name in "abc" if name in titles] == list("abc")[:most]
        assert [text.get_text() for text in drawn_figures[-1].texts] == [*words, NORMAL_TITLE]


def test_enlarged_parts_are_those_that_are_marked(plane_samples, tmp_path, drawn_figures):
    sample = patchy(plane_samples[0])
    parts = hard_parts(example(sample))
    zoom_figure([example(sample)], tmp_path / "figure.png")
    whole, *rest = drawn_figures[0].axes
    marked = [(p.get_y(), p.get_x(), p.get_width()) for p in whole.patches]
    assert marked == list(parts.values()) and len(rest) == 3 * len(parts)
    for line, (kind, (row, column, side)) in enumerate(parts.items()):
        image, truth, method = rest[3 * line : 3 * line + 3]
        cut = np.s_[row : row + side, column : column + side]
        np.testing.assert_array_equal(image_in(image), sample.left[cut])
        assert [t.get_text() for t in image.texts] == [kind]
        for ax in (truth, method):
            np.testing.assert_array_equal(image_in(ax), sample.depth[cut])


def test_curves_are_the_figures_of_each_method(plane_samples, tmp_path, drawn_figures):
    done = evaluate(plane_samples, {"SGBM": SGBM(), "again": SGBM(block=5), "third": SGBM(block=7)})
    for draw in (interval_figure, distribution_figure, sparsification_figure):
        draw(done.results, tmp_path / "figure.png")
    intervals, distribution, sparsification = drawn_figures
    for ax, key, power, unit in zip(intervals.axes[:3], ("mae", "rmse", "bad1"), (1, 2, 1), (1, 1, 100), strict=True):
        assert [line.get_label() for line in ax.lines] == list(done.results)
        for line, result in zip(ax.lines, done.results.values(), strict=True):
            rows = [row for row in result["intervals"] if row["pixels"]]
            np.testing.assert_allclose(line.get_xdata(), [row["from_m"] + 0.5 for row in rows])
            np.testing.assert_allclose(line.get_ydata(), [unit * row["pooled"][key] ** power for row in rows])
    shares = [bar.get_height() for bar in intervals.axes[3].patches]
    assert sum(shares) == pytest.approx(1)
    for ax, (name, result) in zip(distribution.axes, done.results.items()):
        assert ax.get_title().startswith(f"{name}: {result['depth']['all']['pooled']['mae']:.3f} ± ")
        assert ax.collections[0].get_array().sum() == pytest.approx(100)
    for ax, key, unit in zip(sparsification.axes, ("epe", "bad1"), (1, 100), strict=True):
        for number, result in enumerate(done.results.values()):
            curve, oracle = (line.get_ydata() for line in ax.lines[2 * number : 2 * number + 2])
            np.testing.assert_allclose(curve, unit * np.array(result["sparsification"][key]))
            np.testing.assert_allclose(oracle, unit * np.array(result["sparsification"][f"oracle_{key}"]))


def test_the_lines_of_many_methods_differ():
    styles = [tuple(style.values()) for style, _ in zip(method_styles(), range(129))]
    assert len(set(styles[:24])) == 24
    assert len(set(styles)) == 128 and styles[128] == styles[0]
    assert len({(colour, face == "white") for colour, _, face in styles[:16]}) == 16


@pytest.mark.parametrize(("trained", "others"), [(14, 10), (4, 3), (24, 0), (0, 24)])
def test_methods_without_training_are_dashed_and_many_of_them_have_a_row_with_the_first_method(
    tmp_path, drawn_figures, trained, others
):
    pooled = {"mae": 0.1, "rmse": 0.2, "bad1": 0.3}
    result = {"intervals": [{"from_m": 2, "to_m": 3, "pixels": 5, "pooled": pooled}]}
    names = [f"method {n}" for n in range(trained + others)]
    interval_figure(dict.fromkeys(names, result), tmp_path / "figure.png", untrained=names[trained:])
    (figure,) = drawn_figures
    two = len(names) > 12 and trained > 0 and others > 0
    rows = [names[:trained], [names[0], *names[trained:]]] if two else [names]
    assert len(figure.subfigs) == len(rows)
    styles = set()
    for part, shown in zip(figure.subfigs, rows, strict=True):
        dashed = ["-" if names.index(name) < trained else "--" for name in shown]
        assert [text.get_text() for text in part.legends[0].get_texts()] == shown
        for lines in (*(ax.lines for ax in part.axes[:3]), part.legends[0].get_lines()):
            assert [line.get_linestyle() for line in lines] == dashed
        styles |= {(line.get_color(), line.get_marker(), line.get_markerfacecolor()) for line in part.axes[0].lines}
    assert len(styles) == len(names)
    assert ("dashed: not trained here" in figure.get_supxlabel()) == (others > 0)


def test_bars_are_the_outcomes_of_the_rocks(tmp_path, drawn_figures):
    counted = RockCounts(images=4, false=[(0.25, 2.0), (0.6, 6.0)])
    for height, away, outcome, error in ((0.15, 2, True, 0.01), (0.15, 3, False, 0), (0.35, 6, True, -0.03)):
        counted.rocks.append(RockOutcome(height, away, outcome, error))
    rocks_figure({"net": counted.result(), "none": {}}, tmp_path / "figure.png")
    heights = [[bar.get_height() for bar in ax.patches] for ax in drawn_figures[0].axes]
    nan = np.nan
    expected = [
        [50, nan, nan, nan], [nan, nan, 100, nan], [nan] * 4,  # found [%], by range
        [1, nan, nan, nan], [nan, nan, 3, nan], [nan] * 4,  # error of the height [cm]
        [nan, 25, 0, 0], [nan, 0, 0, 25], [nan, 0, 0, 0],  # false in 100 images, of 0.2 m and more
    ]  # fmt: skip
    for outcome, wanted in zip(heights, expected, strict=True):
        np.testing.assert_allclose(outcome, wanted)
    counted.false.append((0.15, 9.0))  # lower than what counts as an obstacle here: nav's map has a lower step
    rocks_figure({"net": counted.result()}, tmp_path / "figure.png")
    assert [bar.get_height() for bar in drawn_figures[1].axes[8].patches] == [25, 0, 0, 0]
    assert [len(ax.patches) for ax in drawn_figures[1].axes[6:]] == [4, 4, 4]
    rocks_figure({"net": {}}, tmp_path / "figure.png")
    assert not drawn_figures[2].axes and "no sample records the pose" in drawn_figures[2].texts[0].get_text()


def test_pairs_are_drawn_with_their_errors_and_scales(plane_samples, tmp_path, drawn_figures):
    sample = plane_samples[0]
    off = Prediction(sample.depth, sample.disparity + 2, None, np.full(sample.depth.shape, 0.25, np.float32))
    pairs_figure([example(sample, off=off), example(sample)], tmp_path / "worst.png")
    first, second = (drawn_figures[0].axes[row * 7 : row * 7 + 7] for row in range(2))
    scored = pixel_kinds(sample)["all"]
    error, confidence = (ax.images[0].get_array() for ax in first[3:5])
    np.testing.assert_allclose(np.asarray(error)[scored], 2, atol=1e-5)
    assert not np.isfinite(np.ma.filled(error, np.nan))[~scored].any() and (confidence == 0.25).all()
    assert [text.get_text() for text in first[3].texts] == ["2.00 px"]
    low, high = np.percentile(sample.disparity[scored], [1, 99])
    far, near = sample.rig.fb / low, sample.rig.fb / high
    assert [text.get_text() for text in first[1].texts] == [f"{low:.3g} to {high:.3g} px\n{far:.3g} to {near:.3g} m"]
    known = sample.disparity > 0
    truth = np.ma.filled(first[1].images[0].get_array(), np.nan)
    np.testing.assert_array_equal(truth[known], sample.disparity[known])  # farther than what is scored, too
    assert np.isnan(truth[~known]).all()
    assert not first[6].images and second[6].images


def test_pairs_of_a_method_without_normals_have_no_columns_for_them(plane_samples, tmp_path, drawn_figures):
    sample = plane_samples[0]
    depth_alone = Prediction(sample.depth, sample.disparity, None, np.ones(sample.depth.shape, np.float32))
    for name, methods in (("depth", {"depth": depth_alone}), ("both", {})):
        pairs_figure([example(sample, **methods)], tmp_path / f"{name}.png")
    titles = [[ax.get_title() for ax in figure.axes if ax.get_title()] for figure in drawn_figures]
    assert titles[0] == titles[1][:5] and titles[1][5:] == ["true normals", "predicted normals"]
    legends = [figure.texts[0].get_text() for figure in drawn_figures]
    assert NORMAL_TITLE in legends[1] and NORMAL_TITLE not in legends[0]


def test_a_scale_from_zero_disparity_begins_infinitely_far():
    assert scale_text(Normalize(0, 27), 54.0) == "0 to 27 px\ninf to 2 m"


def test_depth_scales_span_the_depths():
    scale = depth_scale(np.array([np.nan, np.inf, 0.0, 2.0, 20.0]), whole=True)
    assert (scale.vmin, scale.vmax) == (2.0, 20.0)
    assert depth_scale(np.array([90.0, 100.0])).vmax == pytest.approx(37.5)
    assert depth_scale(np.linspace(50, 100, 100), farthest=300).vmax == pytest.approx(99, abs=1)
    assert depth_scale(np.zeros(0)).vmin == 1.0
    assert depth_scale(np.array([0.01, 40.0]), whole=True).vmin == 0.3
    near = depth_scale(np.linspace(0.1, 0.25, 100))
    assert (near.vmin, near.vmax) == (pytest.approx(0.1, abs=0.01), pytest.approx(0.25, abs=0.01))


def test_normals_of_the_sky_are_not_compared(plane_samples, tmp_path, drawn_figures):
    sample = plane_samples[0]
    depth = sample.depth.copy()
    depth[:10] = np.inf
    exact = Prediction(depth, sample.disparity, np.broadcast_to(np.float32([0, -1, 0]), sample.normal.shape), depth)
    comparison_figure([example(sample, one=exact)], tmp_path / "figure.png")
    shown = drawn_figures[0].axes[6].images[0].get_array()
    grey, ground = shown[0, 0], shown[-1, 0]
    assert grey[0] == grey[1] == grey[2] and (shown[:10] == grey).all() and not (ground == grey).all()


def test_the_depth_error_is_that_of_abs_rel_where_the_ground_is_farther_than_is_scored(
    plane_samples, tmp_path, drawn_figures
):
    """Both depths end at 80 m."""
    sample = plane_samples[0]
    depth = sample.depth * np.float32(80 / np.median(sample.depth[np.isfinite(sample.depth)]))
    sample = replace(sample, depth=depth, disparity=sample.rig.depth_to_disparity(depth))
    near = Prediction(0.9 * depth, sample.disparity, sample.normal, np.ones_like(depth))
    comparison_figure([example(sample, near=near)], tmp_path / "figure.png")
    abs_rel = Scores().add(near, ScoredPair(sample))["abs_rel"]
    notes = [text.get_text() for ax in drawn_figures[0].axes for text in ax.texts]
    assert f"depth error: mean {100 * abs_rel:.1f} %" in notes and 0.01 < abs_rel < 0.099


def test_labels_of_the_bars_do_not_meet_in_a_figure_of_one_method(plane_samples, tmp_path, drawn_figures):
    comparison_figure([example(plane_samples[0])], tmp_path / "figure.png")
    boxes = [ax.xaxis.label.get_window_extent() for ax in drawn_figures[0].axes if ax.get_xlabel()]
    assert len(boxes) == 3 and all(a.x1 + 5 < b.x0 for a, b in pairwise(boxes))
    assert all(box.y0 >= 0 for box in boxes)


def test_figures_show_the_errors_of_the_pixels_that_are_scored(plane_samples, tmp_path, monkeypatch):
    """Nearer pixels, too, if they are scored; and an unknown disparity counts as 0 px."""
    sample = plane_samples[0]
    true = sample.disparity[np.isfinite(sample.depth) & sample.valid]
    limit = float(np.median(true))
    one = example(sample)
    assert 0 < replace(one, max_disparity=limit).scored.sum() < one.scored.sum()
    notes = []
    monkeypatch.setattr("m3depth.figures.panels.note", lambda ax, text: notes.append(text))
    nothing = np.full(sample.depth.shape, np.nan, np.float32)
    silent = {"silent": Prediction(nothing, nothing, None, np.zeros_like(nothing))}
    for shown in (one, replace(one, max_disparity=limit)):
        pairs_figure([replace(shown, predictions=silent)], tmp_path / "pairs.png")
        assert notes[-1] == f"{sample.disparity[shown.scored].mean():.2f} px"


def test_long_names_lose_their_middle_and_stay_different():
    long = [f"runs/{'a' * 40}{n}/{'b' * 40}/weights.safetensors" for n in (1, 2)]
    assert legend_labels(["sgbm", "_mine"]) == ["sgbm", " _mine"]
    first, short = legend_labels([long[0], "sgbm"])
    assert len(first) == LONGEST and first.startswith("runs/aaa") and first.endswith("weights.safetensors")
    assert short == "sgbm"
    one, two = legend_labels(long)
    assert one.startswith("…aaaaaaaa1/bbb") and two.startswith("…aaaaaaaa2/bbb") and len(one) == len(two) == LONGEST
