"""What the methods for normals make of depth: geometry in closed form, true depth as input, and their losses."""

import hashlib
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from plane_pairs import plane_sample
from small_network import SMALL
from small_rivals import TINY, train_config

from m3depth.estimator import for_pair
from m3depth.evaluation.report import markdown_report, text_table
from m3depth.evaluation.scoring import evaluate
from m3depth.kinds.networks import load_network, new_network
from m3depth.network.geometry import facing_normals, normals_from_disparity, pixel_rays, unit
from m3depth.network.inference import working_sizes
from m3depth.network.model import M3Depth
from m3depth.rivals.geo_net import disparity_of_planes, planes_of_depth
from m3depth.rivals.normal_network import NormalInput, NormalOutput, TrainedNormals, normal_error
from m3depth.rivals.output import Truth
from m3depth.stereo.pairs import NEAREST
from m3depth.training.config import check_config
from m3depth.training.loop import train
from m3depth.training.run import first_network
from m3depth.wrapped_estimators import ReducedEstimator
from marssim.base.camera import NATECAM, StereoRig

pytestmark = pytest.mark.usefixtures("undrawn_figures")

CAMERA = torch.tensor([[60.0, 55.0, 15.3, 12.1]])
SIZE = (24, 32)


def plane_of(normal: tuple[float, float, float]) -> NormalInput:
    """A plane 1.2 m before the camera, with a baseline of 0.27 m."""
    n = unit(torch.tensor(normal)[None, :, None, None]).expand(1, 3, *SIZE)
    disparity = -(60 * 0.27 / 1.2) * (pixel_rays(CAMERA, *SIZE) * n).sum(1, keepdim=True)
    return NormalInput(torch.zeros(1, 3, *SIZE), disparity, torch.ones_like(disparity, dtype=torch.bool), CAMERA)


def test_planes_fitted_to_depth_have_the_normal_of_the_plane_and_the_same_depth() -> None:
    seen = plane_of((0.2, -0.6, -1.0))
    true = unit(torch.tensor([0.2, -0.6, -1.0])[None, :, None, None]).expand(1, 3, *SIZE)
    # pixels count whose first normal is like that of the middle: a step of the depth does no harm where it is seen
    stepped = seen.disparity.clone()
    stepped[..., 16:] += 3
    first = true.clone()
    first[..., 16:] = unit(torch.tensor([0.8, -0.1, -1.0])[None, :, None, None])
    for disparity, start, part in ((seen.disparity, true, slice(None)), (stepped, first, slice(0, 16))):
        fitted = planes_of_depth(seen._replace(disparity=disparity), start, 3)
        torch.testing.assert_close(fitted[..., part], true[..., part], atol=1e-4, rtol=0)
    torch.testing.assert_close(disparity_of_planes(seen, true, 3), seen.disparity, atol=1e-4, rtol=1e-4)


def test_without_neighbours_the_normal_is_that_of_the_slopes_and_the_depth_stays() -> None:
    seen = plane_of((0.2, -0.6, -1.0))
    alone = seen._replace(valid=torch.zeros_like(seen.valid))
    start = unit(torch.randn(1, 3, *SIZE, generator=torch.Generator().manual_seed(0)))
    torch.testing.assert_close(planes_of_depth(alone, start, 3), normals_from_disparity(seen.disparity, CAMERA))
    torch.testing.assert_close(disparity_of_planes(alone, start, 3), seen.disparity)


def test_normals_take_noise_out_of_depth() -> None:
    seen = plane_of((0.1, -0.8, -1.0))
    true = unit(torch.tensor([0.1, -0.8, -1.0])[None, :, None, None]).expand(1, 3, *SIZE)
    noise = 0.1 * torch.randn(1, 1, *SIZE, generator=torch.Generator().manual_seed(0))
    refined = disparity_of_planes(seen._replace(disparity=seen.disparity + noise), true, 3)
    assert (refined - seen.disparity).std() < 0.5 * noise.std()


def test_errors_of_normals_are_means_over_the_cells_with_a_true_normal() -> None:
    true = torch.zeros(1, 3, 4, 4)
    true[:, 2, :, :2] = -1.0  # two of four columns are known
    disparity = torch.tensor([0.0, 2 * math.e]).repeat_interleave(2).expand(1, 1, 4, 4)  # sky, and ground
    truth = Truth(disparity, torch.ones(1, 1, 4, 4, dtype=torch.bool), true)
    across = torch.zeros(1, 3, 2, 2)
    across[:, 0] = 5.0
    assert normal_error(TrainedNormals(across, 2, 1.0, "cosine"), truth) == pytest.approx(1.0)
    assert normal_error(TrainedNormals(across, 2, 1.0, "absolute"), truth) == pytest.approx(2 / 3)
    assert normal_error(TrainedNormals(3 * true, 1, 1.0, "absolute"), truth) == pytest.approx(0.0)
    maps = [TrainedNormals(across, 2, 0.5, "cosine"), TrainedNormals(3 * true, 1, 1.0, "cosine")]
    both = NormalOutput(torch.full((1, 1, 4, 4), 2.0), true, maps, trained_disparity=True).terms(truth)
    assert {name: float(value) for name, value in both.items()} == pytest.approx({"normal": 0.5, "disparity": 1.0})


def test_errors_of_normals_leave_out_pixels_that_are_not_trained() -> None:
    true = torch.zeros(1, 3, 4, 4)
    true[:, 2] = -1.0
    disparity = torch.full((1, 1, 4, 4), 300.0)
    trained = (torch.arange(4) < 2).expand(1, 1, 4, 4)  # the others lie nearer than what is scored
    given = true.clone()
    given[:, 2, :, 2:] = 1.0  # wrong in all of those
    for cell, error in ((1, "absolute"), (2, "cosine")):
        maps = TrainedNormals(given[..., ::cell, ::cell], cell, 1.0, error)
        assert normal_error(maps, Truth(disparity, trained, true)) == 0
        assert normal_error(maps, Truth(disparity, torch.ones_like(trained), true)) > 0.3


def test_depth_that_was_not_measured_does_not_rule_the_statistics_of_the_image() -> None:
    disparity = torch.full((2, 1, *SIZE), 0.05)
    disparity[..., 8:, :] = torch.linspace(5, 10, SIZE[1])
    valid = torch.zeros_like(disparity, dtype=torch.bool)
    valid[..., 8:, :] = True
    valid[1] = False
    logs = NormalInput(torch.zeros(2, 3, *SIZE), disparity, valid, CAMERA.expand(2, -1)).log_depth
    ground = (60 / disparity[0, :, 8:]).log()
    torch.testing.assert_close(logs[0, :, 8:], ground)
    torch.testing.assert_close(logs[0, :, :8], ground.mean().expand(1, 8, SIZE[1]))
    assert (logs[1] == 0).all()  # nothing was measured


def test_geonet_starts_with_the_geometry_that_it_was_given() -> None:
    """What the planes say reaches the last networks almost unchanged, and the disparity is that of the input."""
    torch.manual_seed(0)
    network, seen, joined = new_network(TINY["geo-net"]), plane_of((0.2, -0.6, -1.0)), []
    network.joined_normals.register_forward_pre_hook(lambda _, args: joined.append(args[0]))
    output = network.normals(seen._replace(left=torch.rand(1, 3, *SIZE)))
    first, corrected = joined[0][:, :3], joined[0][:, 3:6]
    fitted = planes_of_depth(seen, facing_normals(first, seen.rays), TINY["geo-net"].neighbours)
    assert (corrected * fitted).sum(1).min() > 0.99
    torch.testing.assert_close(output.disparity, seen.disparity, rtol=0.02, atol=0)


@pytest.mark.parametrize("size", [(64, 96), (59, 92)])
def test_geonets_first_normals_and_its_residual_lie_where_they_were_computed(size: tuple[int, int]) -> None:
    network, cells = new_network(TINY["geo-net"]), []
    for layer in (network.first.last, network.residual.layers[-1]):
        layer.register_forward_hook(lambda _, __, output: cells.append(output.float()))
    images = torch.rand(1, 3, *size)
    torch.testing.assert_close(network.first(images)[..., ::8, ::8], unit(cells[0]))
    torch.testing.assert_close(network.residual(images)[..., ::2, ::2], cells[1])


def test_geonet_sees_small_differences_of_depth_in_bfloat16() -> None:
    """A depth 0.1 % farther, less than bfloat16 can tell from it, changes what the last network gets."""
    network, seen, given = new_network(TINY["geo-net"]), plane_of((0.2, -0.6, -1.0)), []
    network.joined_depths.register_forward_pre_hook(lambda _, args: given.append(args[0]))
    for factor in (1.0, 0.999):
        with torch.autocast("cpu", torch.bfloat16):
            network.normals(seen._replace(disparity=factor * seen.disparity))
    torch.testing.assert_close(
        given[1][:, 0] - given[0][:, 0], torch.full((1, *SIZE), -math.log(0.999)), atol=1e-5, rtol=0
    )


def test_the_confidence_of_fusion_starts_near_one() -> None:
    for seed in range(3):
        torch.manual_seed(seed)
        confidence = new_network(TINY["fusion"]).confidence(torch.randn(1, 4, *SIZE))
        assert confidence.min() > 0.3 and confidence.max() < 1.7


def test_the_depth_is_that_of_m3depth_and_no_part_of_the_weights(plane_samples) -> None:
    network = new_network(TINY["fusion"]).eval()
    names = set(network.state_dict())
    sample = plane_samples[0]
    prediction = network.infer(sample.left, sample.right, sample.rig)
    shipped = M3Depth.from_pretrained().infer(sample.left, sample.right, sample.rig)
    np.testing.assert_array_equal(prediction.depth, shipped.depth)
    np.testing.assert_array_equal(prediction.confidence, shipped.confidence)
    assert not np.allclose(prediction.normal, shipped.normal, equal_nan=True)
    assert set(network.state_dict()) == names and len(list(network.parameters())) == len(names)


def test_the_depth_is_that_of_the_weights_that_training_was_given(plane_samples, tmp_path) -> None:
    weights = tmp_path / "depth.safetensors"
    network = M3Depth(SMALL).eval()
    network.save_pretrained(weights)
    sizes = tmp_path / "sizes.json"
    sizes.write_text(json.dumps(TINY["fusion"].to_dict()))
    config = train_config(tmp_path / "run", network=sizes, depth_weights=weights)
    train(config, plane_samples, plane_samples[:1])
    trained = tmp_path / "run" / "weights.safetensors"
    sample = plane_samples[0]
    given = load_network(trained).infer(sample.left, sample.right, sample.rig)
    np.testing.assert_array_equal(given.depth, network.infer(sample.left, sample.right, sample.rig).depth)

    M3Depth(SMALL).save_pretrained(weights)
    with pytest.raises(ValueError, match=rf"^{trained}: {weights}: is not the file from which fusion got"):
        load_network(trained)
    weights.unlink()
    with pytest.raises(FileNotFoundError, match=rf"^{trained}: {weights}: no such weights file; fusion got its depth"):
        load_network(trained)


def test_depth_weights_that_cannot_be_used_are_refused(tmp_path) -> None:
    weights, rival = tmp_path / "depth.safetensors", tmp_path / "rival.safetensors"
    M3Depth(SMALL).save_pretrained(weights)
    new_network(TINY["fusion"]).save_pretrained(rival)
    for preset, path, message in (
        ("raft-stereo", weights, f"--depth-weights {weights}: this network takes no depth from M3Depth"),
        ("fusion-true-depth", weights, f"--depth-weights {weights}: this network takes no depth from M3Depth"),
        ("fusion", rival, f"--depth-weights {rival}: holds weights of fusion, not of M3Depth"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            first_network(train_config(tmp_path / "run", preset=preset, depth_weights=path))
    with pytest.raises(FileNotFoundError, match=r"^--depth-weights missing: no such weights file"):
        first_network(train_config(tmp_path / "run", preset="fusion", depth_weights=Path("missing")))
    with pytest.raises(ValueError, match=r"the weights of --init name those of their depth$"):
        check_config(train_config(tmp_path / "run", init=rival, depth_weights=weights))
    both = {"depth_weights": "a", "depth_sha256": "b"}
    for changes in ({"depth_weights": "a"}, {**both, "true_depth": True}, {**both, "depth_weights": "a\nb"}):
        with pytest.raises(ValueError, match=r"^depth_weights "):
            replace(TINY["fusion"], **changes)


def test_true_depth_is_given_in_training_and_evaluation_and_marked_in_tables(plane_samples, tmp_path) -> None:
    sizes = replace(TINY["fusion"], true_depth=True)
    path = tmp_path / "sizes.json"
    path.write_text(json.dumps(sizes.to_dict()))
    scores = train(train_config(tmp_path / "run", network=path), plane_samples, plane_samples[:1])
    assert scores["epe"] == 0 and scores["normal"] > 0
    network = new_network(sizes).eval()
    sample = plane_samples[0]
    with pytest.raises(ValueError, match=r"^fusion needs the true depth"):
        network.infer(sample.left, sample.right, sample.rig)
    given = for_pair(network, sample).infer(sample.left, sample.right, sample.rig)
    half = for_pair(ReducedEstimator(network, 2048), sample)
    reduced = half.infer(sample.left, sample.right, sample.rig)
    np.testing.assert_array_equal(reduced.depth, given.depth)
    assert (reduced.normal != given.normal).any()  # of the images that were reduced
    seen = sample.disparity >= 0.05
    np.testing.assert_allclose(given.depth[seen], sample.depth[seen], rtol=1e-5)
    assert not np.isfinite(given.depth[~seen]).any()
    result = evaluate(plane_samples[:1], {"Fusion": network, "without": new_network(TINY["fusion"]).eval()})
    assert [result.results[name]["gets_truth"] for name in ("Fusion", "without")] == [True, False]
    about = {
        "pairs": 1, "split": "test", "data": "planes", "degrade": None, "weights": "", "depth_range_m": (0.5, 15),
        "max_disparity_px": 192, "runtime": None, "versions": {},
    }  # fmt: skip
    for text in (text_table(result.results), markdown_report(about, result.results, result.true_depth_normals)):
        assert "Fusion, given the true depth" in text and "without, given" not in text


def test_true_depth_stays_what_it_is_where_a_pair_is_reduced() -> None:
    network = new_network(replace(TINY["fusion"], true_depth=True)).eval()
    sample = plane_sample(0, 96, 288, 800.0)
    near = StereoRig(sample.rig.camera, 6.0)
    disparity = near.depth_to_disparity(sample.depth)
    disparity[:5], disparity[7] = np.nan, 0
    assert working_sizes(near, network.reach, NEAREST)[0] == (64, 192)
    given = network.with_truth(disparity).infer(sample.left, sample.right, near)
    np.testing.assert_array_equal(given.disparity, disparity)
    np.testing.assert_allclose(given.depth[8:], sample.depth[8:], rtol=1e-5)
    assert np.isnan(given.depth[:5]).all() and np.isposinf(given.depth[7]).all()


def test_true_depth_of_a_tiny_pair_is_padded_as_its_images_are(monkeypatch) -> None:
    network, rig = new_network(replace(TINY["fusion"], true_depth=True)).eval(), NATECAM.resized(32, 24)
    disparity = np.linspace(2, 9, 24, dtype=np.float32)[:, None].repeat(32, 1)
    seen: list[np.ndarray] = []
    plain = network.forward

    def noted(left, right, camera, truth):
        seen.append(truth[0, 0].numpy())
        return plain(left, right, camera, truth)

    monkeypatch.setattr(network, "forward", noted)
    image = np.zeros((24, 32, 3), np.uint8)
    given = network.with_truth(disparity).infer(image, image, rig)
    assert seen[0].shape == (64, 64) and given.normal.shape == (24, 32, 3)
    np.testing.assert_array_equal(seen[0][:24, :32], disparity)


def test_the_search_of_a_method_for_normals_ends_where_that_of_its_depth_does(tmp_path) -> None:
    weights, network = tmp_path / "depth.safetensors", M3Depth(replace(SMALL, hypotheses=8))
    network.save_pretrained(weights)
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    fusion = new_network(replace(TINY["fusion"], depth_weights=str(weights), depth_sha256=digest))
    assert fusion.reach == network.reach == 64 and new_network(TINY["fusion"]).reach == 192
