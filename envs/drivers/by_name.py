"""Drivers by name, from the file of a trained policy, or from a class path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from envs.drivers.builtin import NavigatorDriver, RandomDriver, StraightDriver
from envs.drivers.driver import Driver
from envs.drivers.oracle import OracleDriver
from envs.drivers.policy_files import PolicyDriver
from m3depth.user_module import import_user_module
from marssim.base.command.spelling import did_you_mean

FIELD = "`driver`"  # begins each message; a command replaces a name in ` ` by its flag
# the drivers that come with the package
DRIVERS: dict[str, type[Driver]] = {
    "navigator": NavigatorDriver,
    "oracle": OracleDriver,
    "straight": StraightDriver,
    "random": RandomDriver,
}


def make_driver(name: str) -> Driver:
    """Make a driver.

    Args:
        name: A name of DRIVERS, the file of a policy (FILE.zip, see policy_files.py), or a class path,
            package.module:Class.

    Raises:
        ValueError: If the name is unknown or no driver; the message says what was expected.
        FileNotFoundError: If the file is missing.
    """
    check_driver_name(name)
    if name in DRIVERS:
        return DRIVERS[name]()
    if name.endswith(".zip"):
        return PolicyDriver(Path(name))
    return load_driver_class(name)


def check_driver_name(name: str) -> None:
    """Check that a name has one of the forms that make_driver takes. Nothing is read or imported.

    Raises:
        ValueError: It has none of them; the message says what was expected.
    """
    if name not in DRIVERS and ":" not in name and not name.endswith(".zip"):
        forms = f"{', '.join(DRIVERS)}, FILE.zip, package.module:Class"
        raise ValueError(f"{FIELD} {name!r} is unknown{did_you_mean(name, list(DRIVERS))}; choose from {forms}")


def load_driver_class(name: str) -> Any:
    """Make a driver from "package.module:Class", without arguments.

    Raises:
        ValueError: If the class cannot be imported or made, or is no driver.
    """
    module, _, attribute = name.partition(":")
    try:
        driver = getattr(import_user_module(module), attribute)()
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"{FIELD} {name!r} cannot be made: {error}") from None
    if not (callable(getattr(driver, "act", None)) and callable(getattr(driver, "reset", None))):
        raise ValueError(f"{FIELD} {name!r} has no methods reset and act")
    return driver
