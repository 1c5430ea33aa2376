"""The exported network has PyTorch's outputs in onnxruntime, at sizes that the export did not use."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
import torch
from small_network import SMALL

from m3depth import export as module
from m3depth.export import INPUTS, OUTPUTS, main, parity, textured_pair, to_onnx
from m3depth.network.config import PAPER, PLAIN_UPSAMPLING, M3DepthConfig
from m3depth.network.model import M3Depth
from m3depth.weights import SHIPPED_WEIGHTS

TINY = replace(SMALL, wavelet_levels=(2, 1))

THIN_PAPER = replace(
    PAPER, channels=(8, 8, 16), wavelet_levels=(1, 1), groups=8, hypotheses=8, volume_width=8, residual_width=8,
    normal_widths=(11, 11, 11), refine_steps=2, hidden=8, motion=8,
)  # fmt: skip
SIZES = ((1, 48, 80), (2, 75, 133), (2, 128, 64))


def network(config: M3DepthConfig) -> M3Depth:
    torch.manual_seed(0)
    return M3Depth(config).eval()


@pytest.fixture(scope="module")
def exported() -> bytes:
    return to_onnx(network(TINY))


def test_parity_at_free_sizes_and_batches(exported) -> None:
    differences = parity(network(TINY), exported, SIZES)
    assert differences["mean_px"] < 1e-4 and differences["largest_px"] < 1e-2 and differences["largest_other"] < 1e-3


@pytest.mark.parametrize(
    "config", [THIN_PAPER, replace(TINY, **PLAIN_UPSAMPLING, wavelet_levels=(0, 0))], ids=["paper", "plain"]
)
def test_other_configurations_export_too(config: M3DepthConfig) -> None:
    differences = parity(network(config), to_onnx(network(config)), SIZES[::2])
    assert differences["mean_px"] < 1e-4 and differences["largest_px"] < 1e-2 and differences["largest_other"] < 1e-3


def test_parity_measures_the_difference_of_another_network(exported) -> None:
    model = network(TINY)
    with torch.no_grad():
        model.aggregation.score.mul_(1.5)
    assert parity(model, exported, SIZES[:1])["mean_px"] > 1e-2


def test_the_word_shipped_names_the_shipped_weights(tmp_path, monkeypatch) -> None:
    loaded: list[Path] = []
    monkeypatch.setattr(M3Depth, "from_pretrained", lambda path=None: loaded.append(path) or 1 / 0)
    for words in ([], ["--weights", "shipped"]):
        with pytest.raises(ZeroDivisionError):
            main([*words, "--out", str(tmp_path / "mine.onnx")])
    assert loaded == [SHIPPED_WEIGHTS, SHIPPED_WEIGHTS]


def test_the_shipped_weights_export_and_free_sizes_are_declared() -> None:
    model = M3Depth.from_pretrained()
    model.config = replace(model.config, refine_steps=1)  # each step is exported again
    exported = to_onnx(model)
    assert parity(model, exported, ((2, 64, 96),))["mean_px"] < 1e-3
    graph = onnx.load_model_from_string(exported).graph
    shapes = {
        value.name: [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in (*graph.input, *graph.output)
    }
    assert shapes["left"] == shapes["right"] == ["batch", 3, "height", "width"]
    assert shapes["camera"] == ["batch", 4]
    assert set(shapes) == {*INPUTS, *OUTPUTS}
    assert all(shapes[n] == ["batch", 3 if n == "normal" else 1, "height", "width"] for n in OUTPUTS)
    assert {node.domain for node in graph.node} == {""}  # no operator of anybody's own


def test_the_command_writes_a_file_that_other_programs_read(tmp_path, capsys, monkeypatch) -> None:
    import onnxruntime

    weights = network(TINY)
    with torch.no_grad():
        weights.refinement.decisions[2].bias[1] -= 0.28  # sky in a part of the image
    weights.save_pretrained(tmp_path / "net.safetensors")
    out = tmp_path / "deep" / "net.onnx"
    assert main(["--weights", str(tmp_path / "net.safetensors"), "--out", str(out), "--opset", "18"]) == 0
    assert capsys.readouterr().out.startswith(f"{out}: ")
    session = onnxruntime.InferenceSession(str(out), providers=["CPUExecutionProvider"])
    left, right = textured_pair(1, 40, 56)
    disparity = session.run(["disparity"], {"left": left, "right": right, "camera": [[60.0, 60.0, 27.5, 19.5]]})[0]
    assert disparity.shape == (1, 1, 40, 56)
    assert onnx.load(out).opset_import[0].version == 18
    assert list(out.parent.iterdir()) == [out]
    the_program_of_the_guide(out, left, right, monkeypatch)


def the_program_of_the_guide(network: Path, left: np.ndarray, right: np.ndarray, monkeypatch) -> None:
    """It gives the depth that the network's own disparity means."""
    import onnxruntime

    monkeypatch.chdir(network.parent)
    network.rename("m3depth.onnx")
    for name, image in (("left", left), ("right", right)):
        cv2.imwrite(f"{name}.png", np.round(255 * image[0]).astype(np.uint8).transpose(1, 2, 0)[..., ::-1])
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "predict.md").read_text()
    names: dict[str, Any] = {}
    exec(re.search(r"```python\n(# depth_by_onnx.py\n.*?)```", guide, re.DOTALL)[1], names)
    rounded = {name: np.round(255 * image) / np.float32(255) for name, image in (("left", left), ("right", right))}
    session = onnxruntime.InferenceSession("m3depth.onnx", providers=["CPUExecutionProvider"])
    camera = [[595.9, 595.9, 255.5, 255.5]]
    disparity, sky = session.run(["disparity", "sky"], {**rounded, "camera": camera})
    assert 0 < (sky < 0.5).sum() < sky.size
    expected = np.where(sky[0, 0] < 0.5, 595.9 * 0.27 / disparity[0, 0], np.inf)
    np.testing.assert_allclose(names["depth"], expected, rtol=1e-4)


@pytest.mark.parametrize("part", ["aggregation.score", "normals.slice.2.weight"])
def test_a_file_that_disagrees_is_not_written(tmp_path, monkeypatch, exported, part) -> None:
    """The exported network has other weights; it differs in disparity, or in normals alone."""
    weights = network(replace(TINY, **PLAIN_UPSAMPLING))
    with torch.no_grad():
        dict(weights.named_parameters())[part].mul_(-3)
    other = to_onnx(network(replace(TINY, **PLAIN_UPSAMPLING)))
    monkeypatch.setattr(module, "to_onnx", lambda model, opset: other)
    weights.save_pretrained(tmp_path / "net.safetensors")
    with pytest.raises(RuntimeError, match="disagrees with PyTorch"):
        main(["--weights", str(tmp_path / "net.safetensors"), "--out", str(tmp_path / "net.onnx")])
    assert not (tmp_path / "net.onnx").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "net.pt"], "--out net.pt: must end in .onnx"),
        (["--out", "net.onnx", "--opset", "11"], "--opset must be 17 to 20, got 11"),
        (
            ["--out", "net.onnx", "--weights", "none.safetensors"],
            "--weights none.safetensors: no such weights file; give a weights.safetensors that m3depth.train wrote",
        ),
    ],
)
def test_mistakes_exit_with_2_and_one_line(arguments, message, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert capsys.readouterr().err == f"error: {message}\n"
    assert not list(tmp_path.iterdir())


def test_a_missing_package_names_the_extra(monkeypatch, capsys) -> None:
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    assert main(["--out", "net.onnx"]) == 2
    assert capsys.readouterr().err == 'error: onnx is not installed; pip install "mars-m3depth[export]"\n'
