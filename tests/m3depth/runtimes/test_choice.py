"""Which program runs the network."""

import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import torch
from small_rivals import TINY

from m3depth.estimator import load_estimator
from m3depth.kinds.networks import new_network
from m3depth.network.model import M3Depth
from m3depth.predict import main as predict
from m3depth.runtimes.choice import chosen_runtime, joined_runtimes, recorded_runtime, runtime_sentence, same_runtime
from marssim.base.files.png import encode_png


def test_auto_is_openvino_on_the_cpu_where_it_is_installed(installed, monkeypatch):
    assert chosen_runtime("auto", "cpu") == "openvino"
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    assert chosen_runtime("auto", "auto") == "pytorch" and chosen_runtime("auto", "cuda") == "pytorch"
    assert chosen_runtime("auto", "cpu") == "openvino" and chosen_runtime("openvino", "auto") == "openvino"


def test_auto_is_pytorch_where_openvino_is_missing():
    assert chosen_runtime("auto", "cpu") == "pytorch"
    assert isinstance(load_estimator("m3depth"), M3Depth)


def test_pytorch_is_chosen_where_openvino_is_installed(installed):
    assert isinstance(load_estimator("m3depth", runtime="pytorch"), M3Depth)


def test_missing_openvino_is_reported_with_its_extra(tmp_path, capsys):
    message = 'openvino: it is not installed; pip install "mars-m3depth[fast]"'
    with pytest.raises(ImportError, match=re.escape(f"`runtime` {message}")):
        load_estimator("m3depth", runtime="openvino")
    images = [str(tmp_path / name) for name in ("left.png", "right.png")]
    for seed, image in enumerate(images):
        Path(image).write_bytes(encode_png(np.random.default_rng(seed).integers(0, 255, (48, 64, 3), dtype=np.uint8)))
    out = tmp_path / "out"
    assert predict([*images, "--focal", "70", "--baseline", ".27", "--runtime", "openvino", "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"error: --runtime {message}\n" and not out.exists()


@pytest.mark.parametrize(
    ("runtime", "device", "message"),
    [
        ("onnx", "auto", "^`runtime` 'onnx' is unknown; choose from auto, pytorch, openvino$"),
        ("openvino", "cuda", "^`runtime` openvino runs on the CPU, not on cuda"),
    ],
)
def test_what_cannot_run_is_refused(runtime, device, message):
    with pytest.raises(ValueError, match=message):
        chosen_runtime(runtime, device)


def test_a_wrong_runtime_is_refused_for_every_method():
    with pytest.raises(ValueError, match="`runtime` 'torch' is unknown"):
        load_estimator("sgbm", runtime="torch")


@pytest.mark.parametrize(("dtype", "precision"), [(None, "fp32"), (torch.bfloat16, "bf16")])
def test_results_record_what_ran_m3depth_where_and_how_precisely(monkeypatch, dtype, precision):
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: dtype)
    for device in ("cpu", "cuda"):
        monkeypatch.setattr("m3depth.runtimes.choice.chosen_device", lambda _, device=device: torch.device(device))
        record = recorded_runtime(["sgbm", "m3depth:w.safetensors"])
        assert record == f"pytorch {version('torch')} {device} {precision}"


@pytest.fixture(scope="module")
def rivals(tmp_path_factory) -> dict[str, str]:
    """The names of networks other than M3Depth, by their kind."""
    folder = tmp_path_factory.mktemp("weights")
    for kind, config in TINY.items():
        new_network(config).save_pretrained(folder / f"{kind}.safetensors")
    return {kind: f"m3depth:{folder / kind}.safetensors" for kind in TINY}


@pytest.mark.parametrize("kind", TINY)
@pytest.mark.parametrize(("dtype", "precision"), [(None, "fp32"), (torch.bfloat16, "bf16")])
def test_results_record_what_ran_another_network(rivals, monkeypatch, kind, dtype, precision):
    """OpenVINO, which is installed here and asked for, runs M3Depth alone."""
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: True)
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: dtype)
    for device in ("cpu", "cuda"):
        monkeypatch.setattr("m3depth.runtimes.choice.chosen_device", lambda _, device=device: torch.device(device))
        for wanted in ("auto", "openvino"):
            record = recorded_runtime(["sgbm", rivals[kind]], wanted)
            assert record == f"pytorch {version('torch')} {device} {precision}"


def test_m3depth_and_another_network_in_one_program_have_one_record(rivals):
    assert recorded_runtime([rivals["fusion"], "m3depth"]) == recorded_runtime(["m3depth"])


def test_both_programs_are_recorded_that_of_m3depth_first(rivals, monkeypatch):
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: True)
    monkeypatch.setattr("m3depth.runtimes.choice.version", lambda package: f"1.{len(package)}")
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: None)
    record = recorded_runtime([rivals["raft-stereo"], "m3depth"], device="cpu")
    assert record == "openvino 1.8 cpu fp32 + pytorch 1.5 cpu fp32"


def test_records_of_networks_that_did_not_run_are_left_out():
    assert joined_runtimes(["openvino 1.0", None]) == joined_runtimes([None, "openvino 1.0"]) == "openvino 1.0"
    assert joined_runtimes([None, None]) is None
    both = "openvino 1.0 + pytorch 2.0"
    assert joined_runtimes([both, "openvino 1.0", None, both]) == both
    assert runtime_sentence(both) == f"Networks ran in {both}. " and runtime_sentence(None) == ""


def test_no_runtime_is_recorded_without_a_network():
    assert recorded_runtime(["ground_truth", "sgbm", "my_stereo:m3depth"]) is None


@pytest.mark.parametrize(("dtype", "precision"), [(None, "fp32"), (torch.bfloat16, "bf16")])
def test_results_record_openvino(installed, monkeypatch, dtype, precision):
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: dtype)
    record = f"openvino {version('openvino')} cpu {precision}"
    assert recorded_runtime(["m3depth"], device="cpu") == recorded_runtime(["m3depth"], "openvino") == record


def test_records_without_device_and_precision_are_compared_without_them():
    assert same_runtime("openvino 1.0 cpu bf16", "openvino 1.0") and same_runtime("openvino 1.0", "openvino 1.0")
    assert not same_runtime("openvino 1.0 cpu bf16", "openvino 1.1")
    assert not same_runtime("openvino 1.0 cpu bf16", "openvino 1.0 cpu fp32")


def test_records_of_two_programs_are_compared_one_by_one():
    both = "openvino 1.0 cpu bf16 + pytorch 2.0 cpu bf16"
    assert same_runtime(both, "openvino 1.0") and same_runtime("openvino 1.0 + pytorch 2.0 cpu bf16", both)
    assert not same_runtime(both, "openvino 1.0 cpu bf16 + pytorch 2.1 cpu bf16")
    assert not same_runtime(both, "pytorch 2.0 cpu bf16")
