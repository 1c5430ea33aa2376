"""A driver by its name, from the file of a trained policy, or from a class of your own."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from envs.drivers.builtin import NavigatorDriver, RandomDriver, StraightDriver
from envs.drivers.driver import Driver
from envs.drivers.policy_files import PolicyDriver

DRIVERS: dict[str, type[Driver]] = {
    "navigator": NavigatorDriver,
    "straight": StraightDriver,
    "random": RandomDriver,
}


def make_driver(name: str) -> Driver:
    """A driver by name, from a policy file (.zip, see policy_files.py) or by class path, package.module:Class.

    Raises ValueError or FileNotFoundError that says what was expected.
    """
    if name in DRIVERS:
        return DRIVERS[name]()
    if name.endswith(".zip"):
        return PolicyDriver(Path(name))
    if ":" in name:
        return load_driver_class(name)
    raise ValueError(f"driver {name!r} is unknown; choose from {', '.join(DRIVERS)}, FILE.zip, package.module:Class")


def load_driver_class(name: str) -> Any:
    """A driver from "package.module:Class", made without arguments. Raises ValueError that names what is wrong."""
    module, _, attribute = name.partition(":")
    try:
        made = getattr(importlib.import_module(module), attribute)()
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"driver {name!r} cannot be made: {error}") from None
    if not (callable(getattr(made, "act", None)) and callable(getattr(made, "reset", None))):
        raise ValueError(f"driver {name!r} has no methods reset and act")
    return made
