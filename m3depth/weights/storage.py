"""Weights on disk: safetensors, with the network's config in the metadata of the same file.

Loading reads the config in that file alone. A copy of it stands beside the file as JSON, for people and for
`m3depth.train --network`, which makes a new network of the same sizes. Changing the copy does not change the weights.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from m3depth.weights import WANTED, check_weights_file
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import json_text

# Types that weights may have.
DTYPES = (torch.float32, torch.float16, torch.bfloat16)


def save_weights(path: Path, config: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    """Write the weights to `path`, and the network's config as JSON beside it (same name, .json).

    Args:
        path: The file, *.safetensors.
        config: The network's config as its to_dict returns it, plain numbers and the kind of network.
        tensors: The state_dict of the network.

    Raises:
        ValueError: path does not end in .safetensors.
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"{path}: weights are written as .safetensors")
    plain = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
    text = json_text(config, indent=2) + "\n"
    # The file holds its config too, so a JSON file of other weights beside it cannot mislead the loader.
    write_atomically(path, save(plain, metadata={"m3depth_config": json_text(config)}))
    write_atomically(path.with_suffix(".json"), text.encode())


def load_weights(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Read config and tensors of a file that save_weights wrote. Nothing in the file is executed.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, belongs to another network, or holds numbers of another type or that are not
            finite. The message names it.
    """
    check_weights_file(path)
    try:
        with safe_open(str(path), framework="pt", device="cpu") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in list(file.keys())}
    except (SafetensorError, OSError, RuntimeError) as error:
        raise ValueError(f"{path}: not a readable .safetensors file ({str(error).splitlines()[0]}); {WANTED}") from None
    try:
        config = json.loads(metadata["m3depth_config"])
    except (KeyError, json.JSONDecodeError, RecursionError):
        raise ValueError(f"{path}: holds no m3depth_config, so these are not weights of M3Depth; {WANTED}") from None
    if not isinstance(config, dict):
        raise ValueError(f"{path}: m3depth_config is not a JSON object")
    mistyped = sorted(name for name, tensor in tensors.items() if tensor.dtype not in DTYPES)
    if mistyped:
        kind = str(tensors[mistyped[0]].dtype).removeprefix("torch.")
        raise ValueError(f"{path}: {mistyped[0]!r} is of {kind}; weights are float32, float16 or bfloat16")
    not_finite = sorted(name for name, tensor in tensors.items() if not torch.isfinite(tensor).all())
    if not_finite:
        raise ValueError(
            f"{path}: {counted(len(not_finite), 'tensor')} of NaN or infinity, the first is {not_finite[0]!r}; the "
            "file is damaged, or its training diverged"
        )
    return config, tensors
