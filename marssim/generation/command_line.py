"""Writes a GenerateConfig as a command line, so that a dataset can name the command that completes it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.generation.config import MIXED, GenerateConfig, RunConfig
from marssim.scene.presets import PRESETS, preset

NOT_OF_THE_DATA = ("out", "workers", "scheduler")  # fields that do not change the dataset
RIG_FILE = "rig_file"
HEIGHTMAP, DIGEST = "relief.heightmap", "relief.heightmap_sha256"  # the digest is filled in from the file


def command_flags(config: GenerateConfig, elsewhere: bool = False) -> str | None:
    """Return the flags of marssim.generate that give a config, without --out, --workers and --scheduler.

    Args:
        config: The config.
        elsewhere: Write the file names of the heightmap and of the rig instead of their paths, for use on other
            machines.

    Returns:
        None if no flags give the config, since its scenes are neither those of one preset nor of all presets with the
        same changes.
    """
    knobs = _knobs(config)
    if knobs is None:
        return None
    run = {name: value for name, value in _leaves(config, RunConfig) if name.split(".")[0] not in NOT_OF_THE_DATA}
    defaults = dict(_leaves(GenerateConfig(out=config.out, renderer="pybullet"), RunConfig))
    flags = {"pairs": config.pairs, "seed": config.seed, "scene": config.place}
    rig = _rig(config.rig)
    if config.raw:
        rig = {RIG_FILE: [file.name if elsewhere else str(file) for file in config.rig_file]}
    flags |= {name: value for name, value in run.items() if value != defaults[name]} | knobs | rig
    if elsewhere and HEIGHTMAP in flags:
        flags[HEIGHTMAP] = Path(str(flags[HEIGHTMAP])).name
    return shlex.join(word for name, value in flags.items() for word in _words(name, value))


def _knobs(config: GenerateConfig) -> dict[str, Any] | None:
    """Return the values that differ from those of the presets, or None if they are not the same in all scenes."""
    names = PRESETS if config.place == MIXED else (config.place,)
    if names != tuple(scene.preset for scene in config.scenes) or not set(names) <= set(PRESETS):
        return None
    scenes, presets = ([dict(_leaves(scene)) for scene in group] for group in (config.scenes, map(preset, names)))
    changed: dict[str, Any] = {}
    for name in scenes[0]:
        values = [scene[name] for scene in scenes]
        if name != DIGEST and values != [scene[name] for scene in presets]:
            if values != values[:1] * len(values):
                return None
            changed[name] = values[0]
    return changed


def _rig(rig: StereoRig) -> dict[str, Any]:
    """Return the values of the cameras that differ from the defaults of RigOptions."""
    camera, default = rig.camera, NATECAM.camera
    middle = PinholeCamera.centred(camera.width, camera.height, camera.fx)
    knobs = {
        "width": (camera.width, default.width),
        "height": (camera.height, default.height),
        "focal": (camera.fx, default.fx),
        "focal_y": (camera.fy, camera.fx),
        "cx": (camera.cx, middle.cx),
        "cy": (camera.cy, middle.cy),
        "baseline": (rig.baseline, NATECAM.baseline),
    }
    return {f"rig.{name}": value for name, (value, implied) in knobs.items() if value != implied}


def _leaves(config: Any, kind: type | None = None) -> Iterator[tuple[str, Any]]:
    """Yield the dotted names and the values of a config's fields, with those of its parts instead of the parts.

    Args:
        config: The config.
        kind: Takes the fields of this class alone, a parent of the config's.
    """
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
