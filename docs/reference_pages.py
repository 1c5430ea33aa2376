"""Pages of the reference, made from the code: the flags of every command, and the public names of every package."""

from __future__ import annotations

import argparse
import inspect
import re
import shlex
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import tyro

from marssim.base.command.listing import COMMANDS

ROOT = Path(__file__).parents[1]
# How the public names of a package are introduced on its page.
ABOUT = {
    "marssim": "Cameras, places, scenes, renderers and datasets.",
    "m3depth": "The network, the other methods, and the readers of stereo data.",
    "nav": "The navigator and its parts. It needs numpy, scipy and OpenCV only.",
    "envs": "The environment, its drivers and their wrappers.",
}


class Asked(BaseException):
    """Ends a command when it has reached its parser, before any work. `args` are the parser's config and keywords."""


def pages() -> dict[str, str]:
    """Return the Markdown of every page that is made from the code, by its path in docs/."""
    made = {f"reference/commands-{package}.md": commands_page(package) for package in COMMANDS}
    made |= {f"reference/api-{package}.md": api_page(package) for package in COMMANDS}
    made["reference/marsnav-v0.md"] = environment_page()
    return made


def commands_page(package: str) -> str:
    """Return the page of a package's commands: what each does, and a table of its flags."""
    parts = [f"# Commands of {package}"]
    for name in COMMANDS[package]:
        module = import_module(f"{package}.{name}")
        parser = flags(module)
        parts += [f"## python -m {package}.{name}", _described(parser.description or ""), *_tables(parser)]
    return "\n\n".join(parts) + "\n"


def api_page(package: str) -> str:
    """Return the page of a package's public names, as directives of mkdocstrings."""
    names = public_names(package)
    parts = [f"# {package}", ABOUT[package], "A name is loaded when it is first used."]
    return "\n\n".join([*parts, *(f"::: {package}.{name}" for name in names)]) + "\n"


def public_names(package: str) -> list[str]:
    """Return the names that a package's face lists, in alphabetical order."""
    return sorted(getattr(import_module(package), "__all__", ()), key=str.lower)


def environment_page() -> str:
    """Return the page of MarsNav-v0: how it is made, its arguments with their defaults, and its docstring."""
    from envs.mars_nav import MarsNavEnv

    rows = ["| Argument | Default |", "|---|---|"]
    for name, value in list(inspect.signature(MarsNavEnv.__init__).parameters.items())[1:]:
        rows.append(f"| `{name}` | `{value.default!r}` |")
    example = '```python\nimport gymnasium\n\nenv = gymnasium.make("envs:MarsNav-v0")\n```'
    return "\n\n".join(["# MarsNav-v0", example, "\n".join(rows), inspect.getdoc(MarsNavEnv) or ""]) + "\n"


def command_line(text: str) -> tuple[str, list[str]]:
    """Return the module and the arguments of a command line `python -m MODULE ...` or `torchrun ... -m MODULE ...`."""
    words = shlex.split(text, comments=True)
    at = words.index("-m")
    return words[at + 1], words[at + 2 :]


def parse(module_name: str, args: Sequence[str]) -> None:
    """Parse the arguments of a command as the command does, and do none of its work.

    Raises:
        SystemExit: The arguments are wrong; the command has printed why.
    """
    real = tyro.cli

    def only_parse(config: Any, **keywords: Any) -> None:
        real(config, **keywords)
        raise Asked

    code = _run(import_module(module_name), only_parse, args)
    if code is not None:
        raise SystemExit(code)


def flags(module: ModuleType) -> argparse.ArgumentParser:
    """Return the parser of a command, with its flags in groups."""
    asked: list[Any] = []

    def note(config: Any, **keywords: Any) -> None:
        asked.extend([config, keywords])
        raise Asked

    _run(module, note, [])
    config, keywords = asked
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of get_parser; constraints.txt holds a tyro that has it
        known = {name: keywords[name] for name in ("default", "prog", "description") if name in keywords}
        return tyro.extras.get_parser(config, **known)


def _run(module: ModuleType, cli: Callable[..., Any], args: Sequence[str]) -> int | None:
    """Call a command with another parser. Returns its exit code if it ended by itself, None if the parser ended it."""
    with _replaced(cli):
        try:
            return module.main(list(args))
        except Asked:
            return None


@contextmanager
def _replaced(cli: Callable[..., Any]):
    real, tyro.cli = tyro.cli, cli
    try:
        yield
    finally:
        tyro.cli = real


def _described(text: str) -> str:
    """A command's docstring as Markdown: its examples and file lists are indented, so they become code blocks."""
    lines = text.splitlines()
    out: list[str] = []
    for line in lines:
        if line.startswith("    ") and out and out[-1] and not out[-1].startswith("    "):
            out.append("")  # a code block needs an empty line before it
        out.append(line)
    return "\n".join(out)


def _tables(parser: argparse.ArgumentParser) -> list[str]:
    """One table of flags a group."""
    parts = []
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.help and "help" not in action.dest]
        if not actions:
            continue
        title = (group.title or "").removesuffix(" options")
        parts.append({"positional arguments": "Arguments:", "options": "Flags:"}.get(title, f"Flags of `--{title}`:"))
        rows = [f"| {_flag(action)} | {_cell(str(action.help))} |" for action in actions]
        parts.append("\n".join(["| Flag | Meaning |", "|---|---|", *rows]))
    return parts


def _flag(action: argparse.Action) -> str:
    values = action.metavar if isinstance(action.metavar, str) else " ".join(action.metavar or ())
    values = values.removeprefix("{None}|")
    names = action.option_strings or [values or action.dest]
    shown = [f"`{name}`" for name in names]
    return ", ".join(shown) + (f" {_cell(f'`{values}`')}" if values and action.option_strings else "")


def _cell(text: str) -> str:
    """Text as a cell of a table, in which a backslash within code would show."""
    text = " ".join(text.split()).replace("%%", "%").removesuffix(" (default: None)")
    return "".join(
        _code(part) if n % 2 else part.replace("|", "\\|").replace("<", "&lt;")
        for n, part in enumerate(re.split(r"`([^`]+)`", text))
    )


def _code(text: str) -> str:
    """Code in a cell, as HTML where it holds bars or lists: these may break after each value."""
    if not re.search("[|,]", text):
        return f"`{text}`"
    shown = re.sub(r"[^\w\s.,:;{}-]|_", lambda sign: f"&#{ord(sign[0])};", text)  # so that no sign is Markdown
    return "<code>" + re.sub("(,|&#124;)", r"\1<wbr>", shown) + "</code>"


if __name__ == "__main__":
    sys.stdout.write("\n".join(pages().values()))
