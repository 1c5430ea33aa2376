"""Who drives: the navigator, simple baselines, trained policies and drivers of your own."""

from __future__ import annotations

from typing import Any

__all__ = ["Driver", "Stop"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from envs.drivers import driver

        return getattr(driver, name)
    raise AttributeError(f"module 'envs.drivers' has no attribute {name!r}")
