"""Whole estimates against a truth in closed form: with trained weights, and with parts whose result is known.

The other tests hold each method's parts. These hold what lies between them: signs, units and the order of the parts.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import torch.nn.functional as F
from small_rivals import TINY
from torch import Tensor, nn

from m3depth.kinds.networks import load_network, new_network
from m3depth.network.geometry import pixel_rays, unit
from m3depth.rivals.geo_net import SHARP
from m3depth.rivals.normal_network import NormalInput
from m3depth.rivals.output import Truth
from m3depth.rivals.recurrent import CELL
from m3depth.rivals.selective_stereo import SelectiveUnit
from m3depth.rivals.uni_mvs_net import Sweep, UnifiedOutput
from marssim.base.camera import NATECAM

WEIGHTS = Path(__file__).parents[3] / "docs/results/methods/weights"
SIDE = 256  # of the pair for the trained weights [px]
CAMERA = torch.tensor([[60.0, 60.0, 31.5, 15.5]])


def slanted_pair() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the images of a textured, slanted plane, and its disparity of 8 to 52 px."""
    rng = np.random.default_rng(0)
    size = (SIDE + 64, SIDE)
    coarse = cv2.resize(rng.integers(0, 256, (SIDE // 2, SIDE), np.uint8), size, interpolation=cv2.INTER_CUBIC)
    fine = cv2.GaussianBlur(rng.integers(0, 256, size[::-1], np.uint8), (0, 0), 2)
    texture = (coarse.astype(np.float32) + fine) / 2
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    disparity = 8 + 40 * y / SIDE + 4 * x / SIDE
    left = cv2.remap(texture, x - disparity + 60, y, cv2.INTER_CUBIC)
    left, right = (
        np.repeat(np.clip(eye, 0, 255).astype(np.uint8)[..., None], 3, 2) for eye in (left, texture[:, 60 : 60 + SIDE])
    )
    return left, right, disparity


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        # number of a step, and the bound of the mean error after it [px]
        ("raft-stereo", {8: 0.5}),
        ("cre-stereo", {5: 3.0, 10: 1.0, 16: 0.5}),
        ("uni-mvs-net", {0: 0.5}),
    ],
)
def test_trained_weights_find_a_slanted_plane(name: str, bounds: dict[int, float]) -> None:
    left, right, disparity = slanted_pair()
    network, rig = load_network(WEIGHTS / f"{name}.safetensors"), NATECAM.resized(SIDE, SIDE)
    if network.takes_steps:
        maps = {int(step.name.split()[1]): step.disparity for step in network.infer_steps(left, right, rig)}
    else:
        maps = {0: network.infer(left, right, rig).disparity}
    assert max(maps) == max(bounds)
    visible = np.arange(SIDE) - disparity >= 2
    errors = {step: float(np.abs(maps[step] - disparity)[visible].mean()) for step in bounds}
    assert all(errors[step] < bound for step, bound in bounds.items()), errors


class Cells(nn.Module):
    """Stands for a network of features: the pixels of each cell, as a vector of unit length."""

    def __init__(self, several: bool = False) -> None:
        super().__init__()
        self.several = several

    def forward(self, images: Tensor) -> Tensor | list[Tensor]:
        cells = unit(F.pixel_unshuffle(images, CELL))
        return [cells] if self.several else cells


def shifted_pair(shift: int) -> tuple[Tensor, Tensor]:
    """Return images (1, 3, 64, 192) in [-1, 1] of one disparity [px]."""
    right = 2 * torch.rand(1, 3, 64, 192, generator=torch.Generator().manual_seed(0)) - 1
    return right.roll(shift, 3), right


def assert_found(disparity: Tensor, shift: float) -> None:
    """Check a map of shifted_pair, but for the columns whose match lies outside or near the border."""
    inner = disparity[..., 64:-32]
    torch.testing.assert_close(inner, torch.full_like(inner, shift), atol=0.02, rtol=0)


class Walk(nn.Module):
    """Stands for an update: moves by a cell towards the best of the scores at -2 to 2 cells around the disparity."""

    def forward(self, states: list[Tensor], *inputs: Tensor) -> tuple[list[Tensor], Tensor]:
        *_, cells, scores = inputs
        return states, cells - (scores.argmax(1, keepdim=True) - 2).sign()


@pytest.mark.parametrize("kind", ["raft-stereo", "selective-stereo"])
def test_each_step_gets_the_scores_around_the_disparity_so_far(kind: str) -> None:
    """So the walk arrives where the features are equal, and stays there."""
    network = new_network(replace(TINY[kind], lookup_radius=2, lookup_levels=1, steps=5)).eval()
    network.features, network.update, network.every_step = Cells(), Walk(), True
    with torch.no_grad():
        maps = network.estimate(*shifted_pair(2 * CELL), CAMERA).maps
    for disparity, cells in zip(maps, (1, 2, 2, 2, 2), strict=True):
        assert_found(disparity, CELL * cells)


@pytest.mark.parametrize("kind", ["raft-stereo", "selective-stereo", "cre-stereo"])
def test_no_gradient_passes_from_a_step_to_the_corrections_before_it(kind: str) -> None:
    """The steps are trained as in RAFT: each corrects the disparity that it is given."""
    network, corrections = new_network(TINY[kind]).train(), []
    network.update.head.register_forward_hook(lambda _, __, correction: corrections.append(correction))
    maps = network.estimate(*shifted_pair(8), CAMERA).maps
    assert len(maps) == len(corrections)
    for number, disparity in enumerate(maps):
        gradients = torch.autograd.grad(disparity.sum(), corrections, retain_graph=True, allow_unused=True)
        assert [g is not None for g in gradients] == [place == number for place in range(len(maps))]


@pytest.mark.parametrize("attention", [0.0, 0.25, 1.0])
def test_the_attention_mixes_small_kernels_and_large_ones(attention: float) -> None:
    unit_of_two = SelectiveUnit(4, 6)
    hidden, *inputs = (torch.randn(1, channels, 5, 7) for channels in (4, 2, 4))
    small, large = (part(hidden, torch.cat(inputs, 1)) for part in (unit_of_two.small, unit_of_two.large))
    mixed = unit_of_two(torch.full((1, 1, 5, 7), attention), hidden, *inputs)
    torch.testing.assert_close(mixed, attention * small + (1 - attention) * large)
    assert [part.gates.kernel_size for part in (unit_of_two.small, unit_of_two.large)] == [(1, 1), (3, 3)]


class Pyramid(nn.Module):
    """Stands for a network of features: the images at 1/1, 1/2, ... 1/16."""

    def forward(self, images: Tensor) -> list[Tensor]:
        return [F.avg_pool2d(images, 1 << level) for level in range(5)]


@pytest.mark.parametrize(("shift", "of_coarser"), [(24, False), (32, True)])
def test_the_more_confident_hypothesis_of_hitnet_passes_through_all_resolutions(shift: int, of_coarser: bool) -> None:
    """At 1/16, 24 px are no whole disparity, so that only the guesses of finer resolutions can find them."""
    network = new_network(replace(TINY["hit-net"], widths=(3, 3, 3, 3, 3))).eval()
    network.features = Pyramid()
    with torch.no_grad():
        for part in (*network.propagation, *network.refine):  # which correct nothing
            part.body[-1].weight.zero_()
            part.body[-1].bias.zero_()
        for part in network.propagation:
            if part.sets == 2:
                part.body[-1].bias[-1 if of_coarser else -2] = 1
        assert_found(network.estimate(*shifted_pair(shift), CAMERA).disparity, shift)


class Sharp(nn.Module):
    """Stands for an aggregation: the correlation of 48 channels of unit length, as scores of one large value."""

    def forward(self, volume: Tensor, features: list[Tensor]) -> Tensor:
        return 48 * 200 * volume


@pytest.mark.parametrize("training", [True, False])
def test_the_disparity_of_lightstereo_is_that_of_the_best_score(training: bool) -> None:
    network = new_network(replace(TINY["light-stereo"], widths=(8, 8, 48, 8, 8, 8, 8))).train(training)
    network.features, network.aggregation = Cells(several=True), Sharp()
    with torch.no_grad():
        maps = network.estimate(*shifted_pair(5 * CELL), CAMERA).maps
    assert len(maps) == 1 + training
    for disparity in maps:
        assert_found(disparity, 5 * CELL)


def test_the_stages_of_unimvsnet_focus_less_and_less() -> None:
    """Their losses where all planes are sure to be empty, as published: weights 0.5, 1 and 2, exponents 2, 1 and 0."""
    true = torch.full((1, 1, 1, 1), 4.0)
    sweeps = tuple(Sweep(torch.full((1, 8, 1, 1), -40.0), torch.zeros_like(true), 1.0, 1) for _ in range(3))
    truth = Truth(true, torch.ones_like(true, dtype=torch.bool), torch.zeros(1, 3, 1, 1))
    terms = UnifiedOutput(true, sweeps).terms(truth)
    missed = 1 + 4 * (1 / (1 + 5**-1.0) - 0.5)
    assert [*map(float, terms.values())] == pytest.approx([0.5 * 5 * missed**2, 5 * missed, 2 * 5])


def seen_plane() -> tuple[NormalInput, Tensor]:
    """Return what the methods for normals get of a plane, and its normals (1, 3, 32, 48)."""
    size = (32, 48)
    normal = unit(torch.tensor([0.1, -0.8, -1.0])[None, :, None, None]).expand(1, 3, *size)
    disparity = -(60 * 0.27 / 1.2) * (pixel_rays(CAMERA, *size) * normal).sum(1, keepdim=True)
    images = torch.rand(1, 3, *size, generator=torch.Generator().manual_seed(0))
    return NormalInput(images, disparity, torch.ones_like(disparity, dtype=torch.bool), CAMERA), normal


def test_fusion_takes_as_much_of_the_depth_as_it_is_confident_at_every_scale() -> None:
    network = new_network(TINY["fusion"]).train()
    seen, _ = seen_plane()
    other = seen._replace(disparity=seen.disparity.flip(2) ** 2)
    last = network.confidence[-1]
    with torch.no_grad():
        last.weight.zero_()
        for confidence in (0.0, 1.0):
            last.bias.fill_(confidence)
            first, second = (network.normals(inputs).trained for inputs in (seen, other))
            assert [maps.cell for maps in first] == [1, 2, 4, 8]
            for one, two in zip(first, second, strict=True):
                assert torch.equal(one.normal, two.normal) == (confidence == 0)


class Returns(nn.Module):
    """Stands for a network: returns a part of its input, or something given."""

    def __init__(self, channels: slice = slice(None), given: Tensor | None = None, factor: float = 1.0) -> None:
        super().__init__()
        self.channels, self.given, self.factor = channels, given, factor

    def forward(self, x: Tensor) -> Tensor:
        return self.factor * x[:, self.channels] if self.given is None else self.given


def test_geonet_corrects_normals_by_depth_and_depth_by_normals() -> None:
    """The last networks take what geometry says: planes of the depth, and depth without its noise."""
    network = new_network(TINY["geo-net"])
    seen, normal = seen_plane()
    turned = unit(normal + torch.tensor([0.2, 0.0, 0.0])[:, None, None])
    noise = 0.1 * torch.randn(seen.disparity.shape, generator=torch.Generator().manual_seed(0))
    network.joined_normals, network.joined_depths = Returns(slice(3, 6)), Returns(slice(1, 2), factor=1 / SHARP)
    with torch.no_grad():
        network.residual.layers[-1].weight.zero_()
        network.first = Returns(given=turned)
        by_depth = network.normals(seen).normal
        network.first = Returns(given=normal)
        by_normals = network.normals(seen._replace(disparity=seen.disparity + noise)).disparity
    torch.testing.assert_close(by_depth, normal, atol=1e-3, rtol=0)
    assert (by_normals - seen.disparity).std() < 0.5 * noise.std()
