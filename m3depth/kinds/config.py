"""The sizes of every kind of network: the presets by name, and their JSON form, which names the kind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from m3depth.network import config as m3depth_config
from m3depth.network.config import M3DepthConfig
from m3depth.rivals import config as rival_config
from m3depth.rivals.config import CONFIGS, RivalConfig
from m3depth.weights.config_json import kind_of
from marssim.base.command.input_file import check_file

NetworkConfig = M3DepthConfig | RivalConfig

PresetName = Literal[
    "lite", "paper", "paper-thin", "raft-stereo", "raft-stereo-published", "selective-stereo",
    "selective-stereo-published", "hit-net", "hit-net-published", "cre-stereo", "cre-stereo-published", "light-stereo",
    "light-stereo-published", "uni-mvs-net", "uni-mvs-net-published", "fusion",
    "fusion-true-depth", "fusion-published", "geo-net", "geo-net-published",
]  # fmt: skip
"""The presets of m3depth.train: those of network/config.py and of rivals/config.py."""


def preset_config(name: str) -> NetworkConfig:
    """Return the sizes of a preset.

    Raises:
        ValueError: There is no such preset.
    """
    presets: dict[str, NetworkConfig] = {**m3depth_config.PRESETS, **rival_config.PRESETS}
    if name not in presets:
        raise ValueError(f"preset {name!r} is not one of {', '.join(presets)}")
    return presets[name]


def config_from_dict(data: dict[str, Any]) -> NetworkConfig:
    """Read the JSON form of a network's sizes. Without "kind", they are those of M3Depth.

    Raises:
        ValueError: The kind or a field is unknown, or a field is malformed; the message names it.
    """
    kind = kind_of(data)
    if kind == M3DepthConfig.KIND:
        return M3DepthConfig.from_dict({k: v for k, v in data.items() if k != "kind"})
    if kind not in CONFIGS:  # m3depth.kinds.networks.add_network adds to it
        kinds = ", ".join((M3DepthConfig.KIND, *CONFIGS))
        raise ValueError(
            f"network config: kind {kind!r} is not one of {kinds}; for a network of your own, run the command in a "
            "program that imports its module, which calls add_network"
        )
    return CONFIGS[kind].from_dict({k: v for k, v in data.items() if k != "kind"})


def read_config(path: Path) -> NetworkConfig:
    """Read the config in a JSON file, as save_weights writes it beside weights.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file holds no config of a network. The message, one line, names the file.
    """
    check_file(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:  # no JSON, no text, or nested too deeply for the reader
        raise ValueError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(data, dict):
        raise ValueError(f"{path}: holds no JSON object")
    try:
        return config_from_dict(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
