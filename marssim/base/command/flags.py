"""Parse a command line into a dataclass, and say in one line what is wrong with it."""

from __future__ import annotations

import io
import math
import os
import re
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import redirect_stderr
from dataclasses import fields, is_dataclass
from inspect import cleandoc
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from marssim.base.command.exits import HelpPrinted
from marssim.base.command.limits import check_number
from marssim.base.command.spelling import did_you_mean
from marssim.base.version import VERSION_FLAG, VERSION_LINE

_RULE = re.compile(r"[─-]{8,}")  # line between two parts of the parser's message
_TYPE_PREFIX = re.compile(r"no type matching .*<class '\w+'>: ")  # begins the message on an optional flag
_annotated: set[type] = set()  # the configs whose fields bear their help
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")  # control sequence of a terminal

Config = TypeVar("Config")


def parse(
    config: type[Config],
    prog: str,
    description: str | None,
    args: Sequence[str] | None = None,
    default: Config | None = None,
) -> Config:
    """Return the dataclass `config` as the command line fills it.

    A flag that takes any number of values may be repeated: `--driver a --driver b` is `--driver a b`.

    Args:
        config: A dataclass; each field is a flag, and a field that is a dataclass gives its flags a prefix.
        prog: The command, as it is typed.
        description: Text above the flags in --help.
        args: The command line; None: sys.argv without the program.
        default: An instance whose values are the defaults, instead of those of the class.

    Raises:
        ValueError: The command line is wrong. The message is one line that names the flag: a config's "angle must be
            ..." about its own field becomes "--part.angle must be ...".
        HelpPrinted: --help or --version was asked for, and is printed.
    """
    import tyro

    args = sys.argv[1:] if args is None else args
    if VERSION_FLAG in args:
        print(VERSION_LINE)
        raise HelpPrinted(0)
    defaults: dict[str, Any] = {} if default is None else {"default": default}
    output = io.StringIO()
    _check_not_empty(args, set(_list_flags(config)))
    _annotate_help(config)
    try:
        with redirect_stderr(output):
            parsed = tyro.cli(
                config, prog=prog, description=description, args=joined(args, set(_list_flags(config))), **defaults
            )
        _check_numbers(parsed)
        return parsed
    except ValueError as error:  # raised by a config; the parser does not catch it
        raise ValueError(_with_flag(str(error), config.__name__, config)) from None
    except SystemExit as end:
        if not end.code:
            raise HelpPrinted(0) from None
        raise ValueError(_parse_error(output.getvalue(), end.__context__, config)) from None


def _check_not_empty(args: Sequence[str], list_flags: Collection[str]) -> None:
    """Raise ValueError for an empty value, which as a path would mean the working directory, or for none.

    Args:
        args: The command line.
        list_flags: The flags that take any number of values, of which the parser allows none.
    """
    words = args[: args.index("--")] if "--" in args else args
    for word, after in zip(words, [*words[1:], "--"]):
        if word.replace("_", "-") in list_flags and after.startswith("--"):
            raise ValueError(f"{word} needs a value")
    flag = "a value before all --flags"
    for before, word in zip(["", *args], args):
        if match := re.fullmatch(r"(--[a-zA-Z][\w.-]*)(=.*)?", word, re.DOTALL):
            flag = match[1]
        if word == "" or (match and match[2] == "="):
            what = flag if before == flag or word or not flag.startswith("--") else f"a value after {flag}"
            raise ValueError(f"{what} is empty: give it a value, or leave it out")


def _check_numbers(config: Any, prefix: str = "--") -> None:
    """Check that the numbers of a config and of its parts are finite and of a size that can be meant.

    Raises:
        ValueError: A number is not; the message names its flag.
    """
    parts = _parts(type(config))
    for field in fields(config):
        value, flag = getattr(config, field.name), prefix + field.name.replace("_", "-")
        if field.name in parts:
            _check_numbers(value, f"{flag}." if parts[field.name][1] else prefix)
            continue
        for number in value if isinstance(value, list | tuple) else (value,):
            if isinstance(number, int | float) and not isinstance(number, bool):
                check_number(flag, number, may_be_infinite=_has_infinity(field.default))


def _has_infinity(default: Any) -> bool:
    return math.inf in (default if isinstance(default, tuple) else (default,))


def _annotate_help(config: type) -> None:
    """Annotate the fields of a config, and of its parts, with their docstrings as paragraphs of one line each.

    tyro would take the docstrings by itself, but then breaks the lines of --help where the source does.
    """
    import docstring_parser
    import tyro
    from typing_extensions import Doc

    if config in _annotated:
        return
    _annotated.add(config)
    for part, _ in _parts(config).values():
        _annotate_help(part)
    for owner in config.__mro__:
        if not is_dataclass(owner) or "__annotations__" not in vars(owner):
            continue
        hints = get_type_hints(owner, include_extras=True)
        helps = {entry.arg_name: entry.description for entry in docstring_parser.parse_from_object(owner).params}
        for name in {field.name for field in fields(owner)} & set(owner.__annotations__):
            if text := cleandoc(helps.get(name) or ""):
                paragraphs = (" ".join(paragraph.split()) for paragraph in text.split("\n\n"))
                plain = not is_dataclass(getattr(hints[name], "__origin__", hints[name]))
                hint = (tyro.conf.arg(help_behavior_hint=_default_in_words),) if plain else ()
                owner.__annotations__[name] = Annotated[(hints[name], Doc("\n\n".join(paragraphs)), *hint)]


def _default_in_words(default: str) -> str:
    """Return the end of a flag's help: its default, unless it is that the flag is left out, which the help explains."""
    return "" if default in ("", "None") else f"(default: {default})"


def joined(args: Sequence[str], flags: set[str]) -> list[str]:
    """Return a command line in which each of some flags stands once, with the values of all its occurrences.

    Args:
        args: The command line.
        flags: Flags that take any number of values, as "--part.some-name".
    """
    groups: list[list[str]] = [[]]  # each a flag and its values
    first: dict[str, list[str]] = {}
    end = args.index("--") if "--" in args else len(args)  # words after it are no flags
    for word in args[:end]:
        flag, equals, value = word.partition("=")
        flag = flag.replace("_", "-")
        if not re.match(r"--?[a-zA-Z]", word):
            groups[-1].append(word)
        elif flag in first:
            groups.append(first[flag])
            groups[-1] += [value] if equals else []
        else:
            groups.append([flag, value] if equals and flag in flags else [word])
            if flag in flags:
                first[flag] = groups[-1]
    unique = {id(group): group for group in groups}
    return [*(word for group in unique.values() for word in group), *args[end:]]


def _list_flags(config: type, prefix: str = "--") -> Iterator[str]:
    """Yield the flags of a config that take any number of values."""
    parts = _parts(config)
    for name, hint in get_type_hints(config).items():
        dashed = name.replace("_", "-")
        if name in parts:
            part, named = parts[name]
            yield from _list_flags(part, f"{prefix}{dashed}." if named else prefix)
        elif _is_list(hint):
            yield prefix + dashed


def _is_list(hint: Any) -> bool:
    """Return whether a type is a list, a tuple of any length, or one of them or None."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _is_list(args[0])
    if origin in (Union, UnionType):
        return any(map(_is_list, args))
    return origin is list or (origin is tuple and Ellipsis in args)


def _parse_error(framed: str, cause: BaseException | None, config: type) -> str:
    """Return the parser's message as one line.

    Args:
        framed: What tyro printed: the message in a frame, with help below.
        cause: The exception that the parser was handling; a ValueError among its contexts was raised by a config.
        config: The config.
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
            usage = parts[1][1] if len(parts) > 1 and len(parts[1]) > 1 else where  # the flag with its kind of value
            return _value_error(where, usage.removeprefix(where).strip(), _TYPE_PREFIX.sub("", why))
        while cause is not None and not isinstance(cause, ValueError):
            cause = cause.__context__
        return _with_flag(str(cause or why), where, config)
    if message.startswith("Missing from"):
        flags = [line.split()[0] for line in parts[0] if re.match(r"(--|[A-Z]+$)", line)]
        others = [line for part in parts[1:] if part[0].startswith("Unrecognized") for line in part[1:]]
        unknown = _unknown(" ".join(others).split(), flags) if others else ""
        return f"{', '.join(flags) or message} missing{unknown and f'; {unknown}'}; --help explains the flags"
    if message.startswith("Unrecognized"):
        options = [line.split()[0].rstrip(",") for part in parts[1:] for line in part if line.startswith("--")]
        return _unknown(message.partition(": ")[2].split(", "), options)
    if missing := re.match(r"Missing value for argument '(\S+)'\. Expected (\d+) values", message):
        flag, count = missing.groups()
        return f"{flag} needs {'a value' if count == '1' else f'{count} values'}"
    if wrong := re.match(r"invalid choice '(.*)' for argument '(\S+)'\. Expected one of (.*)\.", message, re.I):
        word, flag, choices = wrong.groups()
        names = re.findall(r"'([^']*)'", choices)
        return f"{flag} must be {', '.join(names[:-1])} or {names[-1]}, got {word!r}{did_you_mean(word, names)}"
    return message[:1].lower() + message[1:]


def _value_error(flag: str, kind: str, why: str) -> str:
    """Return a message on a value that a flag does not take.

    Args:
        flag: The flag.
        kind: Kind of its values as --help shows it, like "{None}|FLOAT" or "[INT [INT ...]]".
        why: The parser's message.
    """
    kind = kind.removeprefix("{None}|").strip("{}")
    count = kind.count(" ") + 1
    if why.startswith("input length 0 "):
        return f"{flag} needs {count} values"
    of_tuple = re.match(r"(\[.*\]) does not match choices", why)  # one that may be left out
    noun = {"INT": "whole number", "FLOAT": "number", "PATH": "path"}.get("".join(set(re.findall("[A-Z]+", kind))))
    mistaken = re.match("invalid literal|could not convert|could not (find valid parse|parse arguments)", why, re.I)
    if noun and (of_tuple or mistaken):
        wanted = f"{noun}s" if "..." in kind else f"a {noun}" if count == 1 else f"{count} {noun}s"
        words = " ".join(re.findall("'([^']*)'", of_tuple[1] if of_tuple else why))
        return f"{flag} must be {wanted}, got {words!r}"
    return f"{flag} {kind}: {why}"


def _unknown(words: Sequence[str], flags: Sequence[str]) -> str:
    """Return a message on words that belong to no option; each unknown option has the most similar known one."""
    options = []
    for option in (word.partition("=")[0] for word in words if re.match(r"--?(?!inf$|nan$)[a-zA-Z]", word)):
        options.append(option + did_you_mean(option, flags))
    if options:
        return f"unknown option {', '.join(options)}"
    more = f" and {len(words) - 3} more" if len(words) > 3 else ""
    message = f"{' '.join(words[:3])}{more} belong{'s' * (len(words) == 1)} to no option"
    if all(os.path.exists(word) for word in words):  # False for too long a name, too
        message += "; write a pattern in quotation marks, or the shell replaces it by the files that match"
        message += "; without a pattern, the flag before takes fewer values"
    return message


def _with_flag(message: str, where: str, config: type) -> str:
    """Replace the name of a field, with which a config's error message begins, by its flag.

    Args:
        message: The error message.
        where: Dotted path of the config in the root config, or the root's name. A part whose flags have no prefix
            (tyro.conf.arg(name="")) is on the path, but not in the flag.
        config: The root config.
    """
    holders: list[Any] = [config]
    prefix = ""
    for name in [] if where == config.__name__ else where.replace("-", "_").split("."):
        part, named = _parts(holders[0]).get(name, (None, True))
        if part is None:
            return message
        holders, prefix = [part], prefix + named * f"{name.replace('_', '-')}."
    holders += [part for part, named in _parts(holders[0]).values() if not named]
    word = re.match(r"[a-z]\w*(?![\w./\\-])", message)  # not the beginning of a path
    if word is None or not any(word[0] in get_type_hints(holder) for holder in holders):
        return message
    return f"--{prefix}{word[0].replace('_', '-')}{message[word.end() :]}"


def _parts(config: type) -> dict[str, tuple[type, bool]]:
    """Return the fields of a config that are configs themselves, and whether their flags have a prefix."""
    parts = {}
    for name, hint in get_type_hints(config, include_extras=True).items():
        part = getattr(hint, "__origin__", hint)
        if is_dataclass(part) and isinstance(part, type):
            parts[name] = part, all(getattr(extra, "name", None) != "" for extra in getattr(hint, "__metadata__", ()))
    return parts
