"""The errors of a validation, against sums by hand, and its picture."""

import re
import weakref
from contextlib import closing

import cv2
import numpy as np
import pytest
import torch
from small_network import SMALL

from m3depth.datasets.open import open_pairs
from m3depth.figures.pairs import COLUMNS, NORMAL_COLUMNS
from m3depth.network import model as model_module
from m3depth.network.model import M3Depth
from m3depth.network.output import StereoOutput
from m3depth.stereo.pairs import spread
from m3depth.training.batch import Target, whole_batch
from m3depth.training.config import TrainConfig
from m3depth.training.log import Log
from m3depth.training.packing import pack
from m3depth.training.run import Run
from m3depth.training.samples import JoinedPairs
from m3depth.training.validation import PANEL_PAIRS, Validator, error_sums, predict_batch, validate

SHAPE = (1, 1, 8, 12)


def target_of(disparity: torch.Tensor, label: torch.Tensor) -> Target:
    normal = torch.tensor([0.0, 0.0, -1.0])[:, None, None].expand(1, 3, *SHAPE[2:])
    no = torch.zeros(SHAPE, dtype=torch.bool)
    return Target(
        disparity * label, normal, label, no, no, no, no, torch.tensor([[60.0, 60.0, 5.5, 3.5]]), torch.tensor([0.27])
    )


def output_of(disparity: torch.Tensor, target: Target) -> StereoOutput:
    logits = torch.full(SHAPE, -5.0)
    return StereoOutput(disparity, target.normal, -logits, logits, (disparity, target.normal), [])


def test_edges_of_sparse_truth_are_those_between_labelled_pixels() -> None:
    disparity = torch.full(SHAPE, 20.0)
    label = torch.rand(SHAPE, generator=torch.Generator().manual_seed(1)) < 0.4
    sums = error_sums(output_of(disparity + 1.5, target_of(disparity, label)), target_of(disparity, label))
    count = int(label.sum())
    assert sums["edge_epe"] == (0, 0)
    assert sums["epe"] == pytest.approx((1.5 * count, count))
    assert sums["bad1"] == (count, count)
    disparity[..., 6:] = 40.0
    everywhere = torch.ones_like(label)
    sums = error_sums(output_of(disparity + 0.5, target_of(disparity, everywhere)), target_of(disparity, everywhere))
    assert sums["edge_epe"] == (0.5 * 2 * SHAPE[2], 2 * SHAPE[2])  # both sides of the step
    assert sums["abs_rel"][0] == pytest.approx(SHAPE[2] * 6 * (1 - 20 / 20.5 + 1 - 40 / 40.5), rel=1e-4)


def test_normals_are_scored_where_the_true_ones_are_known() -> None:
    target = target_of(torch.full(SHAPE, 20.0), torch.ones(SHAPE, dtype=torch.bool))
    normal = target.normal.clone()
    normal[..., :5] = 0
    total, count = error_sums(output_of(target.disparity, target), target._replace(normal=normal))["normal"]
    assert total == pytest.approx(0, abs=0.1) and count == SHAPE[2] * (SHAPE[3] - 5)


def test_rocks_are_scored_where_their_disparity_is_known() -> None:
    label = torch.ones(SHAPE, dtype=torch.bool)
    label[..., :4] = False
    target = target_of(torch.full(SHAPE, 20.0), label)
    rock = torch.zeros_like(label)
    rock[..., 2:5, 2:6] = True
    output = output_of(torch.where(label, 20.5, 120.0), target)
    assert error_sums(output, target._replace(rock=rock))["rock_epe"] == (0.5 * 3 * 2, 3 * 2)


def test_ground_taken_for_sky_is_counted_over_the_ground_and_missed_sky_over_the_sky() -> None:
    label = torch.ones(SHAPE, dtype=torch.bool)
    label[..., :2, :] = False
    target = target_of(torch.full(SHAPE, 20.0), label)._replace(sky=~label)
    output = output_of(target.disparity, target)
    output.sky[..., [0, 2], :] = 5.0  # a row of the sky, and one of the ground
    sums = error_sums(output, target)
    assert sums["false_sky"] == (SHAPE[3], 6 * SHAPE[3]) and sums["sky_missed"] == (SHAPE[3], 2 * SHAPE[3])


@pytest.mark.parametrize("training", [True, False])
def test_a_validated_network_is_trained_on_if_it_was_trained(plane_samples, training) -> None:
    network = M3Depth(SMALL).train(training)
    validate([network], [pack(plane_samples[0])], torch.device("cpu"))
    assert network.training == training


def test_networks_are_validated_together_on_pairs_that_are_read_once(plane_samples) -> None:
    networks, device = [M3Depth(SMALL), M3Depth(SMALL)], torch.device("cpu")
    torch.nn.init.normal_(next(networks[1].parameters()), generator=torch.Generator().manual_seed(3))
    packed = [pack(sample) for sample in plane_samples[:2]]
    together = validate(networks, iter(packed), device)
    for network, scores in zip(networks, together, strict=True):
        assert [scores] == [pytest.approx(alone, nan_ok=True) for alone in validate([network], packed, device)]
    assert together[0]["epe"] != together[1]["epe"]


def test_every_score_of_a_validation_is_the_mean_over_its_own_pixels_of_all_pairs(plane_samples) -> None:
    network, packed = M3Depth(SMALL).eval(), [pack(sample) for sample in plane_samples[:2]]
    sums = [error_sums(*predict_batch(network, whole_batch(pair))) for pair in packed]
    assert len({count for pair in sums for _, count in pair.values()}) > 4
    (scores,) = validate([network], packed, torch.device("cpu"))
    totals = {name: np.sum([pair[name] for pair in sums], axis=0) for name in sums[0]}
    expected = {name: total / count if count else np.nan for name, (total, count) in totals.items()}
    assert scores == pytest.approx(expected, nan_ok=True)


def test_a_validation_holds_one_pair_at_a_time(plane_samples) -> None:
    read: list[weakref.ref] = []

    def samples():
        for sample in plane_samples:
            assert not any(pair() is not None for pair in read)
            packed = pack(sample)
            read.append(weakref.ref(packed.normal))  # the images are those of the sample
            yield packed
            del packed

    validate([M3Depth(SMALL)], samples(), torch.device("cpu"))
    assert len(read) == len(plane_samples) > 2


def test_pairs_of_a_validation_are_read_one_after_the_other(plane_set, tmp_path, monkeypatch) -> None:
    config = TrainConfig(data=(plane_set,), out=tmp_path, validate_samples=8, device="cpu", cache=False)
    given = []
    monkeypatch.setitem(model_module.PRESETS, "lite", SMALL)
    monkeypatch.setattr("m3depth.training.validation.pairs_figure", lambda *_: np.zeros((8, 8, 3), np.uint8))
    monkeypatch.setattr(
        "m3depth.training.validation.validate",
        lambda models, samples, device: given.append(samples) or [{"epe": 1.0}, {"epe": 2.0}],
    )
    with closing(Log(tmp_path, 0)) as log:
        assert Validator(Run(config, torch.device("cpu")), log, open_pairs(plane_set, "all")).validate() == {"epe": 2.0}
    (samples,) = given
    assert iter(samples) is samples and len(list(samples)) == 8


def test_the_panel_names_its_pairs_and_has_their_scales(plane_set, tmp_path, monkeypatch, drawn_figures) -> None:
    monkeypatch.setitem(model_module.PRESETS, "lite", SMALL)
    pairs = open_pairs(plane_set, "all")
    config = TrainConfig(data=(plane_set,), out=tmp_path, validate_samples=8, device="cpu")
    run = Run(config, torch.device("cpu"))
    assert run.averaged.refinement is not None
    torch.nn.init.constant_(run.averaged.refinement.decisions[2].bias, 50.0)  # all is sky
    monkeypatch.setattr("m3depth.network.inference.possible_sky", lambda candidates, *_: candidates)
    with closing(Log(tmp_path, 0)) as log:
        Validator(run, log, pairs).validate()
    (path,) = (tmp_path / "panels").iterdir()
    assert cv2.imread(str(path)) is not None
    panel = drawn_figures[0]  # in a slow run the curves follow it
    width = len(COLUMNS + NORMAL_COLUMNS)
    rows = [panel.axes[start : start + width] for start in range(0, PANEL_PAIRS * width, width)]
    chosen = spread(len(pairs), 8)[:PANEL_PAIRS]
    assert [row[0].get_ylabel() for row in rows] == [pairs.names[index] for index in chosen]
    for row, index in zip(rows, chosen):
        np.testing.assert_array_equal(row[0].images[0].get_array(), pairs[index].left)
        (scale,) = row[1].texts
        assert re.fullmatch(r"[\d.]+ to [\d.]+ px\n[\d.]+ to [\d.]+ m", scale.get_text())
        assert np.isnan(np.ma.filled(row[2].images[0].get_array(), np.nan)).all(), "no disparity in the sky"


def test_pairs_of_several_datasets_keep_their_names(plane_set) -> None:
    pairs = open_pairs(plane_set, "all")
    assert JoinedPairs([pairs]).names == pairs.names
    joined = JoinedPairs([pairs, [pairs[0]]])
    assert joined.names == [*(f"{plane_set.name}/{name}" for name in pairs.names), "000000"]


def test_joined_pairs_have_the_digest_of_a_single_dataset_or_one_that_each_part_changes(plane_set) -> None:
    pairs = open_pairs(plane_set, "all")
    assert JoinedPairs([pairs]).digest == pairs.digest
    several = [JoinedPairs(parts).digest for parts in ([pairs, pairs], [pairs, [pairs[0]]], [[pairs[0]], pairs])]
    assert len({*several, pairs.digest}) == 4
