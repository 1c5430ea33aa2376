"""The device that a network runs on, and its precision. Importing this module does not load PyTorch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

from marssim.base.command.wording import counted

if TYPE_CHECKING:
    import torch

DeviceName = Literal["auto", "cpu", "cuda"]  # what --device takes
DEVICES: tuple[DeviceName, ...] = get_args(DeviceName)


def check_device(wanted: str) -> None:
    """Raise ValueError if --device takes no such name."""
    if wanted not in DEVICES:
        raise ValueError(f"--device {wanted}: is unknown; choose from {', '.join(DEVICES)}")


def chosen_device(wanted: str, number: int = 0) -> torch.device:
    """Return the device that --device names: cpu, cuda, or auto, which is a GPU if there is one.

    Args:
        wanted: "cpu", "cuda" or "auto".
        number: Which GPU, from 0.

    Raises:
        ValueError: Another name, cuda without a GPU, a number that is too large, or a process that was forked after
            PyTorch had looked for a GPU, which then cannot use one.
    """
    check_device(wanted)
    import torch

    has_gpu = torch.cuda.is_available()
    if wanted == "cuda" and not has_gpu:
        raise ValueError("--device cuda: no GPU was found; choose cpu or auto")
    if has_gpu and wanted != "cpu" and number >= torch.cuda.device_count():
        gpus = counted(torch.cuda.device_count(), "GPU")
        raise ValueError(
            f"--device {wanted}: {gpus} here, none for process {number + 1}; lower --nproc-per-node to that number"
        )
    if has_gpu and wanted != "cpu" and torch.cuda._is_in_bad_fork():
        raise ValueError(
            "PyTorch cannot use a GPU in this process, which was forked from one that had looked for GPUs: start it by "
            "spawn, as by gymnasium.make_vec(..., vector_kwargs={'context': 'spawn'}), or hide GPUs with "
            "CUDA_VISIBLE_DEVICES="
        )
    return torch.device("cuda", number) if has_gpu and wanted != "cpu" else torch.device("cpu")


def fast_dtype(device: torch.device) -> torch.dtype | None:
    """Return bfloat16 where the device computes in it (GPU, AMX, AVX-512 BF16), else None, which is float32."""
    import torch

    if device.type == "cuda":
        # Older GPUs emulate it in float32, which is slow.
        native = torch.version.hip is not None or torch.cuda.get_device_capability(device) >= (8, 0)
        return torch.bfloat16 if native else None
    if device.type == "cpu":
        probes = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")
        if any(getattr(torch.cpu, name, lambda: False)() for name in probes):
            return torch.bfloat16
    return None


def autocast(device: torch.device, dtype: torch.dtype | None) -> torch.autocast:
    """Return the context in which a network computes in dtype; None is float32.

    Args:
        device: The device of the network.
        dtype: The type to compute in; None is float32.
    """
    import torch

    return torch.autocast(device.type, dtype or torch.bfloat16, enabled=dtype is not None)
