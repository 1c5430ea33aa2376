"""M3Depth run by OpenVINO on the CPU.

A graph holds the scores of all pairs of pixels of a row at once, whose number grows with the cube of the image's side.
PyTorch runs the network's lookups row band by row band. So it also runs the passes over large and wide images here.
"""

from __future__ import annotations

from collections import OrderedDict
from copy import deepcopy
from functools import cache
from threading import Lock
from typing import Any

import numpy as np
import torch
from torch import Tensor

from m3depth.network.device import autocast, fast_dtype
from m3depth.network.inference import infer_pair
from m3depth.network.model import M3Depth
from m3depth.network.output import Start, StereoOutput
from m3depth.network.refinement import CELL
from m3depth.runtimes.graph_files import graph_name, kept
from m3depth.runtimes.graphs import converted
from m3depth.runtimes.openvino_import import openvino
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

LARGEST = 2_000_000  # [px] of a pass that a graph runs; 2048 x 2048 scores take 0.4 GB in bf16, 4096 x 3072 2.4 GB
LARGEST_SCORES = 66_000_000  # of all pairs of a row at 1/4; with their means along the row, they take 0.2 GB in bf16
SIZES = 4  # compiled sizes that are kept: a large pair takes two, each some 100 MB at 512 x 512 px


class OpenVinoM3Depth:
    """A network of network.model.M3Depth, run by OpenVINO on the CPU: the same `infer`, the same maps.

    Passes over images that are large (LARGEST) or wide (LARGEST_SCORES) run in PyTorch.

    Graphs are compiled for each size of images, in a second or two. OpenVINO gets as many threads as PyTorch has
    (OMP_NUM_THREADS), which do not stay on one core, so that processes do not meet on it.

    Attributes:
        network: The network.
        dtype: Precision of the convolutions; disparities are fp32 always.
    """

    def __init__(self, network: M3Depth, dtype: torch.dtype | None = None) -> None:
        """Convert the network, or read what an earlier process converted.

        Args:
            network: The network, in evaluation mode, on any device, where it stays.
            dtype: torch.float32 or torch.bfloat16; None: as PyTorch computes on this processor.
        """
        device = next(network.parameters()).device
        self.network = network if device.type == "cpu" else deepcopy(network).cpu()
        self.dtype = dtype or fast_dtype(torch.device("cpu")) or torch.float32
        self._graphs = {False: self._graph(finer=False)}
        self._requests: OrderedDict[tuple[bool, int, int], openvino.InferRequest] = OrderedDict()
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the network alone: what is compiled belongs to a process."""
        return OpenVinoM3Depth, (self.network, self.dtype)

    @torch.inference_mode()
    def infer(
        self, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None,
        max_pixels: int | None = None, align_rows: bool = False,
    ) -> Prediction:  # fmt: skip
        """Estimate depth, disparity, normals and confidence of one rectified pair, as M3Depth.infer does.

        Args:
            left, right: (H, W) or (H, W, 3) uint8, RGB.
            rig: The cameras of these images.
            nearest: The shortest distance that should be measured [m]; None is 0.84 m.
            max_pixels: Largest number of pixels of an image that the network works on; None: as many as the images
                have.
            align_rows: Whether rows of the images that lie significantly apart are aligned first.

        Raises:
            ValueError: Images of a wrong type or size, `nearest` is not positive, or `max_pixels` is below 2048.
        """
        cpu = torch.device("cpu")
        with self._lock:  # a request works on one pair at a time
            return infer_pair(
                self._run, self.network.reach, self.network.goes_on, cpu, left, right, rig, nearest, max_pixels,
                align_rows,
            )  # fmt: skip

    def _run(self, left: Tensor, right: Tensor, camera: Tensor, start: Start | None) -> StereoOutput:
        height, width = left.shape[-2:]
        scores = -(-height // CELL) * (-(-width // CELL)) ** 2
        if height * width > LARGEST or scores > LARGEST_SCORES:
            with autocast(left.device, None if self.dtype == torch.float32 else self.dtype):
                return self.network(left, right, camera, start)
        inputs = [left, right, camera, *(x for x in start or () if x is not None)]
        request = self._request(start is not None, height, width)
        arrays = request.infer(  # the maps are read before the request is used again
            [x.float().contiguous().numpy() for x in inputs], share_inputs=True, share_outputs=True
        )
        maps = [torch.from_numpy(array) for array in arrays.to_tuple()]
        return StereoOutput(maps[0], maps[1], maps[2], maps[3], None, [], maps[4] if len(maps) > 4 else None)

    def _request(self, finer: bool, height: int, width: int) -> openvino.InferRequest:
        key = finer, height, width
        if key not in self._requests:
            while len(self._requests) >= SIZES:
                self._requests.popitem(last=False)
            self._requests[key] = self._compiled(*key).create_infer_request()
        self._requests.move_to_end(key)
        return self._requests[key]

    def _compiled(self, finer: bool, height: int, width: int) -> openvino.CompiledModel:
        """Compile a graph for one size [px]: it is a fifth faster than one for any size."""
        if finer not in self._graphs:
            self._graphs[finer] = self._graph(finer)
        context = self.network.config.residual_width, -(-height // 8), -(-width // 8)
        channels = (3, 3, None, 1, 3)  # of left, right, (camera,) disparity, normal
        shapes = [[1, 4] if c is None else [1, c, height, width] for c in channels] + [[1, *context]]
        graph = self._graphs[finer].clone()
        graph.reshape({place: shapes[place] for place in range(len(graph.inputs))})
        settings = {
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_PRECISION_HINT": "f32",  # for what the graph does not round itself
            "INFERENCE_NUM_THREADS": torch.get_num_threads(),
            "ENABLE_CPU_PINNING": False,
        }
        return _core().compile_model(graph, "CPU", settings)

    def _graph(self, finer: bool) -> openvino.Model:
        name = graph_name(self.network, finer, self.dtype)
        return kept(name, lambda: converted(self.network, finer, self.dtype))


@cache
def _core() -> openvino.Core:
    return openvino.Core()
