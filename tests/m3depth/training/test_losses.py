from math import log
from types import SimpleNamespace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_target import CAMERA, make_target, plane, random_holes, with_holes
from small_network import SMALL

from m3depth.network.geometry import pixel_rays, unit
from m3depth.network.model import M3Depth
from m3depth.network.output import StereoOutput
from m3depth.training.batch import Target, disparity_edges, reduce_target, whole_batch
from m3depth.training.config import PAPER_LOSS
from m3depth.training.loss_config import LossConfig
from m3depth.training.losses import (
    consistency_loss,
    consistency_residual,
    disparity_loss,
    huber,
    pixel_weights,
    sky_loss,
    total_loss,
    trained_maps,
    weighted_mean,
)
from m3depth.training.packing import pack


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_consistency_is_zero_on_planes_alone(nx: float, ny: float) -> None:
    disparity, normal = plane((nx, ny, -1.0))
    mask = torch.ones_like(disparity, dtype=torch.bool)
    assert consistency_loss(disparity, normal, CAMERA, mask) < 1e-12
    _, tilted = plane((nx + 0.3, ny, -1.0))
    assert consistency_loss(disparity, tilted, CAMERA, mask) > 1e-3
    assert consistency_loss(disparity + 0.1 * torch.arange(24), normal, CAMERA, mask) > 1e-3


def test_consistency_takes_normals_across_the_view() -> None:
    """A wall at the side of the camera: n_z = 0, where the paper's form divides by zero."""
    disparity, normal = plane((1.0, 0.0, 0.0), 16, 8)  # cx = 9.3: all pixels look to the left, at the wall
    residual, usable = consistency_residual(disparity, normal, CAMERA)
    assert usable.any()
    assert residual[usable.expand_as(residual)].abs().max() < 1e-10


def test_consistency_ignores_edges_borders_and_grazing_pixels() -> None:
    disparity, normal = plane((0.0, -0.4, -1.0))
    torch.manual_seed(0)
    spoiled = disparity.clone()
    spoiled[..., 10:, :] += 40 * torch.rand(1, 1, 6, 24, dtype=torch.float64)
    mask = ~disparity_edges(spoiled)
    assert 0.2 < mask.double().mean() < 0.9
    assert consistency_loss(spoiled, normal, CAMERA, mask) < 1e-12
    grazing, _ = consistency_residual(*plane((0.0, -1.0, -0.0)), CAMERA)
    assert torch.isfinite(grazing).all()


def test_consistency_gradients() -> None:
    torch.manual_seed(0)
    disparity, normal = plane((0.1, -0.3, -1.0), 6, 6)
    disparity = (disparity + 0.3 * torch.randn_like(disparity)).requires_grad_()
    normal = (normal + 0.05 * torch.randn_like(normal)).requires_grad_()
    mask = torch.ones_like(disparity, dtype=torch.bool)
    assert torch.autograd.gradcheck(lambda d, n: consistency_loss(d, n, CAMERA, mask), (disparity, normal))


def test_huber_norms_have_slope_one_beyond_their_knee() -> None:
    """Over delta: torch's huber_loss divided by it."""
    error = torch.linspace(-2, 2, 41)
    for delta in (0.05, 0.5):
        expected = torch.nn.functional.huber_loss(error, torch.zeros(41), delta=delta, reduction="none") / delta
        torch.testing.assert_close(huber(error, delta), expected)


def test_every_grid_is_trained_with_its_share_and_its_truth() -> None:
    target, config = make_target(), LossConfig(decay=0.5, initial=0.3)
    output = output_of(target)
    maps = trained_maps(output, target, torch.ones_like(target.disparity), config)
    assert [(m.share, m.cell) for m in maps] == [(1.0, 1), (0.5, 4), (0.25, 4), (0.3, 8)]
    assert maps[1].disparity is output.steps[-1][0]
    for m in maps:
        assert m.target.disparity.shape == m.disparity.shape == m.weight.shape
    assert output.initial is not None
    finer = output._replace(initial=output.steps[0], steps=[])
    assert [m.cell for m in trained_maps(finer, target, torch.ones_like(target.disparity), config)] == [1, 4]
    begun = output._replace(initial=None)
    assert [m.cell for m in trained_maps(begun, target, torch.ones_like(target.disparity), config)] == [1, 4, 4]


def test_the_total_is_the_weighted_sum_of_the_terms() -> None:
    target, config = make_target(), LossConfig(disparity=2, normal=0.7, consistency=3, confidence=0.2, sky=0.3)
    total, terms = total_loss(output_of(target, 0.3), target, config)
    assert terms.keys() == {"disparity", "normal", "consistency", "confidence", "sky"}
    torch.testing.assert_close(total, sum(getattr(config, name) * value for name, value in terms.items()))
    assert "consistency" not in total_loss(output_of(target), target, LossConfig(consistency=0))[1]


def test_rocks_weigh_what_their_weight_says_edges_or_not() -> None:
    target = make_target()._replace(disparity=torch.full((1, 1, 16, 24), 4.0))
    target.disparity[..., 12:] = 12.0
    target.rock[..., :4, :] = True
    weight = pixel_weights(target, LossConfig(rock=4, edge=3))
    assert (weight[..., :4, :] == 4).all()
    assert (weight[..., 4:, 11:13] == 3).all() and (weight[..., 4:, :11] == 1).all()


def test_pixels_of_one_eye_and_of_the_rover_weigh_a_part_of_what_others_do() -> None:
    target = make_target()
    target.rock[..., :4, :] = True
    target.one_eye[..., :6] = True
    target.rover[..., :2, :] = True
    weight = pixel_weights(target, LossConfig(rock=4, one_eye=0.5, rover=0.25))
    assert (weight[..., 2:4, :6] == 2).all() and (weight[..., 4:, :6] == 0.5).all() and (weight[..., 4:, 6:] == 1).all()
    assert (weight[..., :2, :6] == 0.5).all() and (weight[..., :2, 6:] == 1).all()


def test_a_few_pixels_with_weight_do_not_count_as_a_whole_batch() -> None:
    values, weight = torch.full((10,), 3.0), torch.zeros(10)
    weight[0] = 1
    assert weighted_mean(values, weight).item() == pytest.approx(3)
    assert weighted_mean(values, weight, least=0.5).item() == pytest.approx(3 / 5)
    weight[:6] = 1
    assert weighted_mean(values, weight, least=0.5).item() == pytest.approx(3)


def test_later_steps_weigh_more_and_the_first_maps_as_much_as_initial_says() -> None:
    """One pixel of error in one of three steps, the oldest first, in soft argmin, and in the result."""
    target, config = make_target(), LossConfig(decay=0.5, initial=0.3, relative=0)
    exact = output_of(target)
    disparity, normal = exact.steps[0]
    off, tilted = disparity + 1, normal.roll(1, 1)

    def cost(term: str, output: StereoOutput) -> float:
        return float(total_loss(output, target, config)[1][term])

    def stepped(wrong: int, instead) -> StereoOutput:
        return exact._replace(steps=[instead if step == wrong else (disparity, normal) for step in range(3)])

    whole = cost("disparity", exact._replace(disparity=exact.disparity + 1))
    assert whole == pytest.approx(0.75)  # Huber's, over 0.5 px
    for step, share in enumerate((0.125, 0.25, 0.5)):
        assert cost("disparity", stepped(step, (off, normal))) == pytest.approx(share * whole)
    turned = cost("normal", exact._replace(normal=exact.normal.roll(1, 1)))
    for step, share in enumerate((0.125, 0.25, 0.5)):
        assert cost("normal", stepped(step, (disparity, tilted))) == pytest.approx(share * turned, rel=1e-4)
    first = exact._replace(initial=(exact.initial[0] + 1, exact.initial[1]))
    assert cost("disparity", first) == pytest.approx(0.3 * whole)


def test_an_error_weighs_more_where_disparities_are_small() -> None:
    """By `relative`: 4 px of disparity count double."""
    four = make_target()._replace(disparity=torch.full((1, 1, 16, 24), 4.0))
    eight = four._replace(disparity=2 * four.disparity)
    for target, relative, expected in ((four, 0, 0.75), (four, 4, 1.5), (eight, 4, 1.125), (four, 12, 3.0)):
        exact = output_of(target)._replace(steps=[])
        wrong = exact._replace(disparity=exact.disparity + 1)
        assert float(total_loss(wrong, target, LossConfig(relative=relative))[1]["disparity"]) == pytest.approx(
            expected
        )


def test_edges_weigh_as_much_as_the_weight_edge_says() -> None:
    """A step of disparity in the middle of the image: the two columns beside it are edges."""
    target = make_target()._replace(disparity=torch.full((1, 1, 16, 24), 4.0))
    target.disparity[..., 12:] = 12.0
    exact = output_of(target)._replace(steps=[])
    wrong = exact._replace(disparity=exact.disparity.clone())
    wrong.disparity[..., 11:13] += 1
    for edge, share in ((1.0, 2 / 24), (3.0, 6 / 28)):  # of the weight of all columns
        config = LossConfig(edge=edge, relative=0)
        assert float(total_loss(wrong, target, config)[1]["disparity"]) == pytest.approx(0.75 * share)


def test_masked_nan_does_not_reach_the_mean() -> None:
    values = torch.tensor([1.0, torch.nan, 3.0], requires_grad=True)
    mean = weighted_mean(values, torch.tensor([1.0, 0.0, 3.0]))
    assert mean.item() == pytest.approx(2.5)
    mean.backward()
    torch.testing.assert_close(values.grad, torch.tensor([0.25, 0.0, 0.75]))
    assert weighted_mean(torch.tensor([torch.nan]), torch.zeros(1)).item() == 0


def test_the_consistency_of_sparse_truth_is_trained() -> None:
    full = make_target(64, 96)
    target = with_holes(full, random_holes(full.label.shape))
    output = output_of(full)
    tilted = output._replace(normal=full.normal.roll(1, 1))
    assert total_loss(output, target, LossConfig())[1]["consistency"] < 1e-6
    assert total_loss(tilted, target, LossConfig())[1]["consistency"] > 0.01
    wrong = output._replace(initial=(output.initial[0] + 1, output.initial[1]), steps=[])
    assert total_loss(wrong, target, LossConfig())[1]["disparity"] > 0.5  # the coarse grid sees it


def output_of(target: Target, shift: float = 0.0) -> StereoOutput:
    ones = torch.ones_like(target.disparity)
    eighth, _ = reduce_target(target, 8, ones)
    quarter, _ = reduce_target(target, 4, ones)
    return StereoOutput(
        target.disparity + shift, target.normal, 20 * ones, -20 * ones,
        (eighth.disparity, eighth.normal), [(quarter.disparity, quarter.normal)] * 2,
    )  # fmt: skip


def test_truth_costs_nothing_and_rocks_cost_more() -> None:
    target = make_target()
    config = LossConfig()
    total, terms = total_loss(output_of(target), target, config)
    assert total < 1e-3, terms
    wrong = output_of(target)
    wrong.disparity[..., 4:8, 4:8] += 2.0
    plain = total_loss(wrong, target, config)[1]["disparity"]
    target.rock[..., 4:8, 4:8] = True
    assert total_loss(wrong, target, config)[1]["disparity"] > 2 * plain


def test_sky_costs_no_normals_and_little_disparity() -> None:
    target = make_target()
    target.sky[..., :8, :] = True
    target.label[..., :8, :] = False
    target.disparity[..., :8, :] = 0
    target.normal[..., :8, :] = 0
    output = output_of(make_target())
    total, terms = total_loss(output, target, LossConfig())
    assert torch.isfinite(total)
    assert terms["normal"] < 1e-3
    assert 0 < terms["disparity"] < 3
    assert terms["sky"] > 5, "the decision that half the image is no sky is wrong"


def test_pixels_of_unknown_depth_decide_nothing_about_the_sky() -> None:
    target = make_target()
    target.label[..., :8, :] = False
    output = output_of(target)
    output.sky[..., :8, :] = 20.0
    assert total_loss(output, target, LossConfig())[1]["sky"] < 1e-3


def test_no_disparity_is_trusted_in_the_sky_however_small() -> None:
    target = make_target()
    target.sky[..., :8, :], target.label[..., :8, :], target.disparity[..., :8, :] = True, False, 0
    output = output_of(target, 0.3)
    assert total_loss(output, target, LossConfig())[1]["confidence"] > 5, "half the image is trusted wrongly"
    output.confidence[..., :8, :] = -20.0
    assert total_loss(output, target, LossConfig())[1]["confidence"] < 1e-3


def test_without_true_normals_depth_is_trained_alone() -> None:
    target = make_target()
    output = output_of(target)
    blind = target._replace(normal=torch.zeros_like(target.normal))
    _, terms = total_loss(output, blind, LossConfig())
    assert terms["normal"] == 0 and terms["disparity"] < 1e-3
    half = target._replace(normal=target.normal.clone())
    half.normal[..., 12:] = 0
    output.normal[..., :8] = 0.5  # wrong where the truth is known
    assert total_loss(output, half, LossConfig())[1]["normal"] > 0.1


def test_the_normals_of_the_papers_loss_are_a_mean_however_few_are_known() -> None:
    target = make_target()
    output = output_of(target)
    output.normal[...] = torch.tensor([0.0, 0.6, -0.8])[:, None, None]
    few = target._replace(normal=target.normal.clone())
    few.normal[..., 8:] = 0
    for config, same in ((PAPER_LOSS, True), (LossConfig(), False)):
        all_known, few_known = (total_loss(output, truth, config)[1]["normal"] for truth in (target, few))
        assert (abs(all_known / few_known - 1) < 0.2) == same


@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf"), 1e300])
def test_weights_that_cannot_work_name_their_flag(value) -> None:
    with pytest.raises(ValueError, match=r"--loss\.sky-disparity must lie in \[0, 1000\]"):
        LossConfig(sky_disparity=value)
    with pytest.raises(ValueError, match=r"--loss\.decay must lie in \[0, 2\]"):
        LossConfig(decay=value)


@pytest.mark.parametrize("inner", [0.0, 1.0])
def test_consistency_reaches_both_branches_where_it_is_asked_of_every_step(plane_samples, inner: float) -> None:
    torch.manual_seed(0)
    network = M3Depth(SMALL)
    batch = whole_batch(pack(plane_samples[0]))
    alone = LossConfig(disparity=0, normal=0, confidence=0, sky=0, consistent_steps=inner)
    total_loss(network(batch.left, batch.right, batch.target.camera), batch.target, alone)[0].backward()
    for branch in (network.normals, network.aggregation):
        moved = sum(float(p.grad.abs().sum()) for p in branch.parameters() if p.grad is not None)
        assert (moved > 0) == (inner > 0 or branch is network.aggregation)  # its context feeds the refinement


def wall(disparity: torch.Tensor) -> Target:
    """A wall across the view, or several behind each other, of this disparity (1, 1, 64, 96)."""
    camera = torch.tensor([[60.0, 60.0, 47.5, 31.5]])
    normal = torch.tensor([0.0, 0.0, -1.0])[:, None, None].expand(1, 3, 64, 96)
    no = torch.zeros_like(disparity, dtype=torch.bool)
    return Target(disparity, normal, ~no, no, no, no, no, camera, torch.tensor([0.27]))


def true_but_on_one_grid(target: Target, cell: int, disparity: torch.Tensor) -> StereoOutput:
    """The truth as the last maps, and another disparity (1, 1, 64, 96) on the grid of 4 or 8 px, if `cell` is one."""
    maps = disparity[..., ::cell, ::cell], target.normal[..., ::cell, ::cell]
    logits = torch.zeros_like(disparity)
    return StereoOutput(
        target.disparity, target.normal, logits, logits, maps if cell == 8 else None, [maps] if cell == 4 else []
    )


@pytest.mark.parametrize("cell", [1, 4, 8])
def test_true_maps_are_consistent_beside_a_silhouette_on_every_grid(cell: int) -> None:
    """A wall before another one: the step between them is no slope."""
    disparity = torch.full((1, 1, 64, 96), 20.0)
    disparity[..., 40:] = 60.0
    target = wall(disparity)
    output = true_but_on_one_grid(target, cell, disparity)
    assert float(total_loss(output, target, LossConfig())[1]["consistency"]) == 0


@pytest.mark.parametrize("cell", [4, 8])
def test_a_slope_that_no_normals_explain_costs_the_same_on_every_grid(cell: int) -> None:
    target = wall(torch.full((1, 1, 64, 96), 20.0))
    output = true_but_on_one_grid(target, cell, target.disparity + 0.2 * torch.arange(96))
    cost = total_loss(output, target, LossConfig(decay=0.5, initial=0.5, consistent_steps=1))[1]["consistency"]
    assert float(cost) == pytest.approx(0.5 * (0.2 - 0.05 / 2), rel=1e-3)  # Huber's, over 0.05


def test_grazing_is_an_angle_to_the_ray_also_at_the_border_of_a_wide_view():
    camera = torch.tensor([[10.0, 10.0, 11.5, 7.5]], dtype=torch.float64)
    ray = unit(pixel_rays(camera, 16, 24))
    beside = unit(torch.stack([-ray[:, 1], ray[:, 0], torch.zeros_like(ray[:, 0])], 1) + 1e-9)
    for sine, is_usable in ((0.055, True), (0.045, False)):
        normal = beside * (1 - sine**2) ** 0.5 - ray * sine
        usable = consistency_residual(torch.ones_like(ray[:, :1]), normal, camera)[1]
        assert (usable[..., 1:-1, 1:-1] == is_usable).all()


def test_disparities_under_a_pixel_weigh_no_more_than_one_of_a_pixel():
    target = make_target()
    for true in (0.2, 1.0):
        close = target._replace(disparity=torch.full_like(target.disparity, true))
        loss = disparity_loss(close.disparity + 2, close, torch.ones_like(close.disparity), LossConfig(relative=4.0))
        assert float(loss) == pytest.approx(1.75 * (1 + 4), rel=1e-5)


def test_pixels_without_weight_do_not_count_in_the_loss_of_the_sky():
    target = make_target()
    logit, weight = torch.zeros_like(target.disparity), torch.ones_like(target.disparity)
    logit[..., :12], weight[..., :12] = 9.0, 0.0  # the rover, say, that is taken for sky
    assert float(sky_loss(SimpleNamespace(sky=logit), target, weight)) == pytest.approx(log(2), rel=1e-5)
