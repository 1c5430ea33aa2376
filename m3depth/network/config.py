"""Every size and switch of the network, and its two presets."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from marssim.base.command.input_file import check_file

OPTIONAL = frozenset(
    {
        "wavelet_levels", "match_channels", "output_head", "residual_width", "normal_context", "refine_steps",
        "lookup_radius", "lookup_levels", "fine_width",
    }
)  # fmt: skip
DEEPEST_WAVELET = 6  # images are padded to a multiple of 8 * 2 ** levels px
FULL_SIZE = 3  # doublings from the cost volume's grid to the image's


@dataclass(frozen=True)
class M3DepthConfig:
    """Every size of the network; the defaults are the `lite` preset. A part that OPTIONAL names is left out by a 0.

    Raises ValueError that names the field of a size that no network can have.
    """

    channels: tuple[int, int, int] = (16, 48, 96)  # feature widths at 1/2, 1/4, 1/8
    feature_skips: bool = True  # residual blocks of two convolutions at 1/4 and 1/8; False: one convolution, as Table I
    wavelet_levels: tuple[int, int] = (2, 2)  # levels of the decomposition at 1/4 and 1/8; 0: plain convolution
    wavelet_kernel: int = 3
    hypotheses: int = 24  # D: disparities 0, 8, ... 184 px
    match_channels: int = 64  # features that are correlated, at 1/8; 0: those of the extractor as they are
    groups: int = 16  # f: channels of the cost volume
    volume_width: int = 16  # widest 3-D convolution of the aggregation
    output_head: int = 0  # transposed convolutions that double the volume's grid before soft argmin and SNNet
    score_kernel: int = 1  # of the 3-D convolution from C_1 to P_1; 1: a weighted sum of the groups
    residual_width: int = 64  # residual context aggregation P1 -> P2; 0: P1 is used as it is
    normal_widths: tuple[int, int, int] = (16, 16, 32)  # SNNet's three 3-D convolutions
    normal_context: int = 13  # left features given to SNNet beside volume and coordinates; 0: as in the paper
    slice_layers: int = 3  # SNNet's 2-D convolutions for each slice
    slice_dilated: bool = True  # all of them but the last dilated, by 2, 4, ...; the paper speaks of no dilation
    refine_steps: int = 4  # T; 0: soft argmin and SNNet, upsampled
    hidden: int = 32  # of the ConvGRU
    motion: int = 32  # features of what a step sees
    implied_geometry: bool = True  # a step sees the normals that D_t implies, and its relief; False: D_t and N_t alone
    heads_see_all: bool = False  # the heads get D_t or N_t and H_0 beside the hidden state (paper, Sec. IV-D)
    lookup_channels: int = 32  # features that are correlated, at 1/4
    lookup_radius: int = 4  # cells to either side; 0: the current disparity alone
    lookup_levels: int = 2  # 0: a step sees no correlation
    fine_width: int = 32  # of the last correction, at 1/2; 0: none, as in the paper

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            least = 0 if field.name in OPTIONAL or isinstance(value, bool) else 1
            if min(value if isinstance(value, tuple) else (value,)) < least:
                raise ValueError(f"{field.name} must be at least {least}, got {value}")
        if max(self.wavelet_levels) > DEEPEST_WAVELET:
            raise ValueError(f"wavelet_levels must be at most {DEEPEST_WAVELET}, got {self.wavelet_levels}")
        if self.output_head > FULL_SIZE:
            raise ValueError(f"output_head must be at most {FULL_SIZE}, the image's size, got {self.output_head}")
        for name in ("wavelet_kernel", "score_kernel"):
            if getattr(self, name) % 2 == 0:
                raise ValueError(f"{name} must be odd, got {getattr(self, name)}")
        if self.motion < 2:
            raise ValueError(f"motion must be at least 2, got {self.motion}")
        matched = self.match_channels or self.channels[2]
        if matched % self.groups:
            name = "match_channels" if self.match_channels else "channels"
            raise ValueError(f"{name} {matched} is not a multiple of groups {self.groups}")
        if self.hypotheses < 8 or self.hypotheses % 8:
            raise ValueError(f"hypotheses must be a multiple of 8, got {self.hypotheses}")

    @property
    def size_multiple(self) -> int:
        """Height and width inside the network are multiples of this [px]."""
        quarter, eighth = self.wavelet_levels
        return max(4 * 2**quarter, 8 * 2**eighth, 16)

    @property
    def coarse_width(self) -> int:
        """Channels at 1/8 that the refinement gets: the features, and what the aggregation saw as context."""
        return self.channels[2] + self.residual_width

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> M3DepthConfig:
        """Read the JSON form; fields left out are those of `lite`, without its fine part.

        Raises ValueError that names an unknown or malformed field.
        """
        known: dict[str, Any] = {f.name: f.default for f in fields(cls)}
        values: dict[str, Any] = {"fine_width": 0}  # weights that were written before it existed have none
        for name, value in data.items():
            if name not in known:
                raise ValueError(f"network config: unknown field {name!r}")
            kind = bool if isinstance(known[name], bool) else int
            size = len(known[name]) if isinstance(known[name], tuple) else None
            numbers = value if size and isinstance(value, list | tuple) else [value]
            if len(numbers) != (size or 1) or not all(type(n) is kind and 0 <= n <= 4096 for n in numbers):
                raise ValueError(f"network config: field {name!r} has the value {value!r}")
            values[name] = tuple(numbers) if size else value
        return cls(**values)


def read_config(path: Path) -> M3DepthConfig:
    """The config in a JSON file, as is written beside weights; see from_dict for fields that are left out.

    Raises FileNotFoundError or ValueError, one line that names the file.
    """
    check_file(path)
    try:
        data = json.loads(path.read_text())
    except (ValueError, RecursionError) as error:  # no JSON, no text at all, or nested to break its reader
        raise ValueError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(data, dict):
        raise ValueError(f"{path}: holds no JSON object")
    try:
        return M3DepthConfig.from_dict(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


LITE = M3DepthConfig()
"""For a CPU: thin channels, volume and SNNet at 1/8, refinement at 1/4 with a correlation lookup, one
correction at 1/2."""

PAPER = M3DepthConfig(
    channels=(64, 128, 256),
    feature_skips=False,
    wavelet_levels=(3, 3),
    hypotheses=24,
    match_channels=0,
    groups=64,
    volume_width=128,
    output_head=3,
    score_kernel=3,
    residual_width=64,
    normal_widths=(67, 67, 67),
    normal_context=0,
    slice_layers=2,
    slice_dilated=False,
    refine_steps=5,
    hidden=128,
    motion=64,
    implied_geometry=False,
    heads_see_all=True,
    lookup_levels=0,
    fine_width=0,
)
"""The paper's Tables I and II, with D = 24, three wavelet levels and five iterations.

Where the paper cannot be built as printed, or says nothing, and what is done instead:

1. Table II ends in ReLU on the three components of the normals, which then could not be negative: the last layer is
   linear.
2. Batch normalisation is group normalisation: with the few images that fit on a device, batch statistics spoil the
   refinement (the error grows over its iterations). The extractor's text names it after the activation, Table II
   before: it stands before, everywhere. Conv8 ends in it, the layers of the output head have neither.
3. D is not given: 24 hypotheses of 8 px, 0 to 184 px. The head makes them denser in the image plane, not in disparity.
4. Conv4 and Conv6 are the two convolutions that wavelets "substitute". Depth-wise kernels mix no channels, so each ends
   in a 1 x 1 convolution; k is not given: 3. beta starts at 1, one a channel and level.
5. "Unfold & Compare" is the correlation of 64 groups of 4 channels, centred and of unit length, shifted by whole cells.
6. C_1 = C_0 + Conv8(Conv7(C_0)), as in DPSNet, so that training starts from the plain correlation. The residual that
   turns P_1 into P_2 is computed for all hypotheses at once, not slice by slice, with growing dilations as in DPSNet's
   context network. P_1 and P_2 are logits, and the one softmax is that before the soft argmin: the text normalises P_1
   too, but a second softmax, of numbers between 0 and 1, is all but flat, and its mean the middle of the range.
7. The text gives SNNet the volume C_0, the table one of 64 x D x 512 x 512: it gets what the output head returns, the
   only volume of that size. Its three extra channels are the camera-frame X, Y, Z of each pixel at each hypothesis, as
   in Normal-Assisted Stereo. Kernels are not given: 3 x 3 x 3 with stride 2 in depth, and 3 x 3 without dilation.
8. The refinement's grid and widths are not given: 1/4 with 128 hidden channels and learned convex upsampling, as in
   RAFT-Stereo and Metric3D, which the paper follows. H_0 and the gates' context come from the left features. What is
   refined is disparity, 0 or more; depth follows from it. The heads get the updated hidden state H_t+1, as the text has
   it; the equation has H_t. N_t is brought to unit length after each update, and D_t and N_t are passed on without
   their gradient, as in RAFT: the text does not say, and each step then learns to correct what it is given.
9. Two more outputs than the paper's, confidence and sky: what drives by depth has to know where there is none.
10. The loss, the optimizer and their rates are m3depth.train's, for both presets alike.
"""

PRESETS = {"lite": LITE, "paper": PAPER}
