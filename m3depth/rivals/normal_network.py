"""What the methods for normals share: they see the left image and a depth map, and give the depth its normals.

The depth is that of M3Depth with the shipped weights, or those of `--depth-weights`, which stay as they are. A weights
file of such a method does not hold them, but names their file and its SHA-256. Confidence and sky are M3Depth's too. A
config with `true_depth` takes the true depth instead, in training and in evaluation: then the scores are those that the
method can reach with a perfect sensor of depth.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.device import autocast, fast_dtype
from m3depth.network.geometry import MIN_DISPARITY, facing_normals, pixel_rays, unit
from m3depth.network.inference import infer_pair, padded_rig
from m3depth.network.model import M3Depth
from m3depth.network.output import fitted, padded
from m3depth.rivals.config import NormalConfig
from m3depth.rivals.output import Truth, mean_over
from m3depth.rivals.rival import Rival
from m3depth.stereo.prediction import Prediction
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import StereoRig
from marssim.base.command.input_file import check_file


class TrainedNormals(NamedTuple):
    """Normals that are trained.

    Attributes:
        normal: (B, 3, h, w), of any length.
        cell: Side of a cell [px].
        share: Weight of their loss.
        error: Mean absolute difference of the components of unit vectors, or 1 - cosine.
    """

    normal: Tensor
    cell: int
    share: float
    error: Literal["absolute", "cosine"]


@dataclass(frozen=True)
class NormalOutput:
    """The maps of a method for normals.

    Attributes:
        disparity: (B, 1, H, W) [px].
        normal: (B, 3, H, W), unit length, facing the camera.
        trained: The normals that are trained.
        trained_disparity: Whether the disparity is trained.
        confidence, sky: (B, 1, H, W) logits; None without.
    """

    disparity: Tensor
    normal: Tensor
    trained: Sequence[TrainedNormals]
    trained_disparity: bool = False
    confidence: Tensor | None = None
    sky: Tensor | None = None

    def cropped(self, height: int, width: int) -> NormalOutput:
        """Cut the maps to an image of height x width [px]."""
        confidence, sky = (None if x is None else x[..., :height, :width] for x in (self.confidence, self.sky))
        disparity, normal = (x[..., :height, :width] for x in (self.disparity, self.normal))
        trained = [
            x._replace(normal=x.normal[..., : -(-height // x.cell), : -(-width // x.cell)]) for x in self.trained
        ]
        return NormalOutput(disparity, normal, trained, self.trained_disparity, confidence, sky)

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the weighted sum of the losses of the normals, and the mean relative error of a trained disparity."""
        losses = [maps.share * normal_error(maps, truth) for maps in self.trained]
        terms = {"normal": torch.stack(losses).sum()}
        if self.trained_disparity:
            ground = truth.valid & (truth.disparity >= MIN_DISPARITY)  # without the sky
            given, true = (x.clamp(min=MIN_DISPARITY).log() for x in (self.disparity, truth.disparity))
            terms["disparity"] = mean_over((given - true).abs(), ground)
        return terms


def normal_error(maps: TrainedNormals, truth: Truth) -> Tensor:
    """Return the mean error of normals over the cells whose true normal is known, and whose pixels are trained."""
    true = truth.normal * truth.valid
    if maps.cell > 1:
        missing = (0, -true.shape[-1] % maps.cell, 0, -true.shape[-2] % maps.cell)
        true = F.avg_pool2d(F.pad(true, missing), maps.cell)
    valid = true.square().sum(1, keepdim=True) > 0.25
    given, true = unit(maps.normal.float()), unit(true)
    if maps.error == "absolute":
        return mean_over((given - true).abs().mean(1, keepdim=True), valid)
    return mean_over(1 - (given * true).sum(1, keepdim=True), valid)


class NormalInput(NamedTuple):
    """What a method for normals works on, of padded images.

    Attributes:
        left: (B, 3, H, W) in [-1, 1].
        disparity: (B, 1, H, W) [px], at least MIN_DISPARITY.
        valid: (B, 1, H, W) bool, where that is a measured disparity.
        camera: (B, 4) [px].
    """

    left: Tensor
    disparity: Tensor
    valid: Tensor
    camera: Tensor

    @property
    def rays(self) -> Tensor:
        """(B, 3, H, W), the directions of the pixels, scaled to z = 1."""
        return pixel_rays(self.camera, *self.left.shape[-2:])

    @property
    def log_depth(self) -> Tensor:
        """(B, 1, H, W), logarithm of the depth in baselines. Its slopes do not depend on the distance of a surface.

        Pixels without a measured depth get the mean of the others. Otherwise a sky of 500 m would dominate the
        statistics of every normalisation.
        """
        depth = (self.camera[:, :1, None, None] / self.disparity).log()
        total = (depth * self.valid).sum((2, 3), keepdim=True)
        return torch.where(self.valid, depth, total / self.valid.sum((2, 3), keepdim=True).clamp(min=1))


def with_depth_weights(config: NormalConfig, path: Path) -> NormalConfig:
    """Return the sizes of a method whose depth is that of M3Depth with other weights than the shipped ones.

    Args:
        config: The sizes.
        path: The weights, a .safetensors file. The config holds the path as it is given, and the file's SHA-256.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file holds no weights of M3Depth, or the method gets the true depth.
    """
    M3Depth.from_pretrained(path)
    return replace(config, depth_weights=str(path), depth_sha256=hashlib.sha256(path.read_bytes()).hexdigest())


def depth_file(config: NormalConfig) -> Path:
    """Return the weights of M3Depth that give a method its depth.

    Raises:
        FileNotFoundError: The file that the config names is missing. One line that names it, as for the other error.
        ValueError: It is another file than in training.
    """
    if not config.depth_weights:
        return SHIPPED_WEIGHTS
    path = Path(config.depth_weights)
    check_file(path, "weights file", f"{config.KIND} got its depth from it in training")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest != config.depth_sha256:
        raise ValueError(
            f"{path}: is not the file from which {config.KIND} got its depth in training (SHA-256 {digest[:12]}..., "
            f"not {config.depth_sha256[:12]}...)"
        )
    return path


class NormalNetwork(Rival):
    """A method for normals. A subclass defines `normals`."""

    config: NormalConfig

    def __init__(self, config: NormalConfig) -> None:
        super().__init__()
        self.config = config
        self._frozen: list[M3Depth] = []  # in a list, it is no part of the weights

    @classmethod
    def restored(cls, config: NormalConfig, tensors: dict[str, Tensor], source: Path) -> Self:
        """Return a trained method, in evaluation mode; arguments as of StereoNetwork.restored.

        Raises:
            FileNotFoundError: The weights that give the depth are missing.
            ValueError: They are another file than in training, or the method's own weights do not fit its sizes.
        """
        network = super().restored(config, tensors, source)
        try:
            depth_file(config)
        except (FileNotFoundError, IsADirectoryError, ValueError) as error:
            raise type(error)(f"{source}: {error}") from None
        return network

    @property
    def takes_truth(self) -> bool:
        """Whether the method gets the true depth."""
        return self.config.true_depth

    def normals(self, inputs: NormalInput) -> NormalOutput:
        """Return the maps of a batch; defined by a subclass."""
        raise NotImplementedError

    def forward(
        self, left: Tensor, right: Tensor, camera: Tensor, true_disparity: Tensor | None = None
    ) -> NormalOutput:
        """Run the network on a batch.

        Args:
            left, right: (B, 3, H, W) float in [0, 1], rectified, of any size.
            camera: (B, 4) fx, fy, cx, cy [px].
            true_disparity: (B, 1, H, W) [px], 0 in the sky and where it is unknown; for a method with true depth alone.

        Raises:
            ValueError: The method needs the true depth, and there is none.
        """
        height, width = left.shape[-2:]
        camera = camera.float()
        confidence = sky = None
        if self.takes_truth:
            if true_disparity is None:
                raise ValueError(
                    f"{self.config.KIND} needs the true depth: score it by m3depth.evaluate, on pairs that have it"
                )
            disparity = true_disparity.float()
            valid = disparity >= MIN_DISPARITY
        else:
            with torch.no_grad():
                maps = self._m3depth(left.device)(left, right, camera)
            disparity, confidence, sky = maps.disparity.float(), maps.confidence, maps.sky
            valid = (disparity >= MIN_DISPARITY) & (sky <= 0)
        image, around, measured = (
            padded(x, self.MULTIPLE).contiguous()
            for x in (2 * left - 1, disparity.clamp(min=MIN_DISPARITY), valid.float())
        )
        output = self.normals(NormalInput(image, around, measured > 0, camera)).cropped(height, width)
        facing = facing_normals(output.normal.float(), pixel_rays(camera, height, width))
        disparity = output.disparity if output.trained_disparity else disparity
        return replace(output, disparity=disparity, normal=facing, confidence=confidence, sky=sky)

    @property
    def reach(self) -> float:
        """The largest disparity that is trained [px], or that the network which gives the depth finds, if less."""
        return super().reach if self.takes_truth else min(super().reach, self._loaded().reach)

    def _m3depth(self, device: torch.device) -> M3Depth:
        """Return the network that gives the depth, on a device."""
        return self._loaded().to(device)

    def _loaded(self) -> M3Depth:
        """Return the network that gives the depth, loaded once."""
        if not self._frozen:
            self._frozen.append(M3Depth.from_pretrained(depth_file(self.config)).requires_grad_(False))
        return self._frozen[0]

    def with_truth(self, disparity: np.ndarray) -> NormalNetwork | TrueDepthEstimator:
        """Return the method for a pair of a known disparity, (H, W) [px]; itself if it takes none."""
        return TrueDepthEstimator(self, disparity) if self.takes_truth else self


class TrueDepthEstimator:
    """A method that gets the true depth, as an estimator of the one pair that it belongs to.

    Args:
        network: The method.
        disparity: (H, W) true disparity [px]; what is not finite is unknown.
    """

    def __init__(self, network: NormalNetwork, disparity: np.ndarray) -> None:
        self.network, self.known = network, np.isfinite(disparity)
        self.disparity = torch.from_numpy(np.where(np.isfinite(disparity), disparity, 0).astype(np.float32))

    @torch.inference_mode()
    def infer(
        self,
        left: np.ndarray,
        right: np.ndarray,
        rig: StereoRig,
        nearest: float | None = None,
        max_pixels: int | None = None,
    ) -> Prediction:
        """Return the true depth with the method's normals; arguments as of StereoNetwork.infer."""
        device = next(self.network.parameters()).device
        size = padded_rig(rig).camera

        def run(left: Tensor, right: Tensor, camera: Tensor, start: Any) -> NormalOutput:
            truth = fitted(self.disparity[None, None].to(device), size.height, size.width)
            scale = left.shape[-1] / truth.shape[-1]
            truth = F.interpolate(truth, left.shape[-2:], mode="nearest-exact") * scale
            with autocast(device, fast_dtype(device)):
                return self.network(left, right, camera, truth)

        prediction = infer_pair(run, self.network.reach, False, device, left, right, rig, nearest, max_pixels)
        true = np.where(self.known, self.disparity.numpy(), np.float32(np.nan))
        return replace(prediction, depth=np.where(self.known, rig.disparity_to_depth(true), true), disparity=true)
