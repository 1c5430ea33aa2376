"""Read a policy's .zip without executing anything in it: its tensors, its marks and how far it is trained.

Such a file, as stable-baselines3 writes it, also holds pickled Python objects, which run whatever their author wants as
soon as they are unpickled. They are not read here: tensors come through torch's reader of weights alone, and the rest
through JSON.
"""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from marssim.base.command.input_file import check_file
from marssim.base.files.zip_member import read_member

CORRIDORS = "corridors"  # name of the entry that marks a policy as one of envs.drivers.corridors
WEIGHTS, OPTIMIZER, DATA = "policy.pth", "policy.optimizer.pth", "data"  # entries of stable-baselines3's .zip
MOST_BYTES = 1 << 28  # of an entry once it is unpacked; those of MultiInputPolicy have some 20 MB
MOST_CHOICES = 10**15  # larger counters are no counters of a training


@dataclass(frozen=True)
class PolicyArchive:
    """What is read of a policy's .zip."""

    weights: dict[str, Any]
    """The policy's tensors by name, all dense, of floats and finite."""
    corridors: bool
    """Whether the file is marked as a policy of envs.drivers.corridors."""


def mark_corridors(policy: Path | IO[bytes]) -> None:
    """Mark a policy's .zip as one that observes and acts as envs.drivers.corridors documents.

    Raises:
        FileNotFoundError: The file is missing.
    """
    if isinstance(policy, Path):
        check_file(policy, "policy")
    with zipfile.ZipFile(policy, "a") as archive:
        archive.writestr(CORRIDORS, "")


def read_policy(path: Path) -> PolicyArchive:
    """Read a policy's tensors.

    Raises:
        FileNotFoundError: The file is missing.
        ValueError: The file holds no policy; one line that names it.
    """
    check_file(path, "policy")
    try:
        with zipfile.ZipFile(path) as archive:
            weights = _tensors(archive, WEIGHTS)
            corridors = CORRIDORS in archive.namelist()
        for name in ("action_net.weight",) if corridors else ("action_net.weight", "log_std"):
            if name not in weights:
                raise ValueError(f"{WEIGHTS} has no {name}")
        for name, tensor in weights.items():
            if not isinstance(name, str) or not _is_sound(tensor):
                raise ValueError(f"{WEIGHTS}: {name!r:.60} must be a dense tensor of finite floats")
    except Exception as error:  # zipfile and torch raise errors of many types on broken files
        raise ValueError(f"{path}: holds no policy of stable-baselines3's PPO ({_reason(error)})") from None
    return PolicyArchive(weights, corridors)


def restore_training(path: Path, policy: Any) -> int:
    """Load a file's weights and the state of its optimizer into a policy. Hyperparameters stay those of the policy.

    Args:
        path: The .zip that stable-baselines3 saved.
        policy: A policy of stable-baselines3 with an optimizer, of the same sizes.

    Returns:
        The number of choices that the policy has been trained on.

    Raises:
        FileNotFoundError: The file is missing.
        ValueError: The file holds no policy of these sizes, or no such state; one line that names it.
    """
    weights = read_policy(path).weights
    try:
        with zipfile.ZipFile(path) as archive:
            moments = _tensors(archive, OPTIMIZER)["state"]
            choices = json.loads(_entry(archive, DATA))["num_timesteps"]
        if type(choices) is not int or not 0 <= choices <= MOST_CHOICES:
            raise ValueError(f"num_timesteps must be 0 to {MOST_CHOICES:g}, got {choices!r:.40}")
        policy.load_state_dict(weights)
        parameters = policy.optimizer.param_groups[0]["params"]
        # before its first update, a training saves an optimizer without state
        state = {number: _moments(moments[number], number, w) for number, w in enumerate(parameters) if moments != {}}
        policy.optimizer.load_state_dict({**policy.optimizer.state_dict(), "state": state})
    except Exception as error:  # as in read_policy; load_state_dict raises several types too
        raise ValueError(f"{path}: no training can be continued from it ({_reason(error)})") from None
    return choices


def _entry(archive: zipfile.ZipFile, name: str) -> bytes:
    if archive.getinfo(name).file_size > MOST_BYTES:
        raise ValueError(f"{name} has more than {MOST_BYTES >> 20} MiB")
    return read_member(archive, name)


def _tensors(archive: zipfile.ZipFile, name: str) -> dict[Any, Any]:
    """Return a dict of tensors that torch saved in an entry. torch's reader of weights executes nothing."""
    import torch

    with warnings.catch_warnings(action="ignore"):  # about pickle protocols, of files that are refused then
        content = torch.load(io.BytesIO(_entry(archive, name)), map_location="cpu", weights_only=True)
    if not isinstance(content, dict):
        raise ValueError(f"{name} holds no tensors by name")
    return dict(content)


def _moments(state: Any, number: int, weight: Any) -> dict[str, Any]:
    """Return what Adam keeps of a weight. Raises ValueError if it does not fit the weight."""
    shapes = {"step": (), "exp_avg": tuple(weight.shape), "exp_avg_sq": tuple(weight.shape)}
    for name, shape in shapes.items():
        if not _is_sound(state.get(name)) or tuple(state[name].shape) != shape:
            raise ValueError(f"{OPTIMIZER}: {name} of weight {number} must be a finite tensor of shape {shape}")
    return {name: state[name] for name in shapes}


def _is_sound(tensor: Any) -> bool:
    """Return whether a value is a dense tensor of floats on the CPU, all of them finite."""
    import torch

    return (
        isinstance(tensor, torch.Tensor)
        and tensor.layout == torch.strided
        and tensor.device.type == "cpu"
        and tensor.is_floating_point()
        and tensor.numel() <= MOST_BYTES  # a view may repeat one element as often as it likes
        and bool(torch.isfinite(tensor).all())
    )


def _reason(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
