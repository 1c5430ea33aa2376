"""Every size and switch of the network, and its presets."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from m3depth.weights.config_json import checked_fields

# Fields that may be 0, which leaves out the part that they size.
OPTIONAL = frozenset(
    {
        "wavelet_levels", "match_channels", "output_head", "residual_width", "normal_context", "refine_steps",
        "lookup_radius", "lookup_levels", "fine_width",
    }
)  # fmt: skip
DEEPEST_WAVELET = 6  # most wavelet levels; images are padded to a multiple of 8 * 2 ** levels px
FARTHEST_STEP = 4  # largest factor between two sizes of a pair at which the refinement works
FULL_SIZE = 3  # doublings from the cost volume's grid to the image's


@dataclass(frozen=True)
class M3DepthConfig:
    """Every size of the network. The defaults are the `lite` preset.

    A size of 0 leaves out a part that OPTIONAL lists.

    Raises:
        ValueError: A size that no network can have; the message names the field.
    """

    KIND: ClassVar[str] = "m3depth"

    channels: tuple[int, int, int] = (16, 48, 96)
    """Feature widths at 1/2, 1/4 and 1/8 of the image's size."""
    feature_skips: bool = True
    """True: residual blocks of two convolutions at 1/4 and 1/8. False: one convolution, as in Table I."""
    wavelet_levels: tuple[int, int] = (2, 2)
    """Levels of the wavelet decomposition at 1/4 and 1/8; 0 is a plain convolution."""
    wavelet_kernel: int = 3
    """Side of the depth-wise kernels of the wavelet convolution, odd."""
    hypotheses: int = 24
    """D, the number of disparity hypotheses: 24 are 0, 8, ... 184 px."""
    match_channels: int = 64
    """Feature channels that are correlated at 1/8; 0 correlates the extractor's features as they are."""
    groups: int = 16
    """Channels of the cost volume (f in the paper)."""
    volume_width: int = 16
    """Channels of the widest 3-D convolution of the aggregation."""
    output_head: int = 0
    """Transposed convolutions that each double the volume's grid before soft argmin and SNNet."""
    score_kernel: int = 1
    """Side of the 3-D convolution from C_1 to P_1, odd; 1 is a weighted sum of the groups."""
    residual_width: int = 64
    """Channels of the residual context aggregation P_1 -> P_2; 0 uses P_1 as it is."""
    normal_widths: tuple[int, int, int] = (16, 16, 32)
    """Channels of SNNet's three 3-D convolutions."""
    normal_context: int = 13
    """Channels of left features that SNNet gets beside volume and coordinates; 0 gives none, as in the paper."""
    slice_layers: int = 3
    """Number of SNNet's 2-D convolutions for each slice."""
    slice_dilated: bool = True
    """Dilates all of them but the last, by 2, 4, ...; the paper mentions no dilation."""
    refine_steps: int = 4
    """T, the number of refinement steps; with 0, the maps of soft argmin and SNNet are upsampled as they are."""
    finer_steps: int = 4
    """Refinement steps at each larger size of the images, which begin where those of the smaller one ended."""
    hidden: int = 32
    """Channels of the ConvGRU's state."""
    motion: int = 32
    """Feature channels that a refinement step computes from its inputs."""
    implied_geometry: bool = True
    """A step also gets the normals and the relief that D_t implies. False: D_t and N_t alone."""
    heads_see_all: bool = False
    """The heads get D_t or N_t and H_0 beside the hidden state (paper, Sec. IV-D)."""
    lookup_channels: int = 32
    """Feature channels that are correlated at 1/4."""
    lookup_radius: int = 4
    """Cells to either side of the current disparity that a step compares; 0: that disparity alone."""
    lookup_levels: int = 2
    """Resolutions at which a step compares; with 0, it gets no correlation, as in the paper."""
    convex_upsampling: bool = True
    """True: maps are upsampled from 1/4 by learned weights. False: bilinearly."""
    fine_width: int = 32
    """Channels of the last correction, at 1/2; 0 leaves it out, as the paper does."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = _of_kind(field.name, getattr(self, field.name), field.default)
            object.__setattr__(self, field.name, value)
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
        if self.lookup_levels and not self.refine_steps:
            raise ValueError(
                f"lookup_levels must be 0 where refine_steps is 0, got {self.lookup_levels}: the steps alone look up"
            )

    @property
    def refines(self) -> bool:
        """Whether anything but bilinear interpolation brings the maps of soft argmin and SNNet to the image's size."""
        return bool(self.refine_steps or self.convex_upsampling or self.fine_width)

    @property
    def size_multiple(self) -> int:
        """Height and width inside the network are multiples of this [px]."""
        quarter, eighth = self.wavelet_levels
        return max(4 * 2**quarter, 8 * 2**eighth, 16)

    @property
    def coarse_width(self) -> int:
        """Channels at 1/8 that the refinement gets: the features and the aggregation's context."""
        return self.channels[2] + self.residual_width

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form, which names no kind: files from before there were other networks have none."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> M3DepthConfig:
        """Read the JSON form. Fields that it lacks are those of `lite`, without the parts that older networks lack.

        Networks from before the field convex_upsampling have no lookup, no fine part and no learned upsampling where
        refine_steps is 0.

        Raises:
            ValueError: A field is unknown or malformed; the message names it.
        """
        # weights of the first networks lack the field fine_width and the part
        values = {"fine_width": 0, **checked_fields(cls, data)}
        if values.get("refine_steps") == 0 and "convex_upsampling" not in data:
            values |= PLAIN_UPSAMPLING
        return cls(**values)


def _of_kind(name: str, value: Any, default: Any) -> Any:
    """Return the value of a field, a list as a tuple. Raises ValueError, which names it, for one unlike the default."""
    is_list = isinstance(default, tuple)
    parts = tuple(value) if is_list and isinstance(value, list | tuple) else (value,)
    parts = tuple(part.item() if isinstance(part, np.generic) else part for part in parts)
    wanted = default if is_list else (default,)
    if [type(part) for part in parts] != [type(part) for part in wanted]:
        number = f"{len(wanted)} whole numbers" if is_list else "a whole number"
        raise ValueError(f"{name} must be {'True or False' if isinstance(default, bool) else number}, got {value!r}")
    return parts if is_list else parts[0]


PLAIN_UPSAMPLING: dict[str, Any] = {"refine_steps": 0, "lookup_levels": 0, "convex_upsampling": False, "fine_width": 0}
"""The fields of a network without the IRM and all that `lite` has beside it: bilinear upsampling of the first maps."""

LITE = M3DepthConfig()
"""For a CPU: thin channels, volume and SNNet at 1/8, refinement at 1/4 with a correlation lookup, a correction at 1/2.
"""

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

Where the paper cannot be built as printed, or leaves a size open, this is done instead:

1. Table II ends in ReLU on the three components of the normals, which then could not be negative: the last layer is
   linear.
2. Batch normalisation is group normalisation: with the few images that fit on a device, batch statistics degrade
   the refinement (the error grows over its iterations). The extractor's text puts it after the activation, Table II
   before it: here it always stands before. Conv8 ends in the normalisation; the layers of the output head have neither.
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
9. There are two outputs more than the paper's, confidence and sky: a rover has to know where depth is missing.
10. Its loss, optimizer and rates are those of m3depth.train, as for `lite`, unless --recipe paper is given.
11. Normals of a result that face away from the camera are bent until they lie across the line of sight; in training
   they are not.
"""

PAPER_THIN = replace(
    PAPER,
    channels=LITE.channels,
    groups=LITE.groups,
    volume_width=LITE.volume_width,
    output_head=0,
    normal_widths=LITE.normal_widths,
    hidden=LITE.hidden,
    motion=LITE.motion,
)
"""The paper's parts alone at the widths of `lite`, which a CPU can train: no lookup and no correction at 1/2, three
wavelet levels, five iterations. Beside the widths, it leaves out the output head, with which SNNet works at full size:
soft argmin and SNNet stay at 1/8.
"""

PRESETS = {"lite": LITE, "paper": PAPER, "paper-thin": PAPER_THIN}
