"""Activation checkpointing: time for memory, the same gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch.utils.checkpoint import checkpoint

Part = Callable[..., Any]


def direct(part: Callable[..., Any], *inputs: Any) -> Any:
    """Call a part of the network as it is."""
    return part(*inputs)


def recomputed(part: Callable[..., Any], *inputs: Any) -> Any:
    """Call a part without keeping what lies between its inputs and its outputs; the backward pass computes it anew."""
    return checkpoint(part, *inputs, use_reentrant=False, preserve_rng_state=False)
