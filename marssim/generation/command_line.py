"""A config as the command line that asks for it, so that a dataset can say how it is completed."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.generation.config import MIXED, GenerateConfig, RunConfig
from marssim.scene.scene import PRESETS, preset

ELSEWHERE = ("out", "workers", "scheduler")  # who renders and where to: not of the dataset
FROM_FILE, FILLED_IN = "relief.heightmap", "relief.heightmap_sha256"  # its digest


def command_flags(config: GenerateConfig, elsewhere: bool = False) -> str | None:
    """Flags of marssim.generate that give this config, but for --out, --workers and --scheduler.

    elsewhere: for other machines, where a heightmap is known by its name and lies in another folder. None for a config
    that no flags give: of scenes that are neither one place's nor all places', changed alike.
    """
    knobs = _knobs(config)
    if knobs is None:
        return None
    default = GenerateConfig(out=config.out)
    run = {name: value for name, value in _leaves(config, RunConfig) if name.split(".")[0] not in ELSEWHERE}
    before = dict(_leaves(default, RunConfig))
    asked = {"pairs": config.pairs, "seed": config.seed, "scene": config.place}
    asked |= {name: value for name, value in run.items() if value != before[name]} | knobs | _rig(config.rig)
    if elsewhere and FROM_FILE in asked:
        asked[FROM_FILE] = Path(str(asked[FROM_FILE])).name
    return shlex.join(word for name, value in asked.items() for word in _words(name, value))


def _knobs(config: GenerateConfig) -> dict[str, Any] | None:
    """What of the scenes differs from their presets; None if that is not the same in all."""
    names = PRESETS if config.place == MIXED else (config.place,)
    if names != tuple(scene.preset for scene in config.scenes) or not set(names) <= set(PRESETS):
        return None
    now, before = ([dict(_leaves(scene)) for scene in scenes] for scenes in (config.scenes, map(preset, names)))
    changed: dict[str, Any] = {}
    for name in now[0]:
        values = [scene[name] for scene in now]
        if name != FILLED_IN and values != [scene[name] for scene in before]:
            if values != values[:1] * len(values):
                return None
            changed[name] = values[0]
    return changed


def _rig(rig: StereoRig) -> dict[str, Any]:
    """What of the cameras differs from what RigOptions has without being asked."""
    camera, usual = rig.camera, NATECAM.camera
    middle = PinholeCamera.centred(camera.width, camera.height, camera.fx)
    knobs = {
        "width": (camera.width, usual.width), "height": (camera.height, usual.height), "focal": (camera.fx, usual.fx),
        "focal_y": (camera.fy, camera.fx), "cx": (camera.cx, middle.cx), "cy": (camera.cy, middle.cy),
        "baseline": (rig.baseline, NATECAM.baseline),
    }  # fmt: skip
    return {f"rig.{name}": value for name, (value, without) in knobs.items() if value != without}


def _leaves(config: Any, kind: type | None = None) -> Iterator[tuple[str, Any]]:
    """Dotted names and values of a config's fields, those of its parts instead of the parts. kind: of that class."""
    for field in fields(kind or config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            yield from ((f"{field.name}.{name}", part) for name, part in _leaves(value))
        else:
            yield field.name, value


def _words(name: str, value: Any) -> list[str]:
    flag = name.replace("_", "-")
    if isinstance(value, bool):
        return [f"--{flag}"] if value else [f"--no-{flag}"]
    return [f"--{flag}", *map(str, value if isinstance(value, tuple | list) else [value])]
