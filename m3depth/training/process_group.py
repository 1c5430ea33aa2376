"""The processes of torchrun that train one network together; a process alone is a group of one."""

from __future__ import annotations

import datetime
import os
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager

import torch
import torch.distributed as dist

from m3depth.network.device import chosen_device
from marssim.base.command.run import describe

LONGEST_WAIT = datetime.timedelta(days=1)  # for rank 0 while it validates; torchrun ends the others where one has ended


@contextmanager
def joined_group(device_name: str) -> Iterator[tuple[int, int, torch.device]]:
    """Join the processes of torchrun, for as long as the block runs.

    A block that ends normally waits for the other processes; one that raises does not. On GPUs, its process should then
    end at once, as m3depth.train does: NCCL leaves a group only when all have, and the others wait for this process.

    Args:
        device_name: As chosen_device takes it.

    Yields:
        Rank of this process, number of processes, and its device.
    """
    device = chosen_device(device_name, int(os.environ.get("LOCAL_RANK", 0)))
    if "LOCAL_RANK" not in os.environ:
        yield 0, 1, device
        return
    if device.type == "cuda":
        torch.cuda.set_device(device)
    # Each process prints it twice, about 1 x 1 kernels, whose strides have no meaning.
    warnings.filterwarnings("ignore", message="Grad strides do not match bucket view strides")
    if not dist.is_initialized():
        if device.type == "cuda":
            dist.init_process_group("nccl", timeout=LONGEST_WAIT, device_id=device)
        else:
            dist.init_process_group("gloo", timeout=LONGEST_WAIT)
    try:
        yield dist.get_rank(), dist.get_world_size(), device
        dist.barrier()
    except BaseException:
        if device.type != "cuda":
            dist.destroy_process_group()
        raise
    dist.destroy_process_group()


@contextmanager
def entered_by_first(rank: int, world: int, context: AbstractContextManager[object]) -> Iterator[None]:
    """Enter a context in process 0 alone, and raise its refusal in every process, so that none waits for the others.

    Args:
        rank: This process, counted from 0.
        world: Number of processes.
        context: What process 0 enters and leaves, for as long as the block runs there.

    Raises:
        ValueError: In the other processes, with the message of a ValueError or OSError that `context` raised.
    """
    with ExitStack() as stack:
        refusal: list[str | None] = [None]
        error: ValueError | OSError | None = None
        if rank == 0:
            try:
                stack.enter_context(context)
            except (ValueError, OSError) as refused:
                error, refusal = refused, [describe(refused)]
        if world > 1:
            dist.broadcast_object_list(refusal, src=0)
        if error is not None:
            raise error
        if refusal[0] is not None:
            raise ValueError(refusal[0])
        yield


def agree(values: list[float], device: torch.device, world: int) -> list[float]:
    """Return the largest of each value over all processes.

    Args:
        values: The values of this process.
        device: Device of this process.
        world: Number of processes.
    """
    if world == 1:
        return values
    tensor = torch.tensor(values, dtype=torch.float64, device=device)
    dist.all_reduce(tensor, dist.ReduceOp.MAX)
    return tensor.tolist()
