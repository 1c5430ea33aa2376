"""The paper's recipe: its defaults, its loss, its first weights, and epochs as steps."""

import json
from dataclasses import replace

import pytest
import torch
from plane_target import make_target
from small_rivals import TINY, train_config

from m3depth.kinds.networks import draw_normal, new_network
from m3depth.network.config import PRESETS
from m3depth.network.geometry import pixel_rays
from m3depth.network.output import StereoOutput
from m3depth.training.batch import Target
from m3depth.training.config import PAPER, PAPER_LOSS, TrainConfig, in_steps, recipe_defaults
from m3depth.training.loop import train
from m3depth.training.loss_config import LossConfig
from m3depth.training.losses import confidence_loss, disparity_loss, sky_loss, total_loss
from m3depth.training.run import Run, learning_rate
from marssim.base.command.flags import parse

PAPER_TERMS = ("disparity", "normal", "consistency")

pytestmark = pytest.mark.usefixtures("undrawn_figures")


def parsed(*args: str) -> TrainConfig:
    line = ["--data", "data", "--out", "out", *args]
    return parse(TrainConfig, "train", None, line, recipe_defaults(line))


def test_the_recipe_sets_defaults_that_other_flags_override() -> None:
    config = parsed("--recipe", "paper", "--epochs", "100")
    assert (config.lr, config.schedule, config.batch, config.epochs, config.weight_decay) == (
        1e-4,
        "constant",
        12,
        100,
        0,
    )
    assert (config.loss.disparity, config.loss.normal, config.loss.consistency) == (2, 1, 3)
    assert config.loss == PAPER_LOSS and config.augment == PAPER.augment and config.initial == "normal"
    other = parsed("--recipe=paper", "--lr", "8e-4", "--loss.no-depth", "--augment.noise", ".1", "--crop", "64", "64")
    assert (other.lr, other.loss.depth, other.augment.noise, other.crop) == (8e-4, False, 0.1, (64, 64))
    assert (other.batch, other.augment.scale) == (12, 0)
    assert parsed() == parsed("--recipe", "own") == TrainConfig(parsed().data, parsed().out)
    for line, recipe in (
        (("--recipe", "paper", "--recipe=own"), "own"),
        (("--recipe=own", "--recipe", "paper"), "paper"),
    ):
        last = parsed(*line)  # of a flag that is given twice, the last one counts
        assert last.recipe == recipe and last.lr == parsed("--recipe", recipe).lr


def test_epochs_are_steps_of_all_processes_and_the_fewer_steps_count(tmp_path) -> None:
    config = train_config(tmp_path, epochs=3, max_steps=None, batch=4)
    assert in_steps(config, 10, 1).max_steps == 8
    assert in_steps(config, 10, 2).max_steps == 4
    assert in_steps(config, 10, 1).epochs == 3
    fewer, more = (in_steps(train_config(tmp_path, epochs=3, max_steps=n, batch=4), 10, 1) for n in (5, 50))
    assert (fewer.max_steps, fewer.epochs, more.max_steps, more.epochs) == (5, None, 8, 3)


def test_a_constant_rate_does_not_change() -> None:
    assert {learning_rate(1e-4, share, "constant") for share in (0.0, 0.3, 1.0)} == {1e-4}


def test_the_error_is_that_of_depth_over_15_m() -> None:
    target = make_target()
    focal = float(target.camera[0, 0])
    flat = target._replace(disparity=torch.full_like(target.disparity, focal * 0.27 / 6))  # 6 m
    config, weight = LossConfig(depth=True), torch.ones_like(flat.disparity)
    at_9_m = torch.full_like(flat.disparity, focal * 0.27 / 9)
    torch.testing.assert_close(disparity_loss(at_9_m, flat, weight, config), torch.tensor(0.5 * (3 / 15) ** 2))


def paper_terms(target: Target, disparity: torch.Tensor, normal: torch.Tensor) -> dict[str, float]:
    """The terms of the paper's loss for maps at full size."""
    logits = torch.zeros_like(disparity)
    terms = total_loss(StereoOutput(disparity, normal, logits, logits, None, []), target, PAPER_LOSS)[1]
    return {name: float(terms[name]) for name in PAPER_TERMS}


def wall(depth: torch.Tensor) -> tuple[Target, torch.Tensor, torch.Tensor]:
    """A wall across the view: its target, and disparity and normals of a depth map [m], (H, W)."""
    target = make_target(*depth.shape)
    disparity = (float(target.camera[0, 0]) * 0.27 / depth)[None, None]
    normal = torch.tensor([0.0, 0.0, -1.0])[None, :, None, None].expand_as(target.normal)
    return target._replace(disparity=disparity, normal=normal), disparity, normal


def test_consistency_and_normals_have_the_knee_and_the_unit_of_the_depth() -> None:
    at_6_m, disparity, facing = wall(torch.full((16, 24), 6.0))
    turned = torch.tensor([0.0, 0.75**0.5, -0.5])[None, :, None, None].expand_as(facing)  # by 60 deg: an error of 1
    assert paper_terms(at_6_m, disparity, facing) == pytest.approx(dict.fromkeys(PAPER_TERMS, 0), abs=1e-6)
    assert paper_terms(at_6_m, disparity, turned)["normal"] == pytest.approx(0.5, rel=1e-4)
    _, receding, _ = wall(6 + 0.06 * torch.arange(24.0).expand(16, 24))  # by 6 cm a column, under normals without slope
    assert paper_terms(at_6_m, receding, facing)["consistency"] == pytest.approx(0.5 * (0.06 / 15) ** 2, rel=1e-3)


def test_what_lies_beyond_15_m_has_no_loss() -> None:
    beyond, _, _ = wall(torch.full((16, 24), 15.1))
    _, near, _ = wall(6 + 0.06 * torch.arange(24.0).expand(16, 24))
    turned = torch.tensor([0.0, 0.8, -0.6])[None, :, None, None].expand_as(beyond.normal)
    assert paper_terms(beyond, near, turned) == dict.fromkeys(PAPER_TERMS, 0)


def test_consistency_with_depth_is_that_of_normals_turned_round() -> None:
    target, receding, facing = wall(6 + 0.06 * torch.arange(24.0).expand(16, 24))
    expected = paper_terms(target, receding, facing)["consistency"]
    assert paper_terms(target, receding, -facing)["consistency"] == pytest.approx(expected) and expected > 0


def test_sky_and_confidence_hardly_move_what_they_share_with_the_depth() -> None:
    torch.manual_seed(0)
    network = new_network(replace(PRESETS["paper-thin"], hidden=8, channels=(4, 8, 16), groups=4, volume_width=4))
    draw_normal(network)
    target = make_target(64, 128)
    output = network(torch.rand(1, 3, 64, 128), torch.rand(1, 3, 64, 128), target.camera)
    decisions = PAPER_LOSS.confidence * confidence_loss(output, target)
    decisions = decisions + PAPER_LOSS.sky * sky_loss(output, target, torch.ones_like(target.disparity))
    no_others = replace(PAPER_LOSS, normal=0.0, consistency=0.0, confidence=0.0, sky=0.0)
    depth, _ = total_loss(output, target, no_others)
    pulls = [gradient_norm(loss, network.backbone) for loss in (decisions, depth)]
    assert 0 < pulls[0] < 0.1 * pulls[1]


def gradient_norm(loss: torch.Tensor, part: torch.nn.Module) -> float:
    parameters = [p for p in part.parameters() if p.requires_grad]
    gradients = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
    return float(torch.cat([g.flatten() for g in gradients if g is not None]).norm())


def test_a_normal_that_faces_away_is_turned_round() -> None:
    """Where training bent it towards the camera, as results are, its gradient would nearly vanish."""
    torch.manual_seed(0)
    network = new_network(replace(PRESETS["paper-thin"], hidden=8, channels=(4, 8, 16), groups=4, volume_width=4))
    draw_normal(network)
    camera, pair = make_target(64, 128).camera, torch.rand(2, 1, 3, 64, 128)
    rays = pixel_rays(camera, 64, 128)
    trained, result = ((network.train(mode)(*pair, camera).normal * rays).sum(1) for mode in (True, False))
    assert (trained > 0.1).float().mean() > 0.05 and (result < 0).all()


def test_a_disparity_under_1_px_is_pulled_towards_the_truth_along_the_tangent_of_depth() -> None:
    target = make_target()
    least = float(target.camera[0, 0]) * 0.27 / 15  # [px] at 15 m
    near = target._replace(disparity=torch.full_like(target.disparity, 2 * least))  # half of that depth
    config, weight = LossConfig(depth=True), torch.ones_like(near.disparity)
    for value, depth in ((0.5, 1.5 * least), (0.0, 2 * least), (-1.0, 3 * least)):
        given = torch.full_like(near.disparity, value, requires_grad=True)
        loss = disparity_loss(given, near, weight, config)
        torch.testing.assert_close(loss, torch.tensor(depth - 0.5 - 0.5))  # an error of depth - 1/2, beyond the knee
        (slope,) = torch.autograd.grad(loss, given)
        torch.testing.assert_close(slope.sum(), torch.tensor(-least))


@pytest.mark.parametrize(("kernel", "stride"), [(3, 1), (4, 2), (2, 2)])
def test_transposed_convolutions_give_inputs_of_variance_1_the_variance_2(kernel, stride) -> None:
    torch.manual_seed(0)
    layer = torch.nn.ConvTranspose2d(256, 8, kernel, stride)
    draw_normal(layer)
    with torch.no_grad():
        inside = layer(torch.randn(4, 256, 24, 24))[..., kernel:-kernel, kernel:-kernel]
    assert float(inside.square().mean()) == pytest.approx(2, rel=0.1)


def test_all_first_weights_are_drawn_from_normal_distributions(tmp_path) -> None:
    network = new_network(PRESETS["lite"])
    draw_normal(network)
    for name, layer in network.named_modules():
        if isinstance(layer, torch.nn.Conv2d) and layer.weight[0].numel() >= 64 and layer.weight.numel() > 4096:
            expected = (2 / layer.weight[0].numel()) ** 0.5
            assert float(layer.weight.detach().std()) == pytest.approx(expected, rel=0.1), name
            assert layer.bias is None or not layer.bias.any()
        if isinstance(layer, torch.nn.GroupNorm):
            assert (layer.weight == 1).all() and not layer.bias.any(), name
    sizes = tmp_path / "sizes.json"
    sizes.write_text(json.dumps(TINY["raft-stereo"].to_dict()))
    own, normal = (
        Run(train_config(tmp_path, network=sizes, initial=initial), torch.device("cpu")).model.state_dict()
        for initial in ("own", "normal")
    )
    assert any(not torch.equal(own[name], normal[name]) for name in own)


def test_a_training_by_the_recipe_takes_its_epochs(plane_samples, tmp_path, capsys) -> None:
    config = parsed(
        "--recipe", "paper", "--preset", "paper-thin", "--epochs", "1", "--crop", "64", "64", "--batch", "2",
        "--validate-samples", "0", "--device", "cpu", "--out", str(tmp_path / "run"),
    )  # fmt: skip
    train(config, plane_samples, [])
    records = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert {record["lr"] for record in records if "lr" in record} == {1e-4}
    assert train(config, plane_samples, []) == {}
    assert "already at --epochs 1" in capsys.readouterr().out
    train(replace(config, epochs=2), plane_samples, [])
    assert "goes on with other settings: --epochs 2 (was 1)" in capsys.readouterr().err
