"""Measures how far the pixels lie that a feature, or the disparity, of M3Depth depends on: with and without WEFE.

    python docs/receptive_field.py --data data/gale --out out/field --weights runs/lite/weights.safetensors \\
        runs/lite-no-wefe/weights.safetensors

The effective receptive field (Luo, Li, Urtasun and Zemel: "Understanding the Effective Receptive Field in Deep
Convolutional Neural Networks", NIPS 2016) is the gradient of the output at the middle with respect to the input: here
its absolute value with respect to the normalised left image, summed over the colours and averaged over pairs. The
outputs are the features at 1/4 and at 1/8, summed over their channels, and the disparity. The statistics of image and
group normalisation are constants: they depend on every pixel a little, and would hide what the convolutions see. The
mean of the features over both images, which is subtracted before they are compared, still hands gradient on, so that
every pixel has a little of the disparity's.

--out gets receptive_field.png and receptive_field.json, which has for each output the radii of the circles that hold
half and 90 % of the gradient, and the side of a square with as many pixels as have more than 4.55 % of the largest
gradient, the size that Luo et al. give.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from torch import Tensor, nn

from m3depth.datasets.config import DataConfig, Split
from m3depth.datasets.open import open_pairs
from m3depth.estimator import EstimatorName, distinct_labels
from m3depth.figures.drawing import METHOD_COLOURS, save, show
from m3depth.network.backbone import Features
from m3depth.network.model import M3Depth
from m3depth.stereo.pairs import in_colour, spread
from m3depth.weights import weights_file
from marssim.base.camera import StereoRig
from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.files.json_file import write_json

LARGE = 0.0455  # of the largest gradient: two standard deviations of a Gaussian from its middle
LEAST = 1e-4  # of the largest gradient: the dark end of the colours
MULTIPLE = 64  # of the crops' side [px], which the presets of M3Depth take without padding
OUTPUTS = ("features at 1/4", "features at 1/8", "disparity")


@dataclass(frozen=True)
class Options:
    """Measures the effective receptive field of features and disparity of M3Depth."""

    data: Path
    """Dataset whose pairs are averaged over."""
    out: Path
    """Folder for receptive_field.json and receptive_field.png."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """Settings of the dataset reader."""
    weights: tuple[Path, ...] = (Path("shipped"),)
    """Weights of M3Depth, each a .safetensors file, or the word shipped for those of the package."""
    split: Split = "test"
    """Split of the dataset."""
    limit: int = 20
    """Largest number of pairs, 1 or more, spread evenly over the split."""
    size: int = 256
    """Side of the square that is cut out of the middle of the images [px], a multiple of 64."""

    def __post_init__(self) -> None:
        check_least(self, limit=1, size=MULTIPLE)
        if self.size % MULTIPLE:
            raise ValueError(f"size must be a multiple of {MULTIPLE}, got {self.size}")
        if not self.weights:
            raise ValueError("weights must name at least one file")


def normalised_by_constants(norm: nn.GroupNorm, x: Tensor) -> Tensor:
    """Return what a group normalisation returns for x (B, C, ...), with statistics that hand on no gradient."""
    groups = x.unflatten(1, (norm.num_groups, -1))
    within = tuple(range(2, groups.ndim))
    variance, mean = torch.var_mean(groups.detach(), within, correction=0, keepdim=True)
    shape = (1, -1, *[1] * (x.ndim - 2))
    plain = ((groups - mean) * (variance + norm.eps).rsqrt()).flatten(1, 2)
    return plain * norm.weight.view(shape) + norm.bias.view(shape)


@contextmanager
def constant_statistics(network: nn.Module) -> Iterator[None]:
    """Let all group normalisations of a network use normalised_by_constants, for as long as the block runs."""
    norms = [layer for layer in network.modules() if isinstance(layer, nn.GroupNorm)]
    for norm in norms:
        norm.forward = partial(normalised_by_constants, norm)  # type: ignore[method-assign]
    try:
        yield
    finally:
        for norm in norms:
            del norm.forward


def gradients(network: M3Depth, left: Tensor, right: Tensor, camera: Tensor) -> dict[str, np.ndarray]:
    """Return the gradient of each of OUTPUTS at the middle of the image, (H, W), by its name.

    Args:
        network: In evaluation mode.
        left, right: (1, 3, H, W) float in [0, 1], H and W multiples of MULTIPLE.
        camera: (1, 4) fx, fy, cx, cy [px].
    """
    inputs: list[Tensor] = []
    features: list[Features] = []

    def start(_: nn.Module, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        inputs.append(arguments[0].detach().requires_grad_())
        return (inputs[0], *arguments[1:])

    hooks = [
        network.backbone.register_forward_pre_hook(start),
        network.backbone.register_forward_hook(lambda _, __, result: features.append(result)),
    ]
    try:
        with constant_statistics(network):
            output = network(left, right, camera)
    finally:
        for hook in hooks:
            hook.remove()
    row, column = (side // 2 for side in left.shape[-2:])
    targets = (
        features[0].quarter[0, :, row // 4, column // 4].sum(),
        features[0].eighth[0, :, row // 8, column // 8].sum(),
        output.disparity[0, 0, row, column],
    )
    maps = {}
    for name, target in zip(OUTPUTS, targets, strict=True):
        (gradient,) = torch.autograd.grad(target, inputs, retain_graph=True)
        maps[name] = gradient[0].abs().sum(0).numpy()  # of the left image
    return maps


def cropped(image: np.ndarray, size: int) -> Tensor:
    """Return the middle of an image, (H, W) or (H, W, 3) uint8, as (1, 3, size, size) float in [0, 1].

    Raises:
        ValueError: The image is smaller.
    """
    height, width = image.shape[:2]
    if min(height, width) < size:
        raise ValueError(f"--size {size}: the images have {width} x {height} px")
    top, left = (height - size) // 2, (width - size) // 2
    part = np.ascontiguousarray(in_colour(image)[top : top + size, left : left + size])
    return torch.from_numpy(part).permute(2, 0, 1)[None].float() / 255


def camera_of(rig: StereoRig, size: int) -> Tensor:
    """Return fx, fy, cx, cy [px] of the middle of a rig's images, (1, 4)."""
    c = rig.camera
    top, left = (c.height - size) // 2, (c.width - size) // 2
    return torch.tensor([[c.fx, c.fy, c.cx - left, c.cy - top]], dtype=torch.float32)


def radii(gradient: np.ndarray, shares: Sequence[float]) -> list[float]:
    """Return the radii [px] of the circles around the middle of gravity that hold shares of a gradient, (H, W)."""
    weight = gradient / gradient.sum()
    rows, columns = np.indices(gradient.shape)
    distance = np.hypot(rows - (weight * rows).sum(), columns - (weight * columns).sum())
    order = np.argsort(distance, axis=None)
    held = np.cumsum(weight.ravel()[order])
    return [float(distance.ravel()[order][min(np.searchsorted(held, share), held.size - 1)]) for share in shares]


def sizes(gradient: np.ndarray) -> dict[str, float]:
    """Return the radii that hold half and 90 % of a gradient, (H, W), and the side of its large part [px]."""
    half, most = radii(gradient, (0.5, 0.9))
    return {
        "radius_50_px": half,
        "radius_90_px": most,
        "side_px": float(np.sqrt((gradient > LARGE * gradient.max()).sum())),
    }


def field_figure(maps: Mapping[str, Mapping[str, np.ndarray]], path: Path) -> None:
    """Write a PNG with a row a network: its gradients, each with the circle that holds half, and their growth.

    Args:
        maps: (H, W) gradient by network and output.
        path: The file to write.
    """
    figure = Figure(figsize=(16, 4.2 * len(maps)), layout="constrained", dpi=100)
    axes = figure.subplots(len(maps), 4, squeeze=False)
    for row, (label, by_output) in zip(axes, maps.items(), strict=True):
        for ax, (name, gradient), colour in zip(row, by_output.items(), METHOD_COLOURS):
            values = sizes(gradient)
            largest = gradient.max()
            drawn = show(ax, np.maximum(gradient / largest, LEAST / 10), norm=LogNorm(LEAST, 1), cmap="magma")
            weight = gradient / gradient.sum()
            middle = [float((weight * index).sum()) for index in np.indices(gradient.shape)]
            ax.add_patch(Circle((middle[1], middle[0]), values["radius_50_px"], fill=False, color="white", lw=1.2))
            ax.set_title(
                f"{label}: {name}\nhalf within {values['radius_50_px']:.0f} px, 90 % within "
                f"{values['radius_90_px']:.0f} px, side {values['side_px']:.0f} px", fontsize=10,
            )  # fmt: skip
            shares = np.linspace(0.01, 0.99, 99)
            row[3].plot(radii(gradient, shares), 100 * shares, color=colour, label=name)
        bar = figure.colorbar(drawn, ax=row[2], fraction=0.046, pad=0.02, extend="min")
        bar.set_label("gradient, largest: 1", fontsize=9)
        row[3].set_title(label, fontsize=10)
        row[3].set_xlim(0, max(gradient.shape) / 2)
        row[3].set_xlabel("radius [px]")
        row[3].set_ylabel("gradient within [%]")
        row[3].grid(True, color="0.92")
        row[3].legend(frameon=False)
    save(figure, path)


def measure(options: Options) -> dict[str, dict[str, np.ndarray]]:
    """Return the mean gradients, (size, size), by the label of the weights and by output.

    Raises:
        ValueError: The weights are not of M3Depth or have no gradient, or the images are too small.
    """
    pairs = open_pairs(options.data, options.split, options.reader)
    chosen = spread(len(pairs), options.limit)
    if not chosen:
        raise ValueError(f"--data {options.data}: split {options.split} holds no pairs")
    files = [weights_file(path) for path in options.weights]
    networks = [M3Depth.from_pretrained(path) for path in files]
    sums = [dict.fromkeys(OUTPUTS, np.zeros((options.size, options.size))) for _ in networks]
    for index in chosen:
        sample = pairs[index]
        left, right = (cropped(image, options.size) for image in (sample.left, sample.right))
        for network, total in zip(networks, sums, strict=True):
            for name, gradient in gradients(network, left, right, camera_of(sample.rig, options.size)).items():
                total[name] = total[name] + gradient / len(chosen)
    labels = distinct_labels([EstimatorName(f"m3depth:{path}") for path in files])
    for label, total in zip(labels, sums, strict=True):
        for name, gradient in total.items():
            if not gradient.any():
                raise ValueError(f"{label}: {name} in the middle of the images depends on none of their pixels")
    return dict(zip(labels, sums, strict=True))


def work(options: Options) -> None:
    """Measure, and write the numbers and the picture."""
    maps = measure(options)
    options.out.mkdir(parents=True, exist_ok=True)
    content = {label: {name: sizes(x) for name, x in by_output.items()} for label, by_output in maps.items()}
    settings = {"data": str(options.data), "split": options.split, "limit": options.limit, "size_px": options.size}
    write_json(options.out / "receptive_field.json", {**settings, "networks": content}, sort_keys=False)
    field_figure(maps, options.out / "receptive_field.png")
    for label, by_output in content.items():
        radius = ", ".join(f"{name} {values['radius_50_px']:.1f} px" for name, values in by_output.items())
        print(f"{label}: half of the gradient within {radius}")
    print(f"{counted(len(maps), 'network')}; the picture is {options.out / 'receptive_field.png'}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/receptive_field.py", __doc__, args, STARTS_OVER)


if __name__ == "__main__":
    sys.exit(main())
