"""What a network computes on, and in which precision."""

from __future__ import annotations

import torch


def chosen_device(wanted: str, number: int = 0) -> torch.device:
    """The device that --device names: cpu, cuda, or auto, a GPU if there is one. number: which GPU.

    Raises ValueError for cuda where there is none.
    """
    found = torch.cuda.is_available()
    if wanted == "cuda" and not found:
        raise ValueError("--device cuda: no GPU was found")
    return torch.device("cuda", number) if found and wanted != "cpu" else torch.device("cpu")


def fast_dtype(device: torch.device) -> torch.dtype | None:
    """bfloat16 where the device computes in it (GPU, AMX, AVX-512 BF16); None: stay in float32."""
    if device.type == "cuda":
        return torch.bfloat16 if torch.cuda.is_bf16_supported() else None
    if device.type == "cpu":
        probes = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")
        if any(getattr(torch.cpu, name, lambda: False)() for name in probes):
            return torch.bfloat16
    return None


def autocast(device: torch.device, dtype: torch.dtype | None) -> torch.autocast:
    """The context in which a network computes in dtype; None: in float32."""
    return torch.autocast(device.type, dtype or torch.bfloat16, enabled=dtype is not None)
