"""Write M3Depth as an ONNX file, for runtimes other than PyTorch.

    python -m m3depth.export --out m3depth.onnx
    python -m m3depth.export --weights RUN/weights.safetensors --out mine.onnx

Batch, height and width are free: the network in the file pads images of any size whose longer side has more than 32 px.
Inputs, all float32:

    left, right   (batch, 3, height, width), rectified, RGB, 0 to 1
    camera        (batch, 4), fx, fy, cx, cy [px]; pixel centres are integers

Outputs, float32, at the images' size:

    disparity     (batch, 1, height, width) [px]; depth = fx * baseline / disparity
    normal        (batch, 3, height, width), unit, camera frame (x right, y down, z forward), facing the camera
    confidence    (batch, 1, height, width), probability of an error within 1 px
    sky           (batch, 1, height, width), probability of sky, or of a depth that cannot be measured; depth means
                  nothing where it is large

Disparities of more than 192 px (for the usual 24 hypotheses) are out of reach: reduce such images first, as `infer`
does. The command needs the extra `export` (onnx, onnxruntime). It compares the file with PyTorch in onnxruntime, on the
CPU, at two sizes and two batches, before it writes it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from m3depth.weights import SHIPPED_WEIGHTS, named_by, weights_file
from marssim.base.command.run import run_command
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import json_text

if TYPE_CHECKING:
    from m3depth.network.model import M3Depth

# Names of the file's inputs and outputs, in order.
INPUTS = ("left", "right", "camera")
OUTPUTS = ("disparity", "normal", "confidence", "sky")
OPSETS = (17, 20)  # 17: read by the runtimes of the last years; 20: the last that PyTorch's tracing exporter knows
PARITY = 1e-2  # largest allowed mean difference from PyTorch, of disparity [px] or of another output


@dataclass(frozen=True)
class ExportOptions:
    """Write M3Depth as an ONNX file."""

    out: Path
    """ONNX file to write; its name must end in .onnx."""
    weights: Path | None = None
    """Weights file (.safetensors) that m3depth.train wrote. Without it, or by the word shipped, the shipped weights are
    exported."""
    opset: int = OPSETS[0]
    """Version of the ONNX operator set, 17 to 20."""

    def __post_init__(self) -> None:
        if self.out.suffix != ".onnx":
            raise ValueError(f"--out {self.out}: must end in .onnx")
        if self.out.is_dir():
            raise ValueError(f"--out {self.out}: is a folder")
        if not OPSETS[0] <= self.opset <= OPSETS[1]:
            raise ValueError(f"--opset must be {OPSETS[0]} to {OPSETS[1]}, got {self.opset}")


def to_onnx(model: M3Depth, opset: int = OPSETS[0]) -> bytes:
    """Return the network as a serialised ONNX model; this module's docstring lists inputs and outputs.

    Args:
        model: The network.
        opset: Version of the ONNX operator set.

    Raises:
        ImportError: onnx is not installed; the message names the extra.
    """
    require("onnx")
    import io

    import onnx
    import torch

    class TensorOutputs(torch.nn.Module):
        """The network with tensors as outputs; logits become probabilities."""

        def __init__(self) -> None:
            super().__init__()
            self.network = deepcopy(model).cpu()  # as the example is

        def forward(self, left: torch.Tensor, right: torch.Tensor, camera: torch.Tensor) -> tuple[torch.Tensor, ...]:
            out = self.network(left, right, camera)
            return out.disparity, out.normal, out.confidence.sigmoid(), out.sky.sigmoid()

    free = {name: {0: "batch", 2: "height", 3: "width"} for name in (*INPUTS[:2], *OUTPUTS)}
    # A size that is no multiple of the network's, so that the padding becomes part of the exported graph.
    size = 2 * model.config.size_multiple - 6
    example = (*torch.rand(2, 2, 3, size, size + 4), torch.tensor([[100.0, 100, size / 2, size / 2]] * 2))
    # The newer exporter (dynamo) needs onnxscript, whose optimiser (0.7.2) fails on chunks of a free batch.
    exporter: Any = torch.onnx.export  # whose types leave out files in memory
    buffer = io.BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # about constants while tracing, and about the older exporter
        exporter(
            TensorOutputs().eval(), example, buffer, input_names=list(INPUTS), output_names=list(OUTPUTS),
            dynamic_axes={**free, "camera": {0: "batch"}}, opset_version=opset, dynamo=False,
        )  # fmt: skip
    exported = onnx.load_model_from_string(buffer.getvalue())
    for value in exported.graph.output:  # tracing names unknown sizes after operators
        for place, side in ((1, 3 if value.name == "normal" else 1), (2, "height"), (3, "width")):
            dim = value.type.tensor_type.shape.dim[place]
            dim.Clear()
            setattr(dim, "dim_value" if isinstance(side, int) else "dim_param", side)
    exported.doc_string = (__doc__ or "").strip()
    exported.metadata_props.add(key="m3depth_config", value=json_text(asdict(model.config)))
    onnx.checker.check_model(exported)
    return exported.SerializeToString()


def parity(model: M3Depth, exported: bytes, sizes: Sequence[tuple[int, int, int]]) -> dict[str, float]:
    """Compare the exported network in onnxruntime, on the CPU, with PyTorch's.

    Args:
        model: The network.
        exported: The ONNX model, from to_onnx.
        sizes: Batch, height and width of the textured pairs that both are given.

    Returns:
        Mean and largest difference of disparity [px] ("mean_px", "largest_px"), and of the worst other output
        ("mean_other", "largest_other").

    Raises:
        ImportError: onnxruntime is not installed; the message names the extra.
    """
    require("onnxruntime")
    import onnxruntime
    import torch

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(exported, options, providers=["CPUExecutionProvider"])
    means, largest, other_means, others = [], [], [], []
    for batch, height, width in sizes:
        left, right = textured_pair(batch, height, width)
        camera = np.array([[width, width, (width - 1) / 2, (height - 1) / 2]] * batch, np.float32)
        actual = session.run(list(OUTPUTS), {"left": left, "right": right, "camera": camera})
        device = next(model.parameters()).device
        was_training = model.training
        with torch.inference_mode():
            out = model.eval()(*(torch.from_numpy(x).to(device) for x in (left, right, camera)))
        model.train(was_training)
        expected = (out.disparity, out.normal, out.confidence.sigmoid(), out.sky.sigmoid())
        difference = [np.abs(a - b.float().cpu().numpy()) for a, b in zip(actual, expected)]
        means.append(float(difference[0].mean()))
        largest.append(float(difference[0].max()))
        other_means.append(max(float(d.mean()) for d in difference[1:]))
        others.append(max(float(d.max()) for d in difference[1:]))
    return {
        "mean_px": max(means), "largest_px": max(largest),
        "mean_other": max(other_means), "largest_other": max(others),
    }  # fmt: skip


def textured_pair(batch: int, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a pair of blurred noise whose disparity grows downwards, two (B, 3, H, W) float32 in [0, 1].

    Args:
        batch: Number of pairs, B.
        height: Height of the images [px].
        width: Width of the images [px].
    """
    import cv2

    rng = np.random.default_rng(height * width)
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    pairs = []
    for _ in range(batch):
        right = cv2.GaussianBlur(rng.random((height, width, 3), dtype=np.float32), (0, 0), 1.5)
        right = (right - right.min()) / np.ptp(right)
        left = cv2.remap(right, u - 4 - 0.1 * v, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        pairs.append((left, right))
    left, right = (np.stack(eyes).transpose(0, 3, 1, 2).copy() for eyes in zip(*pairs))
    return left, right


def require(package: str) -> None:
    """Raise ImportError, which says how to install it, if a package is missing."""
    if find_spec(package) is None:
        raise ImportError(f'{package} is not installed; pip install "mars-m3depth[export]"')


def export(options: ExportOptions) -> dict[str, Any]:
    """Export, compare with PyTorch, and only then write the file.

    Args:
        options: The command's flags.

    Returns:
        The differences that `parity` measured, and the size of the file ("bytes").

    Raises:
        ValueError: The weights cannot be used; the message names the file.
        FileNotFoundError: There are no such weights.
        ImportError: A package is missing; the message names the extra.
        RuntimeError: The exported network's outputs differ from PyTorch's.
    """
    for package in ("onnx", "onnxruntime"):
        require(package)
    from m3depth.network.model import M3Depth

    with named_by("--weights"):
        model = M3Depth.from_pretrained(SHIPPED_WEIGHTS if options.weights is None else weights_file(options.weights))
    exported = to_onnx(model, options.opset)
    differences = parity(model, exported, ((1, 96, 160), (2, 131, 203)))
    if not max(differences["mean_px"], differences["mean_other"]) < PARITY:
        raise RuntimeError(
            f"onnxruntime disagrees with PyTorch by {differences['mean_px']:.3g} px in the mean, by "
            f"{differences['mean_other']:.3g} in normals, confidence or sky; try another --opset"
        )
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(options.out, exported)
    return {**differences, "bytes": len(exported)}


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user."""
    return run_command(_work, ExportOptions, "python -m m3depth.export", __doc__, args, "nothing was written")


def _work(options: ExportOptions) -> None:
    result = export(options)
    print(
        f"{options.out}: {result['bytes'] / 1e6:.1f} MB, opset {options.opset}; onnxruntime differs from PyTorch by "
        f"{result['mean_px']:.2g} px in the mean, {result['largest_px']:.2g} px at most, "
        f"by {result['largest_other']:.2g} at most in normals, confidence and sky"
    )


if __name__ == "__main__":
    sys.exit(main())
