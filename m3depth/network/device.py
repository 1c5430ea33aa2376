"""What a network computes on, and in which precision."""

from __future__ import annotations

import torch

from marssim.base.command.notes import counted


def chosen_device(wanted: str, number: int = 0) -> torch.device:
    """The device that --device names: cpu, cuda, or auto, a GPU if there is one. number: which GPU.

    Raises ValueError for cuda where there is none, and for a number that there is not.
    """
    found = torch.cuda.is_available()
    if wanted == "cuda" and not found:
        raise ValueError("--device cuda: no GPU was found")
    if found and wanted != "cpu" and number >= torch.cuda.device_count():
        there = counted(torch.cuda.device_count(), "GPU")
        raise ValueError(
            f"--device {wanted}: {there} here, none for process {number + 1}; give --nproc-per-node as many"
        )
    return torch.device("cuda", number) if found and wanted != "cpu" else torch.device("cpu")


def fast_dtype(device: torch.device) -> torch.dtype | None:
    """bfloat16 where the device computes in it (GPU, AMX, AVX-512 BF16); None: stay in float32."""
    if device.type == "cuda":
        # What is older computes in it too, but slowly, by way of float32.
        own = torch.version.hip is not None or torch.cuda.get_device_capability(device) >= (8, 0)
        return torch.bfloat16 if own else None
    if device.type == "cpu":
        probes = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")
        if any(getattr(torch.cpu, name, lambda: False)() for name in probes):
            return torch.bfloat16
    return None


def autocast(device: torch.device, dtype: torch.dtype | None) -> torch.autocast:
    """The context in which a network computes in dtype; None: in float32."""
    return torch.autocast(device.type, dtype or torch.bfloat16, enabled=dtype is not None)
