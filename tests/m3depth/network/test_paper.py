"""The `paper` preset against the tables of the paper, whose shapes are written out here by hand."""

from dataclasses import replace

import pytest
import torch
from torch import nn

from m3depth.network.config import LITE, PAPER, PAPER_THIN
from m3depth.network.model import M3Depth
from m3depth.network.wavelet import WaveletConv

D = 24
TABLE_1 = {  # module: kernel, stride, padding, output shape of one image (Table I, 512 x 512)
    "backbone.stem.0.0": ((7, 7), 2, 3, (64, 256, 256)),  # Conv1
    "backbone.stem.1.0": ((3, 3), 1, 1, (64, 256, 256)),  # Conv2
    "backbone.quarter.0.0": ((3, 3), 2, 1, (128, 128, 128)),  # Conv3
    "backbone.quarter.1.first.0": ((3, 3), 1, 1, (128, 128, 128)),  # Conv4, by wavelets
    "backbone.eighth.0.0": ((3, 3), 2, 1, (256, 64, 64)),  # Conv5
    "backbone.eighth.1.first.0": ((3, 3), 1, 1, (256, 64, 64)),  # Conv6, by wavelets
    "aggregation.first.0": ((3, 3, 3), 1, 1, (128, D, 64, 64)),  # Conv7
    "aggregation.second.0": ((3, 3, 3), 1, 1, (64, D, 64, 64)),  # Conv8
    "aggregation.head.layers.0": ((4, 4), 2, 1, (64, D, 128, 128)),  # Upsample1
    "aggregation.head.layers.1": ((4, 4), 2, 1, (64, D, 256, 256)),  # Upsample2
    "aggregation.head.layers.2": ((4, 4), 2, 1, (64, D, 512, 512)),  # Upsample3
}
TABLE_2 = {  # module: input and output shape of one pair (Table II); D' = D / 8 slices
    "normals.volume": ((67, D, 512, 512), (67, D // 8, 512, 512)),
    "normals.slice": ((67, 512, 512), (3, 512, 512)),
    "normals": ((64, D, 512, 512), (3, 512, 512)),
}


LAYERS_2 = {  # module: kernel, stride, padding, dilation (the text: stride 2 in depth; nothing of dilation)
    "normals.volume.0.0": ((3, 3, 3), (2, 1, 1), (1, 1, 1), (1, 1, 1)),
    "normals.volume.1.0": ((3, 3, 3), (2, 1, 1), (1, 1, 1), (1, 1, 1)),
    "normals.volume.2.0": ((3, 3, 3), (2, 1, 1), (1, 1, 1), (1, 1, 1)),
    "normals.slice.0.0": ((3, 3), (1, 1), (1, 1), (1, 1)),
    "normals.slice.1": ((3, 3), (1, 1), (1, 1), (1, 1)),
}


@pytest.fixture(scope="module")
def layers_and_shapes() -> tuple[M3Depth, dict[str, tuple], dict[str, tuple]]:
    """The network at full size without numbers; the shapes that went into and came out of each of its modules."""
    into, out = {}, {}
    with torch.device("meta"):
        model = M3Depth.from_preset("paper")
        for name, module in model.named_modules():

            def note(_module, inputs, result, name=name):
                if isinstance(result, torch.Tensor):
                    into[name], out[name] = inputs[0].shape, result.shape

            module.register_forward_hook(note)
        images = torch.zeros(2, 1, 3, 512, 512)
        result = model(images[0], images[1], torch.zeros(1, 4))
    assert result.disparity.shape == (1, 1, 512, 512) and result.normal.shape == (1, 3, 512, 512)
    assert [tuple(x.shape) for x in result.initial] == [(1, 1, 512, 512), (1, 3, 512, 512)]
    assert len(result.steps) == 5
    return model, into, out


@pytest.mark.parametrize("name", TABLE_1)
def test_layers_are_those_of_the_first_table(layers_and_shapes, name: str) -> None:
    model, _, out = layers_and_shapes
    kernel, stride, padding, shape = TABLE_1[name]
    layer = model.get_submodule(name)
    if isinstance(layer, WaveletConv):
        assert layer.levels == 3  # the paper's best
        layer = layer.base
    assert isinstance(layer, nn.Conv2d | nn.Conv3d | nn.ConvTranspose3d)
    assert layer.kernel_size[-len(kernel) :] == kernel
    assert set(layer.stride[-2:]) == {stride} and set(layer.padding[-2:]) == {padding}
    assert tuple(out[name][1:]) == shape


def test_the_extractor_has_six_convolutions_and_wavelets_at_two_of_them(layers_and_shapes) -> None:
    model, _, _ = layers_and_shapes
    inside = [n for n, m in model.backbone.named_modules() if isinstance(m, WaveletConv)]
    convolutions = [n for n, m in model.backbone.named_modules() if isinstance(m, nn.Conv2d)]
    assert len(inside) == 2
    assert sum(not n.startswith(tuple(inside)) for n in convolutions) == 4


def test_the_cost_volume_compares_256_channels_in_64_groups(layers_and_shapes) -> None:
    _, into, out = layers_and_shapes
    assert tuple(out["backbone.eighth.1"]) == (2, 256, 64, 64)  # left and right features
    assert tuple(into["aggregation.first.0"][1:]) == (64, D, 64, 64)  # Unfold & Compare
    assert "match" not in out  # the features are compared as they are


@pytest.mark.parametrize("name", TABLE_2)
def test_normals_are_made_as_in_the_second_table(layers_and_shapes, name: str) -> None:
    model, into, out = layers_and_shapes
    before, after = TABLE_2[name]
    assert (tuple(into[name][1:]), tuple(out[name][1:])) == (before, after)
    if name == "normals.slice":
        assert into[name][0] == D // 8  # one 2-D network for all slices
    count = {"normals.volume": (nn.Conv3d, 3), "normals.slice": (nn.Conv2d, 2)}.get(name)
    if count:
        assert sum(isinstance(m, count[0]) for m in model.get_submodule(name).modules()) == count[1]


def test_normals_have_the_layers_of_the_second_table_and_no_others(layers_and_shapes) -> None:
    model, _, _ = layers_and_shapes
    present = {
        n: m for n, m in model.named_modules() if isinstance(m, nn.Conv2d | nn.Conv3d) and n.startswith("normals")
    }
    layers = {n: (m.kernel_size, m.stride, m.padding, m.dilation) for n, m in present.items()}
    assert layers == LAYERS_2
    kinds = [type(m) for m in model.get_submodule("normals").modules() if not list(m.children())]
    block = [nn.GroupNorm, nn.ReLU]  # for the table's BN + ReLU
    assert kinds == [nn.Conv3d, *block] * 3 + [nn.Conv2d, *block] + [nn.Conv2d]  # the last one linear


def test_convolutions_of_the_extractor_are_normalised_and_activated(layers_and_shapes) -> None:
    model, _, _ = layers_and_shapes
    kinds = [type(m) for n, m in model.backbone.named_modules() if not list(m.children()) and ".first.0" not in n]
    assert kinds.count(nn.GroupNorm) == kinds.count(nn.ReLU) == 6


def test_forward_and_backward_reach_every_parameter(training_loss) -> None:
    torch.manual_seed(0)
    model = M3Depth.from_preset("paper").train()
    training_loss(model).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all(), name


def test_recomputing_activations_changes_no_gradient_and_keeps_less(training_loss) -> None:
    torch.manual_seed(0)
    thin = replace(PAPER, channels=(8, 8, 16), groups=8, hypotheses=8, volume_width=8, residual_width=8, hidden=16)
    model = M3Depth(replace(thin, normal_widths=(11, 11, 11), motion=8)).train()
    reference: list[int] = []

    def note(tensor: torch.Tensor) -> torch.Tensor:
        reference[-1] += tensor.numel()
        return tensor

    present = []
    for model.recompute in (False, True):
        reference.append(0)
        model.zero_grad()
        with torch.autograd.graph.saved_tensors_hooks(note, lambda tensor: tensor):
            training_loss(model).backward()
        present.append({name: p.grad.clone() for name, p in model.named_parameters() if p.grad is not None})
    plain, recomputed = present
    assert plain.keys() == recomputed.keys() == dict(model.named_parameters()).keys()
    for name, gradient in plain.items():
        torch.testing.assert_close(recomputed[name], gradient, msg=name)
    assert reference[1] < reference[0] / 3


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_training_step_at_full_size_fits_a_gpu(training_loss) -> None:
    """One pair, recomputed, fits any; where there is memory, half of the paper's batch, as --accumulate 2 takes it."""
    model = M3Depth(PAPER).cuda().train()
    large = torch.cuda.get_device_properties(0).total_memory > 75e9
    model.recompute, batch = not large, 6 if large else 1
    with torch.autocast("cuda", torch.bfloat16):
        loss = training_loss(model, 512, batch)
    loss.backward()
    assert torch.isfinite(loss)


def test_the_thin_network_has_the_papers_parts_alone_at_the_widths_of_lite() -> None:
    widths = {"channels", "groups", "volume_width", "output_head", "normal_widths", "hidden", "motion"}
    changed = {name for name, value in PAPER_THIN.to_dict().items() if value != PAPER.to_dict()[name]}
    assert changed == widths and PAPER_THIN.channels == LITE.channels
    with torch.device("meta"):
        network = M3Depth(PAPER_THIN)
    assert network.refinement is not None and network.refinement.match is None and network.fine is None
    assert (PAPER_THIN.wavelet_levels, PAPER_THIN.refine_steps) == ((3, 3), 5)
    assert sum(p.numel() for p in network.parameters()) < 2e6
    image = torch.zeros(1, 3, 64, 128, device="meta")
    output = network(image, image, torch.zeros(1, 4, device="meta"))
    assert output.disparity.shape == (1, 1, 64, 128) and len(output.steps) == 5
