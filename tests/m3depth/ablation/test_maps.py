"""The maps of a study's rows: each row by its own network, with the mean of its error."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from small_network import SMALL

from m3depth.ablation.maps import maps_figure, predicted
from m3depth.evaluation.metrics import pixel_kinds
from m3depth.evaluation.scores import ScoredPair, Scores
from m3depth.network.model import M3Depth


@pytest.fixture
def examples(plane_samples, tmp_path):
    """The first and the last plane, as two small networks of random weights see them."""
    rows = {}
    for seed, label in enumerate(("(a) neither", "(b) both, with heads of the state")):
        torch.manual_seed(seed)
        rows[label] = tmp_path / f"{seed}.safetensors"
        M3Depth(SMALL).save_pretrained(rows[label])
    return predicted(rows, plane_samples, "cpu")


def test_every_row_has_the_maps_of_its_own_network(plane_samples, examples, tmp_path, drawn_figures):
    assert [example.index for example in examples] == [0, len(plane_samples) - 1]
    first, second = examples[0].predictions.values()
    assert not np.array_equal(first.disparity, second.disparity)
    maps_figure(examples, tmp_path / "maps.png")
    assert cv2.imread(str(tmp_path / "maps.png")).std() > 5
    axes = np.array(drawn_figures[0].axes[: 6 * 4]).reshape(6, 4)  # three lines a pair; image, truth and two rows
    assert [ax.get_title() for ax in axes[0]] == [
        "left image",
        "truth",
        "(a) neither",
        "(b) both, with heads\nof the state",
    ]
    for example, line in zip(examples, axes[1::3], strict=True):
        scored = pixel_kinds(example.truth)["all"]
        for ax, prediction in zip(line[2:], example.predictions.values(), strict=True):
            error = np.abs(np.nan_to_num(prediction.disparity) - example.truth.disparity)[scored].mean()
            assert [text.get_text() for text in ax.texts] == [f"{error:.2f} px"]


def test_a_pixel_without_a_disparity_counts_as_in_the_scores(plane_samples, examples, tmp_path, drawn_figures):
    example = examples[0]
    label, prediction = next(iter(example.predictions.items()))
    disparity, depth = prediction.disparity.copy(), prediction.depth.copy()
    disparity[::3] = depth[::3] = np.nan
    silent = replace(prediction, disparity=disparity, depth=depth)
    maps_figure([replace(example, predictions={label: silent})], tmp_path / "maps.png")
    epe = Scores().add(silent, ScoredPair(plane_samples[0]))["epe"]
    assert [text.get_text() for text in drawn_figures[0].axes[5].texts] == [f"{epe:.2f} px"]


def test_a_row_without_normals_has_none(examples, tmp_path, drawn_figures):
    example = examples[0]
    bare = {label: replace(prediction, normal=None) for label, prediction in example.predictions.items()}
    maps_figure([replace(example, predictions=bare)], tmp_path / "maps.png")
    axes = np.array(drawn_figures[0].axes[: 3 * 4]).reshape(3, 4)
    assert [len(ax.images) for ax in axes[2]] == [0, 1, 0, 0] and [len(ax.images) for ax in axes[1]] == [0, 0, 1, 1]
