"""Modules of classes that users name as "package.module:Class"."""

from __future__ import annotations

import hashlib
import platform
from importlib import import_module
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

from marssim.base.command.wording import where_to_run

# By the name of a module: what Python imported, and the SHA-256 of its file then. A reload makes another spec.
_IMPORTED: dict[str, tuple[ModuleSpec, str]] = {}


class ChangedModuleError(ImportError):
    """The file of a module differs from what this process imported; the one-line message names the file."""


def import_user_module(name: str) -> ModuleType:
    """Import the module of a class that a user names as "package.module:Class".

    Args:
        name: "package.module".

    Raises:
        ModuleNotFoundError: Python does not find it, or a module that it imports. One line that says what is missing,
            and how to name a module or where to run.
        ChangedModuleError: This process imported it before its file was changed, so that it would run the old code.
    """
    if name.startswith("."):  # import_module would take it for a name within a package
        hint = "name it as package.module, and run python -m in the folder of package, or put this folder on PYTHONPATH"
        raise ModuleNotFoundError(f"No module named {name!r}; {hint}", name=name)
    try:
        module = import_module(name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{error}{where_to_run(error, name)}", name=error.name) from None
    _check_unchanged(name, module)
    return module


def _check_unchanged(name: str, module: ModuleType) -> None:
    """Raise ChangedModuleError if the file of a module has changed since the first call after its import."""
    spec = getattr(module, "__spec__", None)
    if spec is None or not spec.has_location or not Path(file := spec.origin or "").is_file():
        return
    digest = hashlib.sha256(Path(file).read_bytes()).hexdigest()
    previous_spec, imported = _IMPORTED.get(name, (None, ""))
    if previous_spec is not spec:
        _IMPORTED[name] = spec, digest
    elif digest != imported:
        raise ChangedModuleError(
            f"on {platform.node()}, {file} has changed since Python imported it; start this process or worker again",
            name=name,
        )
