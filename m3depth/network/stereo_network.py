"""What every network that trains here has in common: its weights on disk, and a pair of images in, maps out."""

from __future__ import annotations

from pathlib import Path
from threading import Lock
from typing import Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from m3depth.network.device import autocast, fast_dtype
from m3depth.network.inference import infer_pair, padded_rig
from m3depth.network.output import GridMap
from m3depth.stereo.prediction import Prediction, StepMap
from m3depth.weights.storage import save_weights
from marssim.base.camera import StereoRig
from marssim.base.compute.waiting import warn_of_busy_threads

_STEPS = Lock()  # of every_step, which one thread sets at a time


class _Undrawn(TorchFunctionMode):
    """Leaves out the drawing of weights, for which PyTorch would import its compiler where tensors have shapes alone.

    That takes more than a second. Functions of torch.nn.init return their first argument, the tensor, as it is.
    """

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if getattr(function, "__module__", None) == "torch.nn.init":
            return kwargs["tensor"] if "tensor" in kwargs else args[0]
        return function(*args, **kwargs)


class StereoNetwork(nn.Module):
    """A network as training, evaluation and driving use it.

    A subclass sets `config` and defines forward(left, right, camera), which takes (B, 3, H, W) float images in [0, 1]
    and cameras (B, 4) fx, fy, cx, cy [px], and returns an output with disparity (B, 1, H, W) [px] and, where the
    network has them, normal (B, 3, H, W), confidence and sky (logits, (B, 1, H, W)); None stands for a map that the
    network does not have. How an output is trained is in m3depth/training/losses.py. A subclass that refines its maps
    step by step overrides takes_steps and steps_of.

    Attributes:
        config: The sizes of the network, a dataclass whose KIND is the name of the network in weights files.
        recompute: Activation checkpointing. In training, large parts keep only their inputs, and the backward pass
            computes them once more: the same gradients with less memory, about a third slower.
        every_step: Whether a method that returns the maps of all its refinement steps in training does so otherwise.
    """

    config: Any
    recompute = False
    every_step = False
    TAKES_START: ClassVar[bool] = False
    """Whether forward takes a Start too, where a smaller pair ended."""

    @property
    def reach(self) -> float:
        """Disparity at which the search for matches ends [px]; pairs with larger ones are reduced first."""
        raise NotImplementedError

    @property
    def size_multiple(self) -> int:
        """Images are padded to heights and widths that are multiples of this [px]."""
        raise NotImplementedError

    @property
    def takes_truth(self) -> bool:
        """Whether forward takes the true disparity too, (B, 1, H, W) [px]: such a network needs pairs with truth."""
        return False

    @property
    def goes_on(self) -> bool:
        """Whether the network refines the disparities of a reduced pair at the images' own size."""
        return False

    @property
    def takes_steps(self) -> bool:
        """Whether the network refines its disparity step by step, so that `infer_steps` can return each."""
        return False

    def steps_of(self, output: Any) -> list[GridMap]:
        """Return the disparities of an output in the order in which the network refined them, the result last.

        Args:
            output: What forward returned for one pair, with every_step.
        """
        raise NotImplementedError

    @classmethod
    def restored(cls, config: Any, tensors: dict[str, Tensor], source: Path) -> Self:
        """Return a trained network, in evaluation mode.

        Args:
            config: Its sizes.
            tensors: Its weights.
            source: The file that both are from, for the message.

        Raises:
            ValueError: The weights do not fit the sizes, or all are zero.
        """
        with torch.device("meta"), _Undrawn():  # shapes alone: a config with wrong, huge sizes then takes no memory
            expected = cls(config).state_dict()
        misfits = sorted(expected.keys() ^ tensors.keys())
        misfits = misfits or sorted(k for k in expected if expected[k].shape != tensors[k].shape)
        if misfits:
            raise ValueError(
                f"{source}: {len(misfits)} tensors do not fit the network that the file describes, the first is "
                f"{misfits[0]!r}; use the file as m3depth.train wrote it"
            )
        if not any(tensor.any() for tensor in tensors.values()):
            raise ValueError(f"{source}: all weights are zero, so these are not weights of a trained network")
        model = cls(config)
        model.load_state_dict(tensors)
        return model.eval()

    def save_pretrained(self, path: str | Path) -> None:
        """Write weights (.safetensors) and, beside them, their config (.json). Replaces existing files atomically.

        Raises:
            ValueError: path does not end in .safetensors.
        """
        save_weights(Path(path), self.config.to_dict(), self.state_dict())

    @torch.inference_mode()
    def infer(
        self, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None,
        max_pixels: int | None = None, align_rows: bool = False,
    ) -> Prediction:  # fmt: skip
        """Estimate the maps of one rectified pair, at the input's size.

        Where the disparity of `nearest`, or the width of the images if that is less, is beyond the reach of the
        network's search (192 px), the disparities are found in a reduced pair. A network that goes on from there
        refines them at the images' own size; for images hardly larger than the reduced ones (by less than the factor
        inference.LEAST_GAIN), and by other networks, the maps of the reduced pair are enlarged instead.

        Args:
            left, right: (H, W) or (H, W, 3) uint8, RGB.
            rig: The cameras of these images.
            nearest: The shortest distance that should be measured [m]; None is 0.84 m.
            max_pixels: Largest number of pixels of an image that the network works on; larger images are reduced to
                it, which saves time and memory. None: as many as the images have.
            align_rows: Whether the right image is first turned so that the rows of the two match, where they lie
                significantly apart, as m3depth.stereo.rows estimates from the pair. Disparities are then those of the
                turned image.

        Returns:
            Depth in metres of the given rig; inf where the network sees sky, and in what floats in it (see
            m3depth/stereo/sky.py). Where it sees sky and none can be, its disparity decides. Where that is of no finite
            depth, and where its numbers are not finite, all maps are NaN and confidence is 0.

        Raises:
            ValueError: Images of a wrong type or size, `nearest` is not positive, or `max_pixels` is below 2048.
        """
        warn_of_busy_threads()
        device = next(self.parameters()).device
        return infer_pair(
            self._forward, self.reach, self.goes_on, device, left, right, rig, nearest, max_pixels, align_rows
        )

    @torch.inference_mode()
    def infer_steps(
        self, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None,
        max_pixels: int | None = None,
    ) -> list[StepMap]:  # fmt: skip
        """Estimate the disparity of one pair after each refinement step, at each size at which the network works.

        Arguments and errors are those of infer without align_rows, in which only the last of these maps counts. The
        network must be one that takes steps.

        Returns:
            The maps in the order of the steps, at the input's size.
        """
        maps: list[StepMap] = []
        camera = padded_rig(rig).camera

        def run(*inputs: Any) -> Any:
            output = self._forward(*inputs)
            for grid_map in self.steps_of(output):
                whole = grid_map.at_size(inputs[0].shape[-2:], (camera.height, camera.width))
                height, width = rig.camera.height, rig.camera.width
                maps.append(whole._replace(disparity=whole.disparity[:height, :width]))
            return output

        with _STEPS:
            self.every_step = True
            try:
                device = next(self.parameters()).device
                infer_pair(run, self.reach, self.goes_on, device, left, right, rig, nearest, max_pixels)
            finally:
                self.every_step = False
        return maps

    def _forward(self, left: Tensor, right: Tensor, camera: Tensor, start: Any) -> Any:
        """Run the network in the fast precision of its device; see inference.Forward."""
        device = left.device
        with autocast(device, fast_dtype(device)):
            return self(left, right, camera, start) if self.TAKES_START else self(left, right, camera)
