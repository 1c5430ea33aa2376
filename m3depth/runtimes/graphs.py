"""The network as graphs of OpenVINO, for any height and width.

One graph has the cost volume, the other goes on from a Start. Both are traced from PyTorch, in fp32 or as its autocast
rounds to bf16: convolutions in bf16, disparity and its geometry in fp32. OpenVINO's own bf16 rounds the disparities
too, which changes them by 0.08 px in the mean.

OpenVINO's frontend makes a graph of what PyTorch traced. `openvino.convert_model` makes one that computes the same, but
reports each conversion to Intel by way of Google Analytics, from forked processes, and takes three times as long.
"""

from __future__ import annotations

import copy
import io
import tempfile
import warnings
import zipfile
import zlib
from pathlib import Path

import torch
from torch import Tensor, nn

from m3depth.network.model import M3Depth
from m3depth.network.output import Start
from m3depth.runtimes.openvino_import import openvino

PARTS = ("graph.xml", "graph.bin")  # entries of a packed graph: the operations, and their weights


def converted(network: M3Depth, finer: bool, dtype: torch.dtype) -> bytes:
    """Return one of the two graphs of a network, packed as a zip file.

    Its inputs and outputs, all fp32, are the tensors that `forward` takes and returns: left, right and camera, with
    `finer` also those of the Start; disparity, normal, confidence, sky and, if the network has one, the context.

    Args:
        network: The network.
        finer: Whether the graph goes on from a Start.
        dtype: Precision of the convolutions, torch.float32 or torch.bfloat16.
    """
    config = network.config
    wrapped = _Graph(_rewritten(network, dtype), dtype).eval()
    # No multiple of the network's, and short of one by more than a cell: paddings then become part of the graph.
    height = 2 * config.size_multiple - 14
    size = (height, height + 4)
    example = [*torch.rand(2, 1, 3, *size), torch.tensor([[100.0, 100.0, height / 2, height / 2]])]
    if finer:
        example += [8 * torch.rand(1, 1, *size), -torch.ones(1, 3, *size) / 3**0.5]
        if config.residual_width:
            example.append(torch.rand(1, config.residual_width, *(-(-side // 8) for side in size)))
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # about constants while tracing
        traced = torch.jit.trace(wrapped, tuple(example), check_trace=False)
        frontend = openvino.frontend.FrontEndManager().load_by_framework("pytorch")
        decoder = openvino.frontend.pytorch.ts_decoder.TorchScriptPythonDecoder(traced, example_input=tuple(example))
        graph = frontend.convert(frontend.load(decoder))
        passes = openvino.passes.Manager()
        passes.register_pass(openvino.passes.ConstantFolding())  # a quarter less to compile in each process
        passes.run_passes(graph)
    return packed(graph)  # while `wrapped` exists: the graph shares the memory of its weights


def packed(graph: openvino.Model) -> bytes:
    """Return a graph as a zip file."""
    buffer = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        openvino.save_model(graph, Path(folder) / PARTS[0], compress_to_fp16=False)
        for part in PARTS:
            file.write(Path(folder) / part, part)
    return buffer.getvalue()


def unpacked(data: bytes) -> openvino.Model:
    """Return the graph of a zip file that `packed` made.

    Raises:
        ValueError: The data is damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            operations, weights = (file.read(part) for part in PARTS)  # which checks their CRC
        return openvino.Core().read_model(operations, weights)
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"the graph of OpenVINO cannot be read ({error})") from None


class _Graph(nn.Module):
    """The network with tensors as inputs and outputs."""

    def __init__(self, network: M3Depth, dtype: torch.dtype) -> None:
        super().__init__()
        self.network, self.dtype = network, dtype

    def forward(self, left: Tensor, right: Tensor, camera: Tensor, *start: Tensor) -> tuple[Tensor, ...]:
        given = None
        if start:
            given = Start(start[0], start[1], start[2].to(self.dtype) if len(start) == 3 else None)
        low = self.dtype != torch.float32
        # without a cache of weights in low precision, which would be traced in one place only
        with torch.autocast("cpu", torch.bfloat16, enabled=low, cache_enabled=False):
            out = self.network(left, right, camera, given)
        maps = (out.disparity, out.normal, out.confidence, out.sky)
        return maps if out.context is None else (*maps, out.context.float())


class _GroupNorm(nn.Module):
    """A group normalisation in fp32 that takes means over places first, then over the channels of a group.

    OpenVINO's makes one axis of the channels and places of a group. Its convolutions have the channels last in memory,
    so it copies their results for that, and back for the next convolution.
    """

    def __init__(self, norm: nn.GroupNorm, dtype: torch.dtype) -> None:
        super().__init__()
        self.groups, self.eps, self.dtype = norm.num_groups, norm.eps, dtype
        self.weight, self.bias = norm.weight, norm.bias

    def forward(self, x: Tensor) -> Tensor:
        x = x.float()
        of_channels = (-1, *(1,) * (x.ndim - 2))
        x = x - self._means(x)
        scale = torch.rsqrt(self._means(x * x) + self.eps) * self.weight.view(of_channels)
        return (x * scale + self.bias.view(of_channels)).to(self.dtype)

    def _means(self, x: Tensor) -> Tensor:
        """Return the mean of each channel's group, (B, C, 1, ...); x: (B, C, ...)."""
        by_group = x.mean(tuple(range(2, x.ndim)), keepdim=True).unflatten(1, (self.groups, -1))
        return by_group.mean(2, keepdim=True).expand_as(by_group).flatten(1, 2)


def _rewritten(network: M3Depth, dtype: torch.dtype) -> M3Depth:
    """Return a copy of a network whose layers are as OpenVINO computes them fast, in a precision."""
    rewritten = copy.deepcopy(network)
    for layer in [*rewritten.modules()]:
        for name, part in layer.named_children():
            if isinstance(part, nn.GroupNorm):
                setattr(layer, name, _GroupNorm(part, dtype))
        if dtype != torch.float32 and isinstance(layer, nn.Conv2d | nn.Conv3d | nn.ConvTranspose3d):
            layer.to(dtype)
            # OpenVINO reads numbers of bf16 in the order of the memory, which channels_last changes
            layer.weight.data = layer.weight.data.contiguous()
    return rewritten
