"""Code that others wrote and that is called here, a driver's or an estimator's: what it raises is told as its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from marssim.base.results.code_state import source_digest

PROJECT = ("marssim", "m3depth", "nav", "envs")


class UserCodeError(RuntimeError):
    """A class that is not the project's raised something. The message names it; the cause is what it was.

    It is no mistake on the command line, whose one line would hide where it is: commands show its traceback.
    """


@contextmanager
def errors_of(what: object) -> Iterator[None]:
    """What a method of `what` raises meanwhile becomes a UserCodeError, unless the class is the project's own."""
    cls = type(what)
    if cls.__module__.partition(".")[0] in PROJECT:
        yield
        return
    try:
        yield
    except Exception as error:
        told = f"{cls.__module__}:{cls.__qualname__} raised {type(error).__name__}"
        raise UserCodeError(f"{told}: {error}" if str(error) else told) from error


def code_digest() -> str:
    """Twelve hexadecimal digits that tell one state of the project's Python sources from another."""
    return source_digest(PROJECT)
