"""The list of a package's commands: what `python -m marssim` and its like print."""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from marssim.base.version import VERSION, VERSION_FLAG, VERSION_LINE

COMMANDS = {
    "marssim": ("generate", "verify", "export", "mesh", "abundance", "slopes"),
    "m3depth": ("train", "evaluate", "predict", "rectify", "export", "ablate", "texture"),
    "nav": ("replay", "map"),
    "envs": ("evaluate", "make_suite", "join", "compare", "report", "inspect", "demo", "rocks", "train_ppo"),
}


def command_list(package: str) -> str:
    """Return the commands of a package with what each does, as text for the terminal.

    Args:
        package: One of COMMANDS.

    Returns:
        A heading, one line a command, and how to get the help of a command. No module of the package is imported.
    """
    names = [f"python -m {package}.{name}" for name in COMMANDS[package]]
    width = max(map(len, names))
    rows = [f"  {name:<{width}}  {summary(package, command)}" for name, command in zip(names, COMMANDS[package])]
    about = f"{names[0]} --help explains a command's flags; --version prints the version."
    return "\n".join([f"Commands of {package} {VERSION}:", "", *rows, "", about])


def print_commands(package: str, args: Sequence[str] | None = None) -> int:
    """Print the list of a package's commands, or with --version the version.

    Args:
        package: One of COMMANDS.
        args: The command line; None: sys.argv without the program.

    Returns:
        The exit code; see marssim.base.command.run.
    """
    from marssim.base.command.run import exit_code  # which loads more than the list needs

    given = sys.argv[1:] if args is None else args

    def work() -> None:
        for arg in given:
            if arg not in (VERSION_FLAG, "--help", "-h"):
                command = f"python -m {package}.{arg}" if arg in COMMANDS[package] else f"python -m {package}"
                raise ValueError(f"python -m {package} {arg}: this lists the commands and runs none; try {command}")
        print(VERSION_LINE if VERSION_FLAG in given else command_list(package))

    return exit_code(work)


def summary(package: str, command: str) -> str:
    """Return the first line of a command's docstring. It is read from the source, without importing it.

    Args:
        package: One of COMMANDS.
        command: One of COMMANDS[package].
    """
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    text = (Path(spec.origin).parent / f"{command}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
