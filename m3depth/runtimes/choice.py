"""Which program runs M3Depth, PyTorch or OpenVINO, and what results record of it.

The same program gives other depths on a GPU than on the CPU, and in bf16 than in fp32, which it takes by itself. So
results record these too. Importing this module loads neither program.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from m3depth.weights.config_json import kind_in_file

RuntimeName = Literal["pytorch", "openvino"]
RuntimeChoice = Literal["auto", "pytorch", "openvino"]
RUNTIMES: tuple[RuntimeChoice, ...] = ("auto", "pytorch", "openvino")
PACKAGES: dict[RuntimeName, str] = {"pytorch": "torch", "openvino": "openvino"}  # by the name of the runtime


def chosen_runtime(wanted: str = "auto", device: str = "auto") -> RuntimeName:
    """Return the program that runs the network.

    Args:
        wanted: "pytorch", "openvino", or "auto", which is OpenVINO where it is installed and the device is the CPU, and
            PyTorch otherwise.
        device: "cpu", "cuda", or "auto" for a GPU if there is one. OpenVINO runs on the CPU in any case.

    Raises:
        ImportError: OpenVINO is wanted and not installed; the message names the extra.
        ValueError: The name is unknown, OpenVINO is wanted on a GPU, or cuda without a GPU.
    """
    check_runtime(wanted)
    if wanted == "openvino":
        if device == "cuda":
            raise ValueError("`runtime` openvino runs on the CPU, not on cuda: choose the device cpu, or pytorch")
        if not openvino_is_installed():
            raise ImportError("`runtime` openvino: it is not installed; pip install 'mars-m3depth[fast]'")
        return "openvino"
    if wanted == "pytorch" or not openvino_is_installed():
        return "pytorch"
    from m3depth.network.device import chosen_device

    return "openvino" if chosen_device(device).type == "cpu" else "pytorch"


def check_runtime(wanted: str) -> None:
    """Raise ValueError if there is no runtime of this name."""
    if wanted not in RUNTIMES:
        raise ValueError(f"`runtime` {wanted!r} is unknown; choose from {', '.join(RUNTIMES)}")


def openvino_is_installed() -> bool:
    """Return whether Python finds OpenVINO."""
    return find_spec("openvino") is not None


def recorded_runtime(names: Iterable[str], wanted: str = "auto", device: str = "auto") -> str | None:
    """Return what runs M3Depth, as results record it: "openvino 2026.4.1 cpu bf16".

    These are the program's name and version, the kind of the device, and the precision of the convolutions.

    Args:
        names: Names of methods, as EstimatorName takes them, or others.
        wanted: As chosen_runtime takes it.
        device: As chosen_runtime takes it.

    Returns:
        The record; None where no name is that of M3Depth or of weights of it, other networks being PyTorch's always.
    """
    if not any(_is_m3depth(name) for name in names):
        return None
    name = chosen_runtime(wanted, device)
    return " ".join([name, version(PACKAGES[name]), *_device_and_precision(name, device)])


def same_runtime(one: str, other: str) -> bool:
    """Return whether two records may be of one runtime. Records of earlier releases lack device and precision."""
    return all(a == b for a, b in zip(one.split(), other.split()))


def _device_and_precision(name: RuntimeName, wanted: str) -> tuple[str, str]:
    """Return the kind of the device on which a runtime runs here, and "bf16" or "fp32"."""
    import torch

    from m3depth.network.device import chosen_device, fast_dtype

    device = torch.device("cpu") if name == "openvino" else chosen_device(wanted)
    return device.type, "fp32" if fast_dtype(device) is None else "bf16"


def _is_m3depth(name: str) -> bool:
    """Return whether a name is that of M3Depth, or of a file of its weights or one that cannot be read."""
    first, _, path = name.partition(":")
    return first == "m3depth" and (not path or kind_in_file(Path(path)) in (None, "m3depth"))
