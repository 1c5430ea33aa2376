"""What holds for every rival: sizes, maps, gradients, a step of the trainer, weights on disk, and the estimator."""

import json
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
import torch
from small_rivals import TINY, train_config

from m3depth.checked_inference import checked_prediction
from m3depth.estimator import load_estimator
from m3depth.kinds.config import PresetName, preset_config
from m3depth.kinds.networks import load_network, new_network
from m3depth.network.config import PRESETS as M3DEPTH_PRESETS
from m3depth.network.model import M3Depth
from m3depth.rivals.config import CONFIGS, PRESETS, NormalConfig, RivalConfig
from m3depth.rivals.output import Truth
from m3depth.stereo.pairs import MAX_DISPARITY, NEAREST
from m3depth.training.batch import whole_batch
from m3depth.training.loop import train
from m3depth.training.loss_config import LossConfig
from m3depth.training.losses import total_loss
from m3depth.training.packing import SCORED, pack
from m3depth.training.run import Run
from m3depth.training.validation import validate

pytestmark = pytest.mark.usefixtures("undrawn_figures")

PUBLISHED = {  # parameters [M] of the published width
    "raft-stereo": 11.1,  # RAFT-Stereo of the package stereo-matching 0.2
    "selective-stereo": 11.7,  # Selective-RAFT of the package stereo-toolbox 0.4
    "hit-net": 0.668,  # HITNet_KITTI of TinyHITNet, counted from its list of layers
    "cre-stereo": 5.43,  # CREStereo of the package stereo-matching 0.2
    "light-stereo": 3.44,  # LightStereo-S of OpenStereo, counted from its list of layers
    "uni-mvs-net": 0.934,  # UniMVSNet, counted from its list of layers
    "fusion": 17.47,  # fconv_ms and map_conv of RGBD2Normal, counted from their lists of layers
    "geo-net": 23.87,  # GeoNet without the stream of the depth and the edges, counted from its list of layers
}


@pytest.fixture(params=list(CONFIGS))
def config(request) -> RivalConfig:
    return TINY[request.param]


def test_every_preset_is_one_of_the_command() -> None:
    assert {*M3DEPTH_PRESETS, *PRESETS} == set(PresetName.__args__)
    assert set(TINY) == set(PUBLISHED) == set(CONFIGS)
    for kind, cls in CONFIGS.items():
        assert type(PRESETS[kind]) is type(PRESETS[f"{kind}-published"]) is cls and kind == cls.KIND


@pytest.mark.parametrize("kind", CONFIGS)
def test_the_published_width_has_the_published_number_of_parameters(kind) -> None:
    with torch.device("meta"):
        network = new_network(preset_config(f"{kind}-published"))
    millions = sum(p.numel() for p in network.parameters()) / 1e6
    assert millions == pytest.approx(PUBLISHED[kind], rel=0.005)


@pytest.mark.parametrize("kind", CONFIGS)
def test_the_width_for_a_cpu_is_a_small_one(kind) -> None:
    with torch.device("meta"):
        network = new_network(preset_config(kind))
    assert sum(p.numel() for p in network.parameters()) < 2e6  # float16: less than 4 MB


def test_the_loss_reaches_every_parameter_and_the_maps_have_the_size_of_the_images(config, plane_samples) -> None:
    network = new_network(config).train()
    batch = whole_batch(pack(plane_samples[0]))
    left, right = (x[..., :60, :90] for x in (batch.left, batch.right))  # no multiples of anything
    assert network(left, right, batch.target.camera).disparity.shape == (1, 1, 60, 90)
    loss, terms = total_loss(network(batch.left, batch.right, batch.target.camera), batch.target, LossConfig())
    loss.backward()
    missed = [name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0]
    assert not missed
    assert loss.detach() > 0 and float(loss.detach()) == pytest.approx(float(sum(terms.values())))


def test_the_trainer_takes_steps_and_its_weights_drive_an_estimator(config, plane_samples, tmp_path) -> None:
    sizes = tmp_path / "sizes.json"
    sizes.write_text(json.dumps(config.to_dict()))
    scores = train(train_config(tmp_path / "run", network=sizes), plane_samples, plane_samples[:1])
    of_normals = isinstance(config, NormalConfig)
    assert scores["epe"] >= 0 and ("normal" in scores) == ("sky_missed" in scores) == of_normals
    weights = tmp_path / "run" / "weights.safetensors"
    assert json.loads(weights.with_suffix(".json").read_text())["kind"] == config.KIND
    network = load_network(weights)
    assert network.config == config and not network.training
    sample = plane_samples[0]
    estimator = load_estimator(f"m3depth:{weights}")
    prediction = checked_prediction(
        estimator, estimator.infer(sample.left, sample.right, sample.rig), sample.left.shape[:2]
    )
    known = np.isfinite(prediction.depth)
    assert (prediction.confidence[known] == 1).all() != of_normals  # M3Depth's
    with pytest.raises(ValueError, match=rf"weights.safetensors: holds weights of {config.KIND}, not of M3Depth"):
        M3Depth.from_pretrained(weights)
    resumed = train(train_config(tmp_path / "run", network=sizes, max_steps=2), plane_samples, plane_samples[:1])
    changed = "normal" if of_normals else "epe"
    assert resumed[changed] != scores[changed]


@pytest.mark.parametrize("kind", [kind for kind, cls in CONFIGS.items() if not issubclass(cls, NormalConfig)])
def test_the_first_gradients_in_bfloat16_are_those_of_float32(kind, plane_samples) -> None:
    """Precision does not decide what a method learns."""
    torch.manual_seed(0)
    network, batch = new_network(preset_config(kind)).train(), whole_batch(pack(plane_samples[0]))
    gradients = []
    for enabled in (False, True):
        network.zero_grad()
        with torch.autocast("cpu", torch.bfloat16, enabled=enabled):
            output = network(batch.left, batch.right, batch.target.camera)
        total_loss(output, batch.target, LossConfig())[0].backward()
        gradients.append(torch.cat([p.grad.flatten() for p in network.parameters()]))
    assert float(torch.cosine_similarity(*gradients, 0)) > 0.8


def test_checkpointing_changes_no_gradient(config, plane_samples) -> None:
    batch = whole_batch(pack(plane_samples[0]))
    gradients = []
    network = new_network(config).train()
    for network.recompute in (False, True):
        network.zero_grad()
        output = network(batch.left, batch.right, batch.target.camera)
        total_loss(output, batch.target, LossConfig())[0].backward()
        gradients.append(torch.cat([p.grad.flatten() for p in network.parameters()]))
    torch.testing.assert_close(gradients[1], gradients[0], rtol=1e-3, atol=1e-3 * float(gradients[0].abs().max()))


def test_pairs_of_large_disparities_are_worked_on_at_their_reduced_size(large_samples) -> None:
    """Their errors are those of the maps at full size, in pixels of the pair."""
    torch.manual_seed(0)
    network, sample = new_network(TINY["raft-stereo"]).eval(), large_samples[0]
    sizes = []
    network.register_forward_pre_hook(lambda _, inputs: sizes.append(tuple(inputs[0].shape[-2:])))
    (scores,) = validate([network], [packed := pack(sample)], torch.device("cpu"))
    height, width = sample.left.shape[:2]
    assert sizes == [(height // 2, width // 2)]
    half = (cv2.resize(x, (width // 2, height // 2), interpolation=cv2.INTER_AREA) for x in (sample.left, sample.right))
    left, right = (torch.from_numpy(x).permute(2, 0, 1)[None] / 255 for x in half)
    with torch.no_grad():
        disparity = network(left, right, torch.tensor([[400.0, 400, 47.5, 31.5]])).disparity[0, 0].numpy()
    disparity = 2 * cv2.resize(disparity, (width, height), interpolation=cv2.INTER_LINEAR)
    scored = (packed.flags & SCORED) > 0
    assert scores["epe"] == pytest.approx(np.abs(disparity - sample.disparity)[scored].mean(), rel=0.02)

    assert width == MAX_DISPARITY < sample.rig.fb / NEAREST
    twice = (cv2.resize(x, (2 * width, 2 * height)) for x in (sample.left, sample.right))
    prediction = network.infer(*twice, sample.rig.resized(2 * width, 2 * height))
    assert sizes[-1] == (height, width)
    assert prediction.disparity.shape == (2 * height, 2 * width) and prediction.normal is None


@pytest.mark.parametrize("kind", CONFIGS)
def test_the_last_step_is_the_result_of_methods_that_take_steps(kind, plane_samples) -> None:
    network = new_network(TINY[kind]).eval()
    counts = {"raft-stereo": 3, "selective-stereo": 3, "cre-stereo": 5 + 5 + 2}
    assert network.takes_steps == (kind in counts)
    if kind in counts:
        with torch.no_grad():  # each step adds about a cell
            network.update.head[-1].bias.fill_(-1 if kind == "cre-stereo" else 1)
        sample = plane_samples[0]
        steps = network.infer_steps(sample.left, sample.right, sample.rig)
        assert [step.name for step in steps] == [f"step {n}" for n in range(1, counts[kind] + 1)]
        prediction = network.infer(sample.left, sample.right, sample.rig)
        measured = np.isfinite(prediction.depth)
        np.testing.assert_array_equal(steps[-1].disparity[measured], prediction.disparity[measured])
        assert measured.any() and steps[-1].disparity.mean() > steps[0].disparity.mean() + 3


def test_a_run_is_not_resumed_with_another_method_or_size(tmp_path) -> None:
    """Selective-Stereo has the same sizes as RAFT-Stereo, under another kind."""
    sizes = tmp_path / "sizes.json"
    for kind, changes in (("raft-stereo", {}), ("selective-stereo", {}), ("raft-stereo", {"hidden": 16})):
        sizes.write_text(json.dumps({**TINY[kind].to_dict(), **changes}))
        config = train_config(tmp_path / "run", network=sizes)
        if kind == "raft-stereo" and not changes:
            Run(config, torch.device("cpu")).save()
        else:
            with pytest.raises(
                ValueError, match=r"checkpoint.pt: belongs to a run with network\..*choose another --out"
            ):
                Run(config, torch.device("cpu")).resume()


def test_images_of_one_column_have_maps_and_gradients(config) -> None:
    size = (20, 1)
    network = new_network(config).train()
    left, right = torch.rand(2, 1, 3, *size)
    with torch.autocast("cpu", torch.bfloat16):
        output = network(left, right, torch.tensor([[50.0, 50.0, size[1] / 2, size[0] / 2]]))
    assert output.disparity.shape == (1, 1, *size) and output.disparity.dtype == torch.float32
    normal = torch.zeros(1, 3, *size)
    normal[:, 2] = -1
    terms = output.terms(Truth(torch.full((1, 1, *size), 3.0), torch.ones(1, 1, *size, dtype=torch.bool), normal))
    sum(terms.values()).backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


def test_flags_of_another_methods_loss_are_refused(tmp_path) -> None:
    config = train_config(tmp_path, preset="raft-stereo", loss=LossConfig(rock=2))
    with pytest.raises(ValueError, match=r"^--loss\.\*: raft-stereo is trained with its own loss"):
        Run(config, torch.device("cpu"))


def test_a_config_of_an_unknown_kind_or_field_is_refused(tmp_path) -> None:
    path = tmp_path / "sizes.json"
    for content, message in (
        ({"kind": "elas"}, "kind 'elas' is not one of m3depth, raft-stereo"),
        ({"kind": "raft-stereo", "channels": 3}, "unknown field 'channels'"),
        ({"kind": "raft-stereo", "hidden": 0}, "hidden must be at least 1, got 0"),
        ({"kind": "selective-stereo", "hidden": 1}, "hidden must be at least 2, of which one is the disparity, got 1"),
    ):
        path.write_text(json.dumps(content))
        with pytest.raises(ValueError, match=message):
            Run(train_config(tmp_path / "run", network=path), torch.device("cpu"))


def test_threads_may_ask_for_steps_at_once(plane_samples) -> None:
    network, sample = new_network(TINY["raft-stereo"]).eval(), plane_samples[0]
    with ThreadPoolExecutor(4) as pool:
        counts = list(pool.map(lambda _: len(network.infer_steps(sample.left, sample.right, sample.rig)), range(12)))
    assert counts == 12 * [3]
