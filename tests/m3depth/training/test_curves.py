"""The picture of a run's curves."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from m3depth.training.curves import LEAST_SMOOTHED, save_curves, series


def write_log(out: Path, steps: int, normal: bool = True) -> None:
    """A log as of a run that validates twice; its errors are halved in between."""
    lines = [{"kind": "train", "step": 10 * i, "loss": 100.0 / i} for i in range(1, steps + 1)]
    for step, epe in ((5 * steps, 2.0), (10 * steps, 1.0)):
        for kind in ("val_raw", "val"):
            scores = {"epe": epe, "abs_rel": epe / 10, "normal": 5 * epe if normal else None}
            lines.append({"kind": kind, "step": step, **scores})
    (out / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_curves_show_loss_and_validation_with_units_and_legends(tmp_path, drawn_figures):
    write_log(tmp_path, 5)
    assert save_curves(tmp_path) == tmp_path / "curves.png"
    axes = drawn_figures[0].axes
    assert [ax.get_ylabel() for ax in axes] == [
        "training loss (weighted sum)",
        "EPE [px], val split",
        "Abs Rel of depth, val split",
        "error of the normals [deg], val split",
    ]
    assert {ax.get_xlabel() for ax in axes} == {"optimizer step"}
    assert [text.get_text() for text in axes[1].get_legend().get_texts()] == [
        "current weights",
        "averaged weights (saved)",
    ]
    averaged = axes[1].get_lines()[1]
    np.testing.assert_array_equal(averaged.get_xydata(), [[25, 2.0], [50, 1.0]])


def test_a_long_run_gets_the_running_mean_of_its_loss(tmp_path, drawn_figures):
    write_log(tmp_path, LEAST_SMOOTHED)
    save_curves(tmp_path)
    single, mean = drawn_figures[0].axes[0].get_lines()
    x, y = mean.get_xydata().T
    loss = single.get_ydata()
    np.testing.assert_allclose(y[0], loss[:25].mean())
    np.testing.assert_allclose(y[-1], loss[-25:].mean())
    assert x[0] == 130, "in the middle of the steps 10 to 250 that it is the mean of"


def test_normals_that_a_dataset_does_not_have_get_no_panel(tmp_path, drawn_figures):
    write_log(tmp_path, 5, normal=False)
    save_curves(tmp_path)
    assert len(drawn_figures[0].axes) == 3


def test_a_run_without_validation_shows_its_loss(tmp_path, drawn_figures):
    (tmp_path / "log.jsonl").write_text('{"kind": "train", "step": 1, "loss": 3.0}\n')
    save_curves(tmp_path)
    assert len(drawn_figures[0].axes) == 1


def test_nothing_is_drawn_of_an_empty_log(tmp_path):
    assert save_curves(tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_the_picture_replaces_the_one_before(tmp_path):
    write_log(tmp_path, 5)
    for _ in range(2):
        path = save_curves(tmp_path)
    assert cv2.imread(str(path)).shape[2] == 3
    assert sorted(file.name for file in tmp_path.iterdir()) == ["curves.png", "log.jsonl"]


def test_values_that_are_not_finite_are_left_out():
    steps, values = series([{"step": 1, "epe": None}, {"step": 2, "epe": 0.5}, {"step": 3}], "epe")
    assert steps.tolist() == [2] and values.tolist() == [0.5]
