"""Rivals of a few channels, and a training of one step for them."""

from dataclasses import replace
from pathlib import Path

from m3depth.rivals.config import (
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
from m3depth.training.config import TrainConfig

TINY: dict[str, RivalConfig] = {
    "raft-stereo": RaftStereoConfig((8, 8, 8), 8, 8, 8, 8, 2, 2, 2, 3),
    "selective-stereo": SelectiveStereoConfig((8, 8, 8), 8, 8, 8, 8, 2, 2, 2, 3),
    "hit-net": HitNetConfig((4, 4, 4, 4, 4), 4, 8, (4, 4, 4)),
    "cre-stereo": CreStereoConfig((8, 8, 8), 16, 2, 2, 2),
    "light-stereo": LightStereoConfig((8, 8, 8, 8, 8, 8, 8), 8, (1, 1, 1), 2, 8, 8),
    "uni-mvs-net": UniMvsNetConfig(4, 4, (16, 8, 8), 2),
    "fusion": FusionConfig(False, (4, 4, 4, 4, 4), 4, (4, 4, 4)),
    "geo-net": GeoNetConfig(False, (4, 4, 4, 4, 4), 8, (4, 4, 4, 4), 4, 3),
}


def train_config(out: Path, **changes) -> TrainConfig:
    base = TrainConfig(
        data=(Path("planes"),), out=out, batch=2, crop=(32, 64), max_steps=1, lr=1e-3, validate_samples=1, device="cpu"
    )
    return replace(base, **changes)
