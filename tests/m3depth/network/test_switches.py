"""Every part of the network can be left out or put in, and what is built trains."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from small_network import SMALL

from m3depth.network.config import PLAIN_UPSAMPLING, M3DepthConfig
from m3depth.network.model import M3Depth
from m3depth.network.wavelet import WaveletConv


def trains(config: M3DepthConfig, training_loss) -> M3Depth:
    """Every parameter gets a gradient, and a few steps lower the loss."""
    torch.manual_seed(0)
    model = M3Depth(config).train()
    optimizer = torch.optim.Adam(model.parameters(), 5e-3)
    losses = []
    for step in range(3):
        optimizer.zero_grad()
        loss = training_loss(model, 32)
        loss.backward()
        if step == 2:  # the last layers of the corrections start at zero, and so do the gradients before them
            silent = [name for name, p in model.named_parameters() if p.grad is None or not p.grad.any()]
            assert not silent
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.9 * losses[0]
    return model


@pytest.mark.parametrize(
    ("change", "absent"),
    [
        ({}, ()),
        ({"wavelet_levels": (0, 0)}, (WaveletConv,)),
        ({"wavelet_levels": (2, 0)}, ()),
        ({"wavelet_kernel": 5}, ()),
        ({"feature_skips": False}, ("backbone.quarter.1.second", "backbone.eighth.1.second")),
        ({"match_channels": 0}, ("match",)),
        ({"residual_width": 0}, ("aggregation.context", "aggregation.residual")),
        ({"output_head": 1, "score_kernel": 3}, ()),
        ({"output_head": 2, "residual_width": 0}, ()),
        ({"output_head": 3, **PLAIN_UPSAMPLING}, ("refinement", "fine")),
        ({"normal_context": 0}, ("normals.context",)),
        ({"slice_layers": 1}, ("normals.slice.1",)),
        ({"slice_dilated": False}, ()),
        (PLAIN_UPSAMPLING, ("refinement", "fine")),
        ({"refine_steps": 0, "lookup_levels": 0}, ("refinement.step", "refinement.bias", "refinement.match")),
        ({**PLAIN_UPSAMPLING, "fine_width": 8}, ("refinement.step", "refinement.upsample")),
        ({**PLAIN_UPSAMPLING, "convex_upsampling": True}, ("refinement.step", "fine")),
        ({"implied_geometry": False}, ()),
        ({"heads_see_all": True}, ()),
        ({"lookup_radius": 0}, ()),
        ({"lookup_levels": 0}, ("refinement.match", "refinement.step.correlation")),
        ({"fine_width": 0}, ("fine",)),
        ({"convex_upsampling": False}, ("refinement.upsample",)),
        ({"lookup_levels": 0, "fine_width": 0, "convex_upsampling": False}, ("refinement.match", "fine")),
    ],
)
def test_a_part_can_be_switched_and_the_rest_trains(training_loss, change, absent) -> None:
    model = trains(replace(SMALL, **change), training_loss)
    modules = dict(model.named_modules())
    for part in absent:
        if isinstance(part, str):
            assert part in dict(M3Depth(SMALL).named_modules()) and modules.get(part) is None
        else:
            assert not any(isinstance(module, part) for module in modules.values())


@pytest.mark.parametrize(
    ("change", "module", "shape"),
    [
        ({"output_head": 2}, "aggregation.head", (2, 8, 8, 16, 16)),
        ({"score_kernel": 3}, "aggregation.score", (2, 1, 8, 4, 4)),
        ({"heads_see_all": True}, "refinement.step.disparity.0", (2, 8, 8, 8)),
        ({"lookup_levels": 1, "lookup_radius": 2}, "refinement.step.correlation.0", (2, 8, 8, 8)),
    ],
)
def test_a_switch_puts_its_part_into_the_network(change, module, shape) -> None:
    torch.manual_seed(0)
    model = M3Depth(replace(SMALL, **change))
    shapes = []
    model.get_submodule(module).register_forward_hook(lambda m, i, out: shapes.append(tuple(out.shape)))
    left, right = torch.rand(2, 2, 3, 32, 32)
    model(left, right, torch.tensor([[60.0, 60, 16, 16]] * 2))
    assert shapes and set(shapes) == {shape}


def test_wavelets_have_the_levels_that_are_asked_for() -> None:
    model = M3Depth(replace(SMALL, wavelet_levels=(3, 1)))
    assert [m.levels for m in model.modules() if isinstance(m, WaveletConv)] == [3, 1]


def test_more_steps_use_the_same_weights() -> None:
    """T can be raised at test time: the recurrent step is shared."""
    torch.manual_seed(0)
    model = M3Depth(SMALL)
    longer = M3Depth(replace(SMALL, refine_steps=5))
    longer.load_state_dict(model.state_dict())
    left, right = torch.rand(2, 1, 3, 32, 32)
    camera = torch.tensor([[60.0, 60, 16, 16]])
    two, five = model(left, right, camera).steps, longer(left, right, camera).steps
    assert (len(two), len(five)) == (2, 5)
    torch.testing.assert_close(two[1][0], five[1][0])


def test_the_output_head_starts_as_bilinear_interpolation(training_loss) -> None:
    from m3depth.network.cost_volume import OutputHead

    volume = torch.randn(1, 3, 2, 5, 6)
    fine = OutputHead(3, 1)(volume)
    expected = torch.nn.functional.interpolate(volume[0], scale_factor=2, mode="bilinear")
    torch.testing.assert_close(fine[0, :, :, 1:-1, 1:-1], expected[..., 1:-1, 1:-1])


@pytest.mark.parametrize("bad", [{"feature_skips": 1}, {"hidden": True}, {"channels": [8, 8]}, {"depth": 3}])
def test_a_malformed_field_of_the_json_form_is_named(bad) -> None:
    with pytest.raises(ValueError, match=f"'{next(iter(bad))}'"):
        M3DepthConfig.from_dict(bad)
    assert M3DepthConfig.from_dict({"feature_skips": False}).feature_skips is False


def test_a_lookup_without_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="lookup_levels must be 0 where refine_steps is 0, got 2: the steps alone"):
        replace(SMALL, refine_steps=0)


def test_networks_from_before_the_switch_are_what_they_were() -> None:
    """Then a network without steps had none of the other parts, whatever its file says, and others had them all."""
    old = {k: v for k, v in asdict(SMALL).items() if k != "convex_upsampling"}
    assert M3DepthConfig.from_dict(old) == SMALL
    assert M3DepthConfig.from_dict({**old, "refine_steps": 0}) == replace(SMALL, **PLAIN_UPSAMPLING)
    stated = {**asdict(SMALL), "refine_steps": 0, "lookup_levels": 0}
    assert M3DepthConfig.from_dict(stated).fine_width == SMALL.fine_width


def test_maps_without_convex_upsampling_are_those_of_the_last_step_enlarged() -> None:
    torch.manual_seed(0)
    model = M3Depth(replace(SMALL, convex_upsampling=False, fine_width=0)).eval()
    left, right = torch.rand(2, 1, 3, 32, 64)
    out = model(left, right, torch.tensor([[60.0, 60, 32, 16]]))
    enlarged = torch.nn.functional.interpolate(out.steps[-1][0], (32, 64), mode="bilinear")
    torch.testing.assert_close(out.disparity, enlarged)


def test_without_steps_the_first_maps_are_enlarged_and_the_fine_correction_starts_there() -> None:
    """The correction starts as none, so the maps are the first ones on the grid at 1/4, enlarged."""
    torch.manual_seed(0)
    model = M3Depth(replace(SMALL, **{**PLAIN_UPSAMPLING, "fine_width": 8})).eval()
    left, right = torch.rand(2, 1, 3, 32, 64)
    camera = torch.tensor([[60.0, 60, 32, 16]])
    out = model(left, right, camera)
    assert out.initial is not None and out.steps == []
    interpolate = torch.nn.functional.interpolate
    quarter = interpolate(out.initial[0], (8, 16), mode="bilinear")
    torch.testing.assert_close(out.disparity, interpolate(quarter, (32, 64), mode="bilinear"))
    larger = model(*(interpolate(x, (64, 128), mode="bilinear") for x in (left, right)), 2 * camera, out.start(64, 128))
    assert larger.steps == [] and larger.disparity.shape == (1, 1, 64, 128)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"channels": (16, 48)}, r"^channels must be 3 whole numbers, got \(16, 48\)$"),
        ({"channels": 16}, "^channels must be 3 whole numbers"),
        ({"refine_steps": 2.5}, "^refine_steps must be a whole number, got 2.5$"),
        ({"hypotheses": "24"}, "^hypotheses must be a whole number"),
        ({"feature_skips": 1}, "^feature_skips must be True or False, got 1$"),
    ],
)
def test_a_size_of_another_kind_is_named(values, message):
    with pytest.raises(ValueError, match=message):
        M3DepthConfig(**values)


def test_sizes_may_be_lists_and_numbers_of_numpy():
    config = M3DepthConfig(channels=[16, np.int64(48), 96], hypotheses=np.int64(24), feature_skips=np.bool_(True))
    assert config == M3DepthConfig() and type(config.hypotheses) is int and config.channels == (16, 48, 96)
