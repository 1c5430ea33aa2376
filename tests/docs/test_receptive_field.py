"""How far the pixels lie that a feature depends on: closed forms, the reach of convolutions, and the command."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from small_network import SMALL
from torch import nn

from m3depth.network.model import M3Depth
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.files.json_file import read_json

CAMERA = torch.tensor([[90.0, 90.0, 63.5, 63.5]])


def test_normalisation_by_constants_has_the_same_values_and_no_gradient_across_the_image(receptive_field):
    torch.manual_seed(0)
    norm = nn.GroupNorm(2, 6)
    nn.init.normal_(norm.weight)
    nn.init.normal_(norm.bias)
    x = torch.randn(1, 6, 5, 7, requires_grad=True)
    expected = norm(x)
    with receptive_field.constant_statistics(nn.Sequential(norm)):
        value = norm(x)
    torch.testing.assert_close(value, expected)
    torch.testing.assert_close(norm(x), expected)
    assert norm.forward.__func__ is nn.GroupNorm.forward  # as before
    (local,) = torch.autograd.grad(value[0, 1, 2, 3], x)
    (across,) = torch.autograd.grad(expected[0, 1, 2, 3], x)
    assert int((local != 0).sum()) == 1 and int((across != 0).sum()) == 3 * 5 * 7


def test_features_depend_on_the_pixels_that_their_kernels_reach_and_wavelets_reach_farther(receptive_field):
    torch.manual_seed(0)
    left, right = torch.rand(2, 1, 3, 128, 128)
    widths = []
    for levels in ((0, 0), (1, 1), (2, 2)):
        network = M3Depth(replace(SMALL, wavelet_levels=levels)).eval()
        maps = receptive_field.gradients(network, left, right, CAMERA)
        assert {gradient.shape for gradient in maps.values()} == {(128, 128)}
        columns = np.flatnonzero(maps["features at 1/4"].any(0))
        widths.append(columns[-1] - columns[0] + 1)
    # 7 x 7 with stride 2 and 3 x 3, 3 x 3 with stride 2, two of 3 x 3: 7 + 2 * 2 + 2 * 2 + 2 * 4 + 2 * 4
    assert widths[0] == 31
    assert widths[0] < widths[1] < widths[2]


def test_the_sizes_of_known_gradients(receptive_field):
    point = np.zeros((65, 65))
    point[20, 30] = 2.0
    assert receptive_field.sizes(point) == {"radius_50_px": 0, "radius_90_px": 0, "side_px": 1}
    even = np.ones((65, 65))
    assert receptive_field.radii(even, [np.pi * 20**2 / 65**2])[0] == pytest.approx(20, abs=0.5)
    assert receptive_field.sizes(even)["side_px"] == 65
    y, x = np.indices((65, 65)) - 32
    gauss = receptive_field.sizes(np.exp(-(x**2 + y**2) / (2 * 6**2)))
    assert gauss["radius_50_px"] == pytest.approx(6 * np.sqrt(2 * np.log(2)), abs=0.5)
    large = np.pi * 6**2 * 2 * np.log(1 / receptive_field.LARGE)  # area of the pixels above LARGE
    assert gauss["side_px"] == pytest.approx(np.sqrt(large), abs=1)


@pytest.fixture
def pairs(receptive_field, monkeypatch) -> list[SimpleNamespace]:
    """Two pairs of noise, which the command reads from any folder."""
    rig = StereoRig(PinholeCamera(150, 130, 90.0, 90.0, 70.0, 60.0), 0.27)
    images = np.random.default_rng(0).integers(0, 256, (2, 2, 130, 150, 3), dtype=np.uint8)
    pairs = [SimpleNamespace(left=left, right=right, rig=rig) for left, right in images]
    monkeypatch.setattr(receptive_field, "open_pairs", lambda folder, split, reader: pairs)
    return pairs


def test_the_command_writes_numbers_and_a_picture_of_each_network(receptive_field, pairs, tmp_path, capsys):
    for name, levels in (("wefe", (1, 1)), ("plain", (0, 0))):
        torch.manual_seed(0)
        M3Depth(replace(SMALL, wavelet_levels=levels)).save_pretrained(tmp_path / f"{name}.safetensors")
    weights = [str(tmp_path / f"{name}.safetensors") for name in ("wefe", "plain")]
    out = tmp_path / "out"
    assert receptive_field.main(["--data", "any", "--size", "128", "--out", str(out), "--weights", *weights]) == 0
    networks = read_json(out / "receptive_field.json")["networks"]
    reach = {label: values["features at 1/4"]["radius_90_px"] for label, values in networks.items()}
    assert reach["wefe"] > reach["plain"] > 2
    assert "plain: half of the gradient within features at 1/4" in capsys.readouterr().out
    assert cv2.imread(str(out / "receptive_field.png")).std() > 20


def test_the_middle_of_an_image_keeps_its_principal_point(receptive_field, pairs):
    sample = pairs[0]
    part = receptive_field.cropped(sample.left, 64)
    assert part.shape == (1, 3, 64, 64) and (part[0, :, 0, 0] * 255 == torch.tensor(sample.left[33, 43])).all()
    assert receptive_field.camera_of(sample.rig, 64).tolist() == [[90, 90, 70 - 43, 60 - 33]]


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--size", "100"], "--size must be a multiple of 64, got 100"),
        (["--size", "256"], "--size 256: the images have 150 x 130 px"),
        (["--limit", "0"], "--limit must be at least 1"),
        (["--weights", "none.safetensors"], "none.safetensors: no such weights file"),
    ],
)
def test_mistakes_are_one_line(receptive_field, pairs, tmp_path, capsys, flags, message):
    assert receptive_field.main(["--data", "any", "--out", str(tmp_path / "out"), *flags]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists()
