"""The command line as a dataclass, and one-line messages for what is wrong with it."""

from __future__ import annotations

import difflib
import io
import re
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import is_dataclass
from typing import Any, TypeVar, get_type_hints

_RULE = re.compile(r"[─-]{8,}")
_OF_TYPES = re.compile(r"no type matching .*<class '\w+'>: ")  # of a flag that may be left out
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")

Config = TypeVar("Config")


def parse(
    config: type[Config],
    prog: str,
    description: str | None,
    args: Sequence[str] | None = None,
    default: Config | None = None,
) -> Config:
    """The dataclass `config` as the command line fills it. Raises ValueError of one line that names the flag.

    default: instance whose values are shown and taken instead of those of the class. What a config says about one of
    its own fields ("angle must be ...") becomes what the user can type ("--part.angle must be ...").
    """
    import tyro

    instead: dict[str, Any] = {} if default is None else {"default": default}

    said = io.StringIO()
    try:
        with redirect_stderr(said):
            return tyro.cli(config, prog=prog, description=description, args=args, **instead)
    except ValueError as error:  # a config's own, which the parser let through
        raise ValueError(_with_flag(str(error), config.__name__, config)) from None
    except SystemExit as end:
        if not end.code:
            raise
        raise ValueError(_parse_error(said.getvalue(), end.__context__, config)) from None


def _parse_error(framed: str, cause: BaseException | None, config: type) -> str:
    """tyro's message, which comes in a frame with help below, as one line.

    cause: what the parser was handling when it gave up; a ValueError there is a config's own, which names its flag.
    """
    parts: list[list[str]] = [[]]
    for line in _COLOUR.sub("", framed).splitlines()[1:]:
        line = line.strip("│|╰╯+ ")
        if _RULE.fullmatch(line):
            parts.append([])
        else:
            parts[-1].append(line)
    parts = [part for part in parts if any(part)] or [[]]
    message = " ".join(filter(None, parts[0]))
    if wrong := re.match(r"Error parsing (\S+): (.*)", message):
        where, why = wrong.groups()
        if where.startswith("--"):
            why = _OF_TYPES.sub("", why)
            usage = parts[1][1] if len(parts) > 1 and len(parts[1]) > 1 else where  # the flag with its kind of value
            return f"{usage}: {why}"
        while cause is not None and not isinstance(cause, ValueError):
            cause = cause.__context__
        return _with_flag(str(cause or why), where, config)
    if message.startswith("Missing from"):
        flags = [line.split()[0] for line in parts[0] if re.match(r"(--|[A-Z]+$)", line)]
        others = [line for part in parts[1:] if part[0].startswith("Unrecognized") for line in part[1:]]
        unknown = _unknown(" ".join(others).split(), flags) if others else ""
        return f"{', '.join(flags) or message} missing{unknown and f'; {unknown}'}; --help tells more"
    if message.startswith("Unrecognized"):
        known = [line.split()[0].rstrip(",") for part in parts[1:] for line in part if line.startswith("--")]
        return _unknown(message.partition(": ")[2].split(", "), known)
    return message[:1].lower() + message[1:]


def _unknown(words: Sequence[str], known: Sequence[str]) -> str:
    """What the parser could not place: options, each with the nearest of the known ones, or values of none."""
    told = []
    for option in (word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)):
        near = difflib.get_close_matches(option, known, 1)
        told.append(option + (f" (did you mean {near[0]}?)" if near else ""))
    return f"unknown option {', '.join(told)}" if told else f"{' '.join(words)} belongs to no option"


def _with_flag(message: str, where: str, config: type) -> str:
    """A config's complaint that begins with the name of one of its fields, with the flag instead.

    where: dotted path of the config in the root config, or the root's own name. A part whose flags bear no prefix
    (tyro.conf.arg(name="")) is on the path, but not in the flag.
    """
    holders: list[Any] = [config]
    prefix = ""
    for name in [] if where == config.__name__ else where.replace("-", "_").split("."):
        part, named = _parts(holders[0]).get(name, (None, True))
        if part is None:
            return message
        holders, prefix = [part], prefix + named * f"{name.replace('_', '-')}."
    holders += [part for part, named in _parts(holders[0]).values() if not named]
    word = re.match(r"[a-z]\w*", message)
    if word is None or not any(word[0] in get_type_hints(holder) for holder in holders):
        return message
    return f"--{prefix}{word[0].replace('_', '-')}{message[word.end() :]}"


def _parts(config: type) -> dict[str, tuple[type, bool]]:
    """The fields of a config that are configs themselves, and whether their flags bear their name."""
    parts = {}
    for name, hint in get_type_hints(config, include_extras=True).items():
        part = getattr(hint, "__origin__", hint)
        if is_dataclass(part) and isinstance(part, type):
            parts[name] = part, all(getattr(extra, "name", None) != "" for extra in getattr(hint, "__metadata__", ()))
    return parts
