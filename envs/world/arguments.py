"""Checks of MarsNavEnv's arguments; a message names the argument."""

from __future__ import annotations

from numbers import Integral, Real
from pathlib import Path

from marssim.scene.place_file import load_place
from marssim.scene.scene import SceneConfig

ERROR_LIMITS = {"disparity_noise": 10, "drift": 1, "yaw_drift_deg": 45}  # largest values of these arguments


def check_errors(**errors: float) -> None:
    """Raise ValueError that names the standard deviation of an error that is out of ERROR_LIMITS."""
    for name, value in errors.items():
        most = ERROR_LIMITS[name]
        if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= float(value) <= most:
            raise ValueError(f"{name} must lie in [0, {most}], got {value!r}")


def check_flags(**flags: bool) -> None:
    """Raise ValueError that names a flag that is neither True nor False."""
    for name, flag in flags.items():
        if not isinstance(flag, bool):
            raise ValueError(f"{name} must be True or False, got {flag!r}")


def check_count(name: str, value: int) -> None:
    """Raise ValueError that names a number of things that is no whole number of 1 or more."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} must be a whole number of 1 or more, got {value!r}")


def check_render_mode(mode: str | None, modes: list[str]) -> None:
    """Raise ValueError that names a way of rendering that is unknown; None renders nothing."""
    if mode is not None and mode not in modes:
        raise ValueError(f"render_mode {mode!r} is unknown; choose from {', '.join(modes)}")


def checked_scene(scene: str | Path | SceneConfig) -> SceneConfig:
    """Return the settings of a place: a preset's name, a JSON file of a place, or settings, which are returned.

    Raises:
        ValueError: If it is none of them.
    """
    if not isinstance(scene, str | Path | SceneConfig):
        raise ValueError(f"scene must be a preset's name, a JSON file of a place or a SceneConfig, got {scene!r}")
    return scene if isinstance(scene, SceneConfig) else load_place(scene)
