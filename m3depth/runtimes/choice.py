"""Which program runs M3Depth, PyTorch or OpenVINO, and what results record of it and of the other networks.

The same program gives other depths on a GPU than on the CPU, and in bf16 than in fp32, which it takes by itself. So
results record these too. PyTorch runs the networks of other methods. Importing this module loads neither program.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from m3depth.network.device import check_device, chosen_device, fast_dtype
from m3depth.weights.config_json import kind_in_file

_M3DEPTH = "m3depth"  # its name, and its kind in files of weights
RuntimeName = Literal["pytorch", "openvino"]
RuntimeChoice = Literal["auto", "pytorch", "openvino"]
RUNTIMES: tuple[RuntimeChoice, ...] = ("auto", "pytorch", "openvino")
PACKAGES: dict[RuntimeName, str] = {"pytorch": "torch", "openvino": "openvino"}  # by the name of the runtime
AND = " + "  # between the runtimes of M3Depth and of other networks, where they differ


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
    check_runtime(wanted, device)
    if wanted == "openvino":
        if device == "cuda":
            raise ValueError("`runtime` openvino runs on the CPU, not on cuda: choose the device cpu, or pytorch")
        if not openvino_is_installed():
            raise ImportError('`runtime` openvino: it is not installed; pip install "mars-m3depth[fast]"')
        return "openvino"
    if wanted == "pytorch" or not openvino_is_installed():
        return "pytorch"
    return "openvino" if chosen_device(device).type == "cpu" else "pytorch"


def check_runtime(wanted: str, device: str = "auto") -> None:
    """Raise ValueError if there is no runtime, or no device, of this name."""
    check_device(device)
    if wanted not in RUNTIMES:
        raise ValueError(f"`runtime` {wanted!r} is unknown; choose from {', '.join(RUNTIMES)}")


def openvino_is_installed() -> bool:
    """Return whether Python finds OpenVINO."""
    return find_spec("openvino") is not None


def recorded_runtime(names: Iterable[str], wanted: str = "auto", device: str = "auto") -> str | None:
    """Return what runs the networks among some methods, as results record it: "openvino 2026.4.1 cpu bf16".

    These are the program's name and version, the kind of the device, and the precision of the convolutions.

    Args:
        names: Names of methods, as EstimatorName takes them, or others.
        wanted: As chosen_runtime takes it, for M3Depth.
        device: As chosen_runtime takes it.

    Returns:
        The record. Where PyTorch runs other networks beside M3Depth in OpenVINO, both records, as joined_runtimes
        returns them. None where no name is that of M3Depth or of weights.
    """
    networks = [_network(name) for name in names]
    runtimes: list[RuntimeName] = []
    if _M3DEPTH in networks:
        runtimes.append(chosen_runtime(wanted, device))
    if any(network not in (None, _M3DEPTH) for network in networks):
        runtimes.append("pytorch")
    return joined_runtimes(
        " ".join([name, version(PACKAGES[name]), *_device_and_precision(name, device)]) for name in runtimes
    )


def runtime_sentence(runtime: str | None) -> str:
    """Return what a report says of a record of recorded_runtime, with a space after it; nothing of None."""
    return "" if runtime is None else f"Networks ran in {runtime}. "


def joined_runtimes(records: Iterable[str | None]) -> str | None:
    """Return the records of M3Depth and of other networks as one; None if there is none.

    Args:
        records: That of M3Depth first, then that of other networks; None where such a network did not run. They may be
            joined ones.

    Returns:
        "openvino 2026.4.1 cpu bf16 + pytorch 2.9.1 cpu bf16", or one record alone where both are equal.
    """
    return AND.join(dict.fromkeys(part for record in records if record for part in record.split(AND))) or None


def same_runtime(one: str, other: str) -> bool:
    """Return whether two records may be of one runtime.

    Records of earlier releases lack device and precision, and what ran other networks beside M3Depth.
    """
    pairs = zip(one.split(AND), other.split(AND))
    return all(a == b for first, second in pairs for a, b in zip(first.split(), second.split()))


def is_other_network(name: str) -> bool:
    """Return whether a name is that of weights of a network other than M3Depth, which PyTorch runs in any case."""
    return _network(name) not in (None, _M3DEPTH)


def _device_and_precision(name: RuntimeName, wanted: str) -> tuple[str, str]:
    """Return the kind of the device on which a runtime runs here, and "bf16" or "fp32"."""
    import torch

    device = torch.device("cpu") if name == "openvino" else chosen_device(wanted)
    return device.type, "fp32" if fast_dtype(device) is None else "bf16"


def _network(name: str) -> str | None:
    """Return the kind of network that a name stands for, M3Depth where its file cannot be read; None for no network."""
    first, _, path = name.partition(":")
    if first != _M3DEPTH:
        return None
    return (kind_in_file(Path(path)) if path else None) or _M3DEPTH
