"""Activation checkpointing: takes more time and less memory for the same gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch.utils.checkpoint import checkpoint

Caller = Callable[..., Any]
"""A way to call a part of the network: direct or recomputed."""


def direct(part: Callable[..., Any], *inputs: Any) -> Any:
    """Call a part of the network as it is."""
    return part(*inputs)


def recomputed(part: Callable[..., Any], *inputs: Any) -> Any:
    """Call a part and keep only its inputs and outputs; the backward pass computes what lies between once more."""
    return checkpoint(part, *inputs, use_reentrant=False, preserve_rng_state=False)
