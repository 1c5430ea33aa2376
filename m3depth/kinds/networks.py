"""Networks of every kind: a new one of some sizes, or a trained one from its file."""

from __future__ import annotations

import inspect
import math
from contextlib import suppress
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from torch import nn

from m3depth.kinds.config import NetworkConfig, config_from_dict
from m3depth.network.config import M3DepthConfig
from m3depth.network.model import M3Depth
from m3depth.network.stereo_network import StereoNetwork
from m3depth.rivals.config import (
    CONFIGS,
    SOURCES,
    CreStereoConfig,
    FusionConfig,
    GeoNetConfig,
    HitNetConfig,
    LightStereoConfig,
    RaftStereoConfig,
    RivalConfig,
    SelectiveStereoConfig,
    UniMvsNetConfig,
)
from m3depth.rivals.cre_stereo import CreStereo
from m3depth.rivals.fusion import Fusion
from m3depth.rivals.geo_net import GeoNet
from m3depth.rivals.hit_net import HitNet
from m3depth.rivals.layers import summed_inputs
from m3depth.rivals.light_stereo import LightStereo
from m3depth.rivals.raft_stereo import RaftStereo
from m3depth.rivals.rival import StereoRival
from m3depth.rivals.selective_stereo import SelectiveStereo
from m3depth.rivals.uni_mvs_net import UniMvsNet
from m3depth.weights.storage import load_weights

CLASSES: dict[type, Any] = {
    M3DepthConfig: M3Depth,
    RaftStereoConfig: RaftStereo,
    SelectiveStereoConfig: SelectiveStereo,
    HitNetConfig: HitNet,
    CreStereoConfig: CreStereo,
    LightStereoConfig: LightStereo,
    UniMvsNetConfig: UniMvsNet,
    FusionConfig: Fusion,
    GeoNetConfig: GeoNet,
}
"""The network of each class of sizes."""

SHIPPED_KINDS = frozenset({M3DepthConfig.KIND, *CONFIGS})
"""The kinds of networks of this package. Another one may be added again."""

SIZES = {int, float, bool, str}  # types of the sizes of a network


def new_network(config: NetworkConfig) -> StereoNetwork:
    """Make a new network with random weights.

    Raises:
        ValueError: The class of a network of one's own does not keep its sizes.
    """
    network = CLASSES[type(config)](config)
    if getattr(network, "config", None) != config:
        raise ValueError(f"{type(network).__name__}: must keep its sizes as self.config")
    return network


def add_network(config: type[RivalConfig], network: type[StereoRival]) -> None:
    """Add a kind of network, so that m3depth.train and all commands of this process take it, and its weights.

    Args:
        config: The class of its sizes, a frozen dataclass. Its KIND names the network in weights files.
        network: The network. It is made with such sizes as its only argument.

    Raises:
        ValueError: A network of this package has this KIND, a class is none of these, or a size has no default or one
            that no file of weights can hold; the message names it.
    """
    is_config = isinstance(config, type) and issubclass(config, RivalConfig) and "__dataclass_params__" in vars(config)
    if not (is_config and isinstance(getattr(config, "KIND", None), str)):
        raise ValueError(f"config must be a dataclass, a subclass of RivalConfig with KIND as a text, got {config!r}")
    if not (isinstance(network, type) and issubclass(network, StereoRival)):
        raise ValueError(f"network must be a subclass of StereoRival, got {network!r}")
    kinds = get_type_hints(config)
    for size in fields(config):
        if not _is_size(size.default, kinds[size.name]):
            raise ValueError(
                f"{config.__qualname__}: {size.name} must be declared as int, float, bool, str or a tuple of one of "
                f"them, with a default of this type, got {'none' if size.default is MISSING else repr(size.default)}"
            )
    try:
        sizes = config()
        config.from_dict(asdict(sizes))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{config.__qualname__}: {error}") from None
    if config.KIND in SHIPPED_KINDS:
        raise ValueError(f"{config.__qualname__}: a network of this package has the kind {config.KIND!r}")
    CONFIGS[config.KIND], CLASSES[config] = config, network
    SOURCES.pop(config.KIND, None)
    with suppress(TypeError, OSError):  # a class of a notebook has no file
        source = Path(inspect.getfile(network))
        if source.is_file():
            SOURCES[config.KIND] = source


def _is_size(default: object, kind: object) -> bool:
    """Return whether a default is of the type that its field declares, one that a file of weights can hold."""
    if get_origin(kind) is not tuple:
        return kind in SIZES and type(default) is kind
    parts = set(get_args(kind)) - {Ellipsis}
    return isinstance(default, tuple) and bool(default) and parts == set(map(type, default)) and len(parts & SIZES) == 1


def draw_normal(network: nn.Module) -> None:
    """Draw the weights of all convolutions and linear layers from He et al.'s normal distribution, with biases of 0.

    The variance is 2 over the number of inputs that an output sums. First weights with a purpose are lost, such as the
    small or zero ones by which the last layer of a correction starts as none; scales of normalisations are 1. Other
    parameters stay.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Linear | nn.modules.conv._ConvNd):
            nn.init.normal_(layer.weight, std=math.sqrt(2 / summed_inputs(layer)))
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
        elif isinstance(layer, nn.GroupNorm):
            layer.reset_parameters()


def load_network(path: Path) -> StereoNetwork:
    """Load a trained network of any kind, in evaluation mode.

    Args:
        path: A .safetensors file that m3depth.train wrote.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file cannot be used. The message, one line, names it.
    """
    data, tensors = load_weights(path)
    try:
        config = config_from_dict(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return CLASSES[type(config)].restored(config, tensors, path)
