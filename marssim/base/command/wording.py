"""Phrases that the messages of several commands share."""

from __future__ import annotations

from pathlib import PurePosixPath

GOES_ON = "the same command goes on from here"
STARTS_OVER = "the same command starts over"  # likewise, of a command that keeps nothing
KILLED = "a worker process was killed, perhaps for lack of memory, of which fewer --workers need less"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, as "1 pair" or "2 pairs".

    Args:
        number: How many there are.
        noun: The noun in the singular, whose plural ends in s.
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def where_to_run(error: ImportError, module: str) -> str:
    """Return the end of a message on a user's module that cannot be imported: how Python finds it, or nothing.

    Args:
        error: What the import raised. The hint is only for a module that Python does not find, not for one that this
            module imports.
        module: The module that the user named, as "package.module".
    """
    if not isinstance(error, ModuleNotFoundError) or not error.name or not f"{module}.".startswith(f"{error.name}."):
        return ""
    if "/" in module or module.endswith(".py"):
        path = PurePosixPath(module.removesuffix(".py"))
        if path.is_absolute():
            return f"; name it as {path.name}, and run python -m in {path.parent}"
        return f"; name it as {'.'.join(path.parts)}"
    package, dot, _ = module.partition(".")
    return f"; run python -m in the folder of {package}{'' if dot else '.py'}, or put this folder on PYTHONPATH"


def without_middle(text: str, kept: int) -> str:
    """Return a text with "..." instead of its middle, of which `kept` characters stay; a shorter one stays whole."""
    if len(text) <= kept:
        return text
    return f"{text[: (kept + 1) // 2]}...{text[len(text) - kept // 2 :]}"
