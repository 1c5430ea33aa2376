"""The processes of torchrun that train one network together; a process alone is a group of one."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import torch
import torch.distributed as dist

from m3depth.network.device import chosen_device


@contextmanager
def joined_group(device_name: str) -> Iterator[tuple[int, int, torch.device]]:
    """Rank, number of processes, device, for as long as the block runs.

    device_name: as chosen_device takes it. A block that ends well waits for the other processes; where it raises, they
    are not waited for.
    """
    device = chosen_device(device_name, int(os.environ.get("LOCAL_RANK", 0)))
    if "LOCAL_RANK" not in os.environ:
        yield 0, 1, device
        return
    if device.type == "cuda":
        torch.cuda.set_device(device)
    # Of 1 x 1 kernels, whose strides mean nothing; twice from each process.
    warnings.filterwarnings("ignore", message="Grad strides do not match bucket view strides")
    if not dist.is_initialized():
        dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield dist.get_rank(), dist.get_world_size(), device
        dist.barrier()
    finally:
        dist.destroy_process_group()


def agree(values: list[float], device: torch.device, world: int) -> list[float]:
    """The largest of each value over all processes."""
    if world == 1:
        return values
    tensor = torch.tensor(values, dtype=torch.float64, device=device)
    dist.all_reduce(tensor, dist.ReduceOp.MAX)
    return tensor.tolist()
