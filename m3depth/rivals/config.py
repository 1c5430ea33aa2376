"""Every size of the rivals, and their presets: a width for two CPU cores, and the published one.

This file loads no torch, so that the commands print their help at once.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Self

from m3depth.weights.config_json import checked_fields


@dataclass(frozen=True)
class RivalConfig:
    """What the configs of all rivals share.

    Fields have defaults: whole numbers of 1 or more, other numbers, switches, texts, or tuples of one of these kinds. A
    tuple has the length of its default, unless it is annotated as one of any length (tuple[int, ...]).

    Raises:
        ValueError: A size that no network can have; the message names the field.
    """

    KIND: ClassVar[str]  # name of the method in weights files, and of its preset for a CPU

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            parts = value if isinstance(value, tuple) else (value,)
            if not parts or not all(isinstance(part, int | float | str) for part in parts):
                raise ValueError(f"{entry.name} must be a number, a text, a switch or a tuple of them, got {value!r}")
            if any(type(part) is int and part < 1 for part in parts):
                raise ValueError(f"{entry.name} must be at least 1, got {value}")

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form: the kind of the network, and its sizes."""
        return {"kind": self.KIND, **asdict(self)}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Read the JSON form without the kind. Fields that it lacks have their defaults.

        Raises:
            ValueError: A field is unknown or malformed; the message names it.
        """
        return cls(**checked_fields(cls, data))

    def _check_multiple(self, name: str, factor: int) -> None:
        if getattr(self, name) % factor:
            raise ValueError(f"{name} must be a multiple of {factor}, got {getattr(self, name)}")


@dataclass(frozen=True)
class RaftStereoConfig(RivalConfig):
    """Sizes of RAFT-Stereo. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "raft-stereo"

    widths: tuple[int, int, int] = (16, 24, 32)
    """Feature widths of the encoders at the image's size, at 1/2 and at 1/4."""
    features: int = 64
    """Feature channels that are correlated at 1/4."""
    hidden: int = 32
    """Channels of the state of each recurrent unit."""
    motion: int = 32
    """Channels inside the encoder of disparity and correlation."""
    head: int = 64
    """Channels inside the head that corrects the disparity."""
    lookup_levels: int = 4
    """Levels of the correlation pyramid."""
    lookup_radius: int = 4
    """Cells to either side of the current disparity that a step compares."""
    train_steps: int = 8
    """Number of recurrent steps in training."""
    steps: int = 8
    """Number of recurrent steps in evaluation and prediction."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hidden < 2:
            raise ValueError(f"hidden must be at least 2, of which one is the disparity, got {self.hidden}")


@dataclass(frozen=True)
class SelectiveStereoConfig(RaftStereoConfig):
    """Sizes of Selective-Stereo, those of the RAFT-Stereo that it stands on."""

    KIND: ClassVar[str] = "selective-stereo"


@dataclass(frozen=True)
class CreStereoConfig(RivalConfig):
    """Sizes of CREStereo. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "cre-stereo"

    widths: tuple[int, int, int] = (16, 24, 32)
    """Feature widths of the encoder's three stages, at 1/2, 1/4 and 1/4."""
    features: int = 64
    """Feature channels that are correlated, a multiple of 16; the recurrent unit's state has half as many."""
    heads: int = 4
    """Heads of the attention, which divide the feature channels."""
    train_steps: int = 6
    """Steps at 1/4 in training; at 1/16 and at 1/8 half as many, but 5 at least."""
    steps: int = 6
    """Steps at 1/4 after training; at 1/16 and at 1/8 half as many, but 5 at least."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_multiple("features", 16)
        self._check_multiple("features", self.heads)


@dataclass(frozen=True)
class HitNetConfig(RivalConfig):
    """Sizes of HITNet. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "hit-net"

    widths: tuple[int, int, int, int, int] = (8, 16, 16, 24, 32)
    """Feature widths at 1/1, 1/2, ... 1/16."""
    compared: int = 8
    """Feature channels of a tile that are compared."""
    propagation: int = 32
    """Channels inside the networks that correct the hypotheses of tiles."""
    refine: tuple[int, int, int] = (32, 24, 8)
    """Channels inside the networks that refine tiles of 4, 2 and 1 px."""


@dataclass(frozen=True)
class LightStereoConfig(RivalConfig):
    """Sizes of LightStereo. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "light-stereo"

    widths: tuple[int, int, int, int, int, int, int] = (16, 8, 16, 24, 32, 48, 80)
    """Channels of MobileNetV2's first convolution and of its six stages."""
    shifts: int = 48
    """Shifts of 4 px that are compared: 48 reach 192 px."""
    blocks: tuple[int, int, int] = (1, 2, 2)
    """Blocks of the aggregation at 1/4, 1/8 and 1/16."""
    expansion: int = 4
    """Factor of the channels inside a block of the aggregation."""
    guide: int = 24
    """Channels at 1/4 of the features from which the weights of the upsampling are computed."""
    half: int = 16
    """Channels at 1/2 of these features."""


@dataclass(frozen=True)
class UniMvsNetConfig(RivalConfig):
    """Sizes of UniMVSNet. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "uni-mvs-net"

    width: int = 8
    """Feature channels at the last stage, twice and four times as many at the two before it."""
    volume: int = 8
    """Channels of the 3-D aggregation at full size."""
    planes: tuple[int, int, int] = (48, 32, 8)
    """Planes of each stage, multiples of 8. The first ones reach 192 px; the steps halve from stage to stage."""
    finest: int = 2
    """Side of a cell of the last stage [px], 1 or 2; those of the stages before it are two and four times as wide."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(count % 8 for count in self.planes):
            raise ValueError(f"planes must be multiples of 8, got {self.planes}")
        if self.finest > 2:
            raise ValueError(f"finest must be 1 or 2, got {self.finest}")


@dataclass(frozen=True)
class NormalConfig(RivalConfig):
    """What the configs of the methods for normals share."""

    true_depth: bool = False
    """Whether the true depth is given, not that of M3Depth."""
    depth_weights: str = field(default="", kw_only=True)
    """Path of the weights of M3Depth that give the depth; empty: those of the package."""
    depth_sha256: str = field(default="", kw_only=True)
    """SHA-256 of that file, in hexadecimal digits."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.depth_weights) != bool(self.depth_sha256):
            raise ValueError("depth_weights and depth_sha256 belong together: give both or none")
        if not self.depth_weights.isprintable():  # errors name it, in one line
            raise ValueError(f"depth_weights must be printable, got {self.depth_weights!r}")
        if self.true_depth and self.depth_weights:
            raise ValueError(f"depth_weights must be empty where true_depth is given, got {self.depth_weights!r}")


@dataclass(frozen=True)
class FusionConfig(NormalConfig):
    """Sizes of Fusion. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "fusion"

    widths: tuple[int, int, int, int, int] = (16, 24, 32, 48, 48)
    """Channels at 1/1, 1/2, ... 1/16; the branch of the depth has the first four."""
    confidence: int = 8
    """Channels inside the network that weighs the features of the depth."""
    final: tuple[int, int, int] = (16, 8, 8)
    """Channels inside the last layers."""


@dataclass(frozen=True)
class GeoNetConfig(NormalConfig):
    """Sizes of GeoNet. The defaults are the width for two CPU cores."""

    KIND: ClassVar[str] = "geo-net"

    widths: tuple[int, int, int, int, int] = (8, 16, 32, 48, 48)
    """Channels of the five stages from which the first normals are computed, at 1/1, 1/2, 1/4 and twice 1/8."""
    wide: int = 96
    """Channels of the two layers between these stages and the first normals."""
    residual: tuple[int, int, int, int] = (8, 16, 24, 32)
    """Channels of the network that corrects the normals of the depth."""
    ensemble: int = 8
    """Channels of the networks that join two estimates."""
    neighbours: int = 5
    """Pixels along the side of a window, odd, 4 px apart, to which planes are fitted."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.neighbours % 2 == 0:
            raise ValueError(f"neighbours must be odd, got {self.neighbours}")


RAFT_PUBLISHED: dict[str, Any] = {
    "widths": (64, 96, 128), "features": 256, "hidden": 128, "motion": 64, "head": 256, "train_steps": 22, "steps": 32,
}  # fmt: skip

PRESETS: dict[str, RivalConfig] = {
    "raft-stereo": RaftStereoConfig(),
    "raft-stereo-published": RaftStereoConfig(**RAFT_PUBLISHED),
    "selective-stereo": SelectiveStereoConfig(),
    "selective-stereo-published": SelectiveStereoConfig(**RAFT_PUBLISHED),
    "hit-net": HitNetConfig(),
    "hit-net-published": HitNetConfig(widths=(16, 16, 24, 24, 32), compared=16, propagation=32, refine=(32, 32, 16)),
    "cre-stereo": CreStereoConfig(),
    "cre-stereo-published": CreStereoConfig(widths=(64, 96, 128), features=256, heads=8, train_steps=10, steps=20),
    "light-stereo": LightStereoConfig(),
    "light-stereo-published": LightStereoConfig(widths=(32, 16, 24, 32, 64, 96, 160), blocks=(1, 2, 4), expansion=4),
    "uni-mvs-net": UniMvsNetConfig(),
    "uni-mvs-net-published": UniMvsNetConfig(finest=1),
    "fusion": FusionConfig(),
    "fusion-true-depth": FusionConfig(true_depth=True),
    "fusion-published": FusionConfig(widths=(64, 128, 256, 256, 256), confidence=64, final=(32, 16, 8)),
    "geo-net": GeoNetConfig(),
    "geo-net-published": GeoNetConfig(
        widths=(64, 128, 256, 512, 512), wide=1024, residual=(64, 128, 256, 512), ensemble=128, neighbours=9
    ),
}
"""The presets of m3depth.train, by name. The published widths are those of a released model of each method, which its
file names.
"""

CONFIGS: dict[str, type[RivalConfig]] = {config.KIND: type(config) for config in PRESETS.values()}
"""The classes of the configs, by the kind of network that a weights file names."""

SOURCES: dict[str, Path] = {}
"""The files of the networks that a program has added, by their kind; see m3depth.kinds.networks.add_network."""
