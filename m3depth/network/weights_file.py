"""Weights on disk: safetensors, with the network's config in the file's own metadata, which alone is read.

The same config stands beside it as JSON, for people, and for `m3depth.train --network`, which makes a new network of
the same sizes: changing it changes nothing of the weights.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from marssim.base.command.input_file import check_file
from marssim.base.command.notes import counted
from marssim.base.files.atomic import write_atomically

DTYPES = (torch.float32, torch.float16, torch.bfloat16)


def save_weights(path: Path, config: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    """Write `path` and the network's config, plain numbers, as JSON beside it (same name, .json).

    Raises ValueError if path does not end in .safetensors.
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"{path}: weights are written as .safetensors")
    plain = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
    text = json.dumps(config, indent=2) + "\n"
    # The file carries its config too: weights and JSON that were mixed up by hand are not loaded as each other's.
    write_atomically(path, save(plain, metadata={"m3depth_config": json.dumps(config)}))
    write_atomically(path.with_suffix(".json"), text.encode())


def load_weights(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The config and tensors of a file that save_weights wrote; nothing in it is executed.

    The config is the one inside the file: the JSON beside it is for people, and for --network of m3depth.train.
    Raises FileNotFoundError if it is missing, ValueError that names the file if it is damaged, holds numbers of
    another kind or that are not finite, or is of another network.
    """
    check_file(path, "weights file")
    try:
        with safe_open(str(path), framework="pt", device="cpu") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in list(file.keys())}
    except (SafetensorError, OSError, RuntimeError) as error:
        raise ValueError(f"{path}: not a readable safetensors file ({str(error).splitlines()[0]})") from None
    try:
        config = json.loads(metadata["m3depth_config"])
    except (KeyError, json.JSONDecodeError, RecursionError):
        raise ValueError(f"{path}: holds no m3depth_config; these are not weights of M3Depth") from None
    if not isinstance(config, dict):
        raise ValueError(f"{path}: m3depth_config is not a JSON object")
    strange = sorted(name for name, tensor in tensors.items() if tensor.dtype not in DTYPES)
    if strange:
        kind = str(tensors[strange[0]].dtype).removeprefix("torch.")
        raise ValueError(f"{path}: {strange[0]!r} is of {kind}; weights are float32, float16 or bfloat16")
    spoilt = sorted(name for name, tensor in tensors.items() if not torch.isfinite(tensor).all())
    if spoilt:
        raise ValueError(
            f"{path}: {counted(len(spoilt), 'tensor')} of NaN or infinity, the first is {spoilt[0]!r}: damaged, or of "
            "a training that diverged"
        )
    return config, tensors
