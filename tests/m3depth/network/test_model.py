import json
import pickle
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from small_network import SMALL

import m3depth
from m3depth.kinds.config import read_config
from m3depth.network.config import PLAIN_UPSAMPLING
from m3depth.network.geometry import face_camera, pixel_rays, unit
from m3depth.network.model import PRESETS, M3Depth
from m3depth.network.output import Start, StereoOutput
from m3depth.weights.storage import save_weights
from marssim.base.camera import PinholeCamera, StereoRig


@pytest.fixture(scope="module")
def model() -> M3Depth:
    torch.manual_seed(0)
    network = M3Depth(SMALL).eval()
    assert network.refinement is not None
    torch.nn.init.constant_(network.refinement.decisions[2].bias, -5.0)  # no sky
    return network


def rig_of(height: int, width: int) -> StereoRig:
    return StereoRig(PinholeCamera.centred(width, height, 50.0), baseline=0.27)


@pytest.mark.parametrize("reduced", [False, True])
@pytest.mark.parametrize(("height", "width"), [(33, 70), (64, 64), (17, 129)])
def test_infer_at_any_size(model: M3Depth, height: int, width: int, reduced: bool) -> None:
    rng = np.random.default_rng(0)
    left, right = rng.integers(0, 256, (2, height, width, 3), dtype=np.uint8)
    rig = rig_of(height, width)
    out = model.infer(left, right, rig, rig.fb / (2.5 * 8 * SMALL.hypotheses) if reduced else None)
    assert out.depth.shape == out.disparity.shape == out.confidence.shape == (height, width)
    assert out.normal is not None
    assert {a.dtype for a in (out.depth, out.disparity, out.confidence, out.normal)} == {np.dtype(np.float32)}
    known = ~np.isnan(out.depth)  # random weights may see sky, and be confident of nothing
    assert known.any() and (np.isnan(out.normal).any(-1) == ~known).all()
    np.testing.assert_allclose(np.linalg.norm(out.normal[known], axis=-1), 1, atol=1e-4)
    assert ((out.normal * rig.camera.rays()).sum(-1)[known] < 0).all()
    assert ((out.confidence >= 0) & (out.confidence <= 1)).all()
    far = np.isinf(out.depth)
    assert (out.disparity[far] == 0).all()
    near = known & ~far
    np.testing.assert_allclose(out.depth[near], rig.fb / out.disparity[near], rtol=1e-5)


def test_normals_between_two_that_are_seen_edge_on_face_the_camera(model: M3Depth, monkeypatch) -> None:
    """Reduced images: what is interpolated between normals that face their own rays need not face the ray between."""
    rig = rig_of(96, 256)

    def checkered(left: torch.Tensor, right: torch.Tensor, camera: torch.Tensor, start: None) -> StereoOutput:
        height, width = left.shape[-2:]
        rays = pixel_rays(camera, height, width)
        across = torch.stack([-rays[:, 2], torch.zeros_like(rays[:, 0]), rays[:, 0]], 1)
        turned = torch.where(torch.arange(width) % 2 == 0, 1.0, -1.0) * across
        one = torch.ones(1, 1, height, width)
        return StereoOutput(one, face_camera(unit(turned), rays), one, -one, (one, rays), [])

    monkeypatch.setattr(model, "forward", checkered)
    image = np.zeros((96, 256), np.uint8)
    out = model.infer(image, image, rig, rig.fb / (3 * 8 * SMALL.hypotheses), max_pixels=32 * 86)
    assert out.normal is not None
    assert ((out.normal * rig.camera.rays()).sum(-1) < 0).all()
    np.testing.assert_allclose(np.linalg.norm(out.normal, axis=-1), 1, atol=1e-4)


@pytest.mark.parametrize("reduced", [False, True])
def test_nan_is_unknown_and_not_sky(model: M3Depth, monkeypatch, reduced: bool) -> None:
    plain = model.forward

    def overflowing(*inputs: torch.Tensor) -> StereoOutput:
        out = plain(*inputs)
        out.disparity.clamp_(min=1.0)
        out.disparity[..., :8, :8] = torch.nan
        out.sky[..., :8, 16:24] = torch.nan
        out.confidence[..., :8, 32:40] = torch.nan
        out.disparity[..., 16:, :8] = torch.inf
        return out

    monkeypatch.setattr(model, "forward", overflowing)
    image = np.random.default_rng(0).integers(0, 256, (32, 64), dtype=np.uint8)
    rig = rig_of(32, 64)
    out = model.infer(image, image, rig, rig.fb / (1.1 * 8 * SMALL.hypotheses) if reduced else None)
    for rows, columns in ((0, 0), (0, 18), (0, 35), (20, 0)):
        part = np.s_[rows : rows + 6, columns : columns + 5]
        assert np.isnan(out.depth[part]).all() and np.isnan(out.disparity[part]).all()
        assert np.isnan(out.normal[part]).all() and (out.confidence[part] == 0).all()
    assert np.isfinite(out.normal[20:, 50:]).all()
    assert np.isfinite(out.disparity[20:, 50:]).all() and (out.confidence[20:, 50:] > 0).all()


def test_where_no_sky_can_be_the_disparity_decides(model: M3Depth, monkeypatch) -> None:
    """A patch that does not reach the upper border, as of a bright wall."""
    plain = model.forward

    def seeing_sky(*inputs: torch.Tensor) -> StereoOutput:
        out = plain(*inputs)
        out.sky[:], out.disparity[:], out.confidence[:] = -5.0, 5.0, 5.0
        out.disparity[..., 25:28, 30:50] = 0.0  # too far to measure reads as sky, too
        out.sky[..., :6, :] = out.sky[..., 20:25, 30:50] = 5.0
        return out

    monkeypatch.setattr(model, "forward", seeing_sky)
    image = np.random.default_rng(0).integers(0, 256, (32, 64), dtype=np.uint8)
    out = model.infer(image, image, rig_of(32, 64))
    assert out.is_sky[:6].all() and not out.is_sky[6:].any()
    measured, far = np.s_[20:25, 30:50], np.s_[25:28, 30:50]
    assert np.allclose(out.disparity[measured], 5) and (out.confidence[measured] > 0).all()
    assert out.normal is not None
    assert np.isnan(out.depth[far]).all() and np.isnan(out.normal[far]).all() and (out.confidence[far] == 0).all()


@pytest.mark.parametrize("nearest", [0.0, -1.0, float("nan"), float("inf")])
def test_a_nearest_depth_that_is_not_positive_is_refused(model: M3Depth, nearest: float) -> None:
    image = np.zeros((32, 64), np.uint8)
    with pytest.raises(ValueError, match="nearest must be positive"):
        model.infer(image, image, rig_of(32, 64), nearest=nearest)
    with pytest.raises(ValueError, match="max_pixels must be at least 2048, got 0"):
        model.infer(image, image, rig_of(32, 64), max_pixels=0)


def test_grey_equals_repeated_grey(model: M3Depth) -> None:
    left, right = np.random.default_rng(1).integers(0, 256, (2, 40, 48), dtype=np.uint8)
    grey = model.infer(left, right, rig_of(40, 48))
    colour = model.infer(*(np.repeat(x[..., None], 3, 2) for x in (left, right)), rig_of(40, 48))
    np.testing.assert_array_equal(grey.disparity, colour.disparity)


def test_the_volume_works_on_a_reduced_pair_where_disparities_are_large(model: M3Depth) -> None:
    """With as many pixels as the reduced pair has, the maps are those of that pair, in twice the px."""
    rng = np.random.default_rng(2)
    left, right = (np.repeat(np.repeat(x, 2, 0), 2, 1) for x in rng.integers(0, 256, (2, 32, 64), dtype=np.uint8))
    rig = rig_of(64, 128)
    nearest = rig.fb / (2 * 8 * SMALL.hypotheses)
    out = model.infer(left, right, rig, nearest, max_pixels=32 * 64)
    half = model.infer(left[::2, ::2], right[::2, ::2], rig.resized(64, 32), 1e3)
    assert out.disparity.shape == (64, 128)
    both = (out.disparity > 0).reshape(32, 2, 64, 2).all((1, 3)) & (half.disparity > 0)
    means = out.disparity.reshape(32, 2, 64, 2).mean((1, 3))
    assert np.median(np.abs(means - 2 * half.disparity)[both] / half.disparity[both]) < 0.1


def test_larger_sizes_start_where_the_smaller_one_ended(model: M3Depth, monkeypatch) -> None:
    """On a plane, the start of the larger pair is twice the disparity that forward returned for the smaller one."""
    starts, sizes, plain = [], [], model.forward

    def planar(left: torch.Tensor, right: torch.Tensor, camera: torch.Tensor, start: Start | None) -> StereoOutput:
        out = plain(left, right, camera, start)
        height, width = left.shape[-2:]
        sizes.append((height, width))
        starts.append(start)
        row = torch.arange(height, dtype=torch.float32)[:, None].expand(height, width)
        assert out.context is not None
        cells = 8 * torch.arange(out.context.shape[-1]) + 3.5 + 0.5  # of the middle of each cell, as a share below
        ramp = (cells / width).expand_as(out.context)
        return out._replace(disparity=(3 + (row + 0.5) * 128 / width)[None, None], context=ramp)

    monkeypatch.setattr(model, "forward", planar)
    left, right = np.random.default_rng(2).integers(0, 256, (2, 64, 128), dtype=np.uint8)
    rig = rig_of(64, 128)
    model.infer(left, right, rig, rig.fb / (2 * 8 * SMALL.hypotheses))
    assert sizes == [(32, 64), (64, 128)] and starts[0] is None
    start = starts[1]
    row = torch.arange(64, dtype=torch.float32)
    assert torch.allclose(start.disparity[0, 0, 2:-2, 5], 2 * (3 + row + 0.5)[2:-2], atol=1e-3)
    assert torch.allclose(start.normal.square().sum(1), torch.ones(()), atol=1e-4)
    assert start.context is not None and start.context.shape[-2:] == (8, 16)
    middles = (8 * torch.arange(16) + 4) / 128
    assert torch.allclose(start.context[0, 0, 3, 1:-1], middles[1:-1], atol=1e-5)


def test_a_network_without_refinement_enlarges_the_maps_of_the_reduced_pair(monkeypatch) -> None:
    torch.manual_seed(0)
    network = M3Depth(replace(SMALL, **PLAIN_UPSAMPLING)).eval()
    widths, plain = [], network.forward
    monkeypatch.setattr(network, "forward", lambda left, *rest: widths.append(left.shape[-1]) or plain(left, *rest))
    image = np.random.default_rng(2).integers(0, 256, (64, 128), dtype=np.uint8)
    rig = rig_of(64, 128)
    out = network.infer(image, image, rig, rig.fb / (2 * 8 * SMALL.hypotheses))
    assert widths == [64] and out.depth.shape == (64, 128)


@pytest.mark.parametrize(("height", "width"), [(48, 96), (37, 61)])
def test_a_start_takes_the_place_of_the_volume(model: M3Depth, height: int, width: int) -> None:
    rng = np.random.default_rng(4)
    left, right = torch.from_numpy(rng.random((2, 1, 3, height, width), dtype=np.float32))
    camera = torch.tensor([[50.0, 50.0, width / 2, height / 2]])
    with torch.inference_mode():
        first = model(left, right, camera)
        again = model(left, right, camera, first.start(height, width))
    assert again.initial is None and len(again.steps) == SMALL.finer_steps
    assert again.disparity.shape == first.disparity.shape and again.disparity.isfinite().all()
    assert again.context is not None and torch.equal(again.context, first.context)


def test_wrong_images_and_presets_are_named(model: M3Depth) -> None:
    image = np.zeros((32, 64, 3), np.uint8)
    with pytest.raises(ValueError, match="right image is 64 x 16"):
        model.infer(image, image[:16], rig_of(32, 64))
    with pytest.raises(ValueError, match="right image must be a uint8"):
        model.infer(image, image.astype(np.float32), rig_of(32, 64))
    with pytest.raises(ValueError, match="rig's camera"):
        model.infer(image, image, rig_of(32, 60))
    with pytest.raises(ValueError, match="preset"):
        M3Depth.from_preset("huge")
    with pytest.raises(ValueError, match="multiple of groups"):
        replace(SMALL, groups=5)


def test_lite_is_small() -> None:
    with torch.device("meta"):
        assert sum(p.numel() for p in M3Depth(PRESETS["lite"]).parameters()) < 1_000_000


def test_weights_survive_the_disk(model: M3Depth, tmp_path: Path) -> None:
    model.save_pretrained(tmp_path / "net.safetensors")
    again = M3Depth.from_pretrained(tmp_path / "net.safetensors")
    assert again.config == model.config
    image = np.random.default_rng(0).integers(0, 256, (32, 64), dtype=np.uint8)
    first, second = (m.infer(image, image, rig_of(32, 64)) for m in (model, again))
    np.testing.assert_array_equal(first.disparity, second.disparity)


def test_bad_weights_are_refused_by_name(model: M3Depth, tmp_path: Path) -> None:
    path = tmp_path / "net.safetensors"
    with pytest.raises(FileNotFoundError, match=r"net\.safetensors"):
        M3Depth.from_pretrained(path)
    model.save_pretrained(path)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:4], b"\x80\x04pickle" * 10):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"net\.safetensors: [^\n]*$"):
            M3Depth.from_pretrained(path)
    from safetensors.torch import save_file

    save_file({"x": torch.zeros(1)}, path)
    with pytest.raises(ValueError, match="not weights of M3Depth"):
        M3Depth.from_pretrained(path)
    save_file({"x": torch.zeros(1)}, path, metadata={"m3depth_config": "{}"})
    with pytest.raises(ValueError, match="do not fit the network"):
        M3Depth.from_pretrained(path)
    save_file({"x": torch.zeros(1)}, path, metadata={"m3depth_config": '{"hidden": "rm -rf"}'})
    with pytest.raises(ValueError, match="'hidden'"):
        M3Depth.from_pretrained(path)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("groups", 0), ("channels", [8, 0, 16]), ("volume_width", 0), ("normal_widths", [8, 8, 0]),
        ("wavelet_kernel", 4), ("wavelet_kernel", 0), ("wavelet_levels", [2, 60]), ("hidden", 0), ("motion", 1),
        ("match_channels", 12), ("lookup_channels", 0), ("output_head", 4), ("score_kernel", 2), ("slice_layers", 0),
        ("hypotheses", 0),
    ],
)  # fmt: skip
def test_impossible_config_names_file_and_field(model: M3Depth, tmp_path: Path, field: str, value) -> None:
    from safetensors.torch import save_file

    path = tmp_path / "net.safetensors"
    config = json.dumps({**asdict(model.config), field: value})
    save_file({"x": torch.zeros(1)}, path, metadata={"m3depth_config": config})
    with pytest.raises(ValueError, match=rf"net\.safetensors: {field} [^\n]*$"):
        M3Depth.from_pretrained(path)


def test_the_package_offers_the_network() -> None:
    """That importing it loads no torch is asserted in test_estimator."""
    assert m3depth.M3Depth is M3Depth
    with pytest.raises(AttributeError, match="M4Depth"):
        m3depth.M4Depth  # noqa: B018


class Door:
    """Unpickled, it creates a file: what a malicious checkpoint would do."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.write_text, (self.path, "opened")


@pytest.mark.parametrize("number", [torch.nan, torch.inf])
def test_weights_of_nan_or_infinity_are_refused(model: M3Depth, tmp_path: Path, number: float) -> None:
    path = tmp_path / "net.safetensors"
    damaged = model.state_dict()
    name = next(reversed(damaged))
    damaged[name] = torch.full_like(damaged[name], number)
    save_weights(path, asdict(model.config), damaged)
    with pytest.raises(
        ValueError, match=rf"net\.safetensors: 1 tensor of NaN or infinity, the first is '{name}'[^\n]*$"
    ):
        M3Depth.from_pretrained(path)


def test_weights_that_are_all_zero_are_refused(model: M3Depth, tmp_path: Path) -> None:
    zeros = {name: torch.zeros_like(tensor) for name, tensor in model.state_dict().items()}
    save_weights(tmp_path / "net.safetensors", asdict(model.config), zeros)
    with pytest.raises(ValueError, match=r"net\.safetensors: all weights are zero"):
        M3Depth.from_pretrained(tmp_path / "net.safetensors")


def test_the_config_is_that_inside_the_file(model: M3Depth, tmp_path: Path) -> None:
    """The JSON beside it is for people: what it says, or whether it can be read, changes nothing."""
    path = tmp_path / "net.safetensors"
    model.save_pretrained(path)
    for text in ('{"refine_steps": 1}', "no JSON"):
        path.with_suffix(".json").write_text(text)
        assert M3Depth.from_pretrained(path).config == model.config


@pytest.mark.parametrize("kind", ["pickle", "torch", "zip of torch"])
def test_a_malicious_file_is_refused_without_executing_anything(tmp_path: Path, kind: str) -> None:
    """A pickle that runs code when it is loaded, named as weights or beside them."""
    opened, path = tmp_path / "opened", tmp_path / "net.safetensors"
    if kind == "pickle":
        path.write_bytes(pickle.dumps(Door(opened)))
    else:
        torch.save({"x": Door(opened)}, path, _use_new_zipfile_serialization=kind == "zip of torch")
    with pytest.raises(ValueError, match=r"net\.safetensors: [^\n]*$"):
        M3Depth.from_pretrained(path)
    assert not opened.exists()
    pickle.loads(pickle.dumps(Door(opened)))
    assert opened.exists(), "the door does open where pickles are loaded"


def test_a_header_with_wrong_lengths_is_refused(model: M3Depth, tmp_path: Path) -> None:
    """Lengths and offsets that point outside the file, and a header that claims to be huge."""
    path = tmp_path / "net.safetensors"
    model.save_pretrained(path)
    whole = path.read_bytes()
    length = int.from_bytes(whole[:8], "little")
    header = json.loads(whole[8 : 8 + length])
    name = next(key for key in header if key != "__metadata__")
    start, end = header[name]["data_offsets"]
    for change in ({"data_offsets": [start, end + (1 << 40)]}, {"shape": [1 << 40]}, {"dtype": "F128"}):
        lying = json.dumps({**header, name: {**header[name], **change}}).encode()
        path.write_bytes(len(lying).to_bytes(8, "little") + lying + whole[8 + length :])
        with pytest.raises(ValueError, match=r"net\.safetensors: [^\n]*$"):
            M3Depth.from_pretrained(path)
    path.write_bytes((1 << 62).to_bytes(8, "little") + whole[8:])
    with pytest.raises(ValueError, match=r"net\.safetensors: [^\n]*$"):
        M3Depth.from_pretrained(path)


@pytest.mark.parametrize("kind", ["float8_e4m3fn", "int32", "float64"])
def test_numbers_of_another_kind_are_refused(model: M3Depth, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "net.safetensors"
    tensors = {name: tensor.to(getattr(torch, kind)) for name, tensor in model.state_dict().items()}
    save_weights(path, asdict(model.config), tensors)
    with pytest.raises(ValueError, match=rf"net\.safetensors: [^\n]* is of {kind}; weights are float32[^\n]*$"):
        M3Depth.from_pretrained(path)


def test_json_nested_too_deeply_is_refused(tmp_path: Path) -> None:
    from safetensors.torch import save_file

    path, deep = tmp_path / "net.safetensors", "[" * 200_000
    save_file({"x": torch.zeros(1)}, path, metadata={"m3depth_config": deep})
    with pytest.raises(ValueError, match=r"net\.safetensors: holds no m3depth_config[^\n]*$"):
        M3Depth.from_pretrained(path)
    config = tmp_path / "net.json"
    config.write_text(deep)
    with pytest.raises(ValueError, match=r"net\.json: not readable as JSON[^\n]*$"):
        read_config(config)


def test_a_huge_network_in_the_config_is_refused_before_it_is_built(tmp_path: Path) -> None:
    """A few bytes of JSON must not ask for terabytes of weights."""
    from safetensors.torch import save_file

    path = tmp_path / "net.safetensors"
    config = {**asdict(SMALL), "channels": [4096, 4096, 4096], "hidden": 4096, "motion": 4096, "groups": 4096}
    save_file({"x": torch.zeros(1)}, path, metadata={"m3depth_config": json.dumps({**config, "match_channels": 4096})})
    with pytest.raises(ValueError, match="do not fit the network"):
        M3Depth.from_pretrained(path)
