"""Code of the user that runs here, a driver or an estimator: its exceptions are reported as its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from marssim.base.results.code_state import source_digest

PROJECT = ("marssim", "m3depth", "nav", "envs")


class UserCodeError(RuntimeError):
    """A class of the user raised an exception. The message names the class; `__cause__` is the exception.

    This is no mistake on the command line, where one line without a place would hide it: commands show its traceback.
    """


@contextmanager
def errors_of(owner: object) -> Iterator[None]:
    """Raise exceptions of a method of `owner` as UserCodeError, unless its class is part of this project."""
    cls = type(owner)
    if cls.__module__.partition(".")[0] in PROJECT:
        yield
        return
    try:
        yield
    except Exception as error:
        message = f"{cls.__module__}:{cls.__qualname__} raised {type(error).__name__}"
        raise UserCodeError(f"{message}: {error}" if str(error) else message) from error


def code_digest() -> str:
    """Return twelve hexadecimal digits that identify the state of the project's Python sources."""
    return source_digest(PROJECT)
