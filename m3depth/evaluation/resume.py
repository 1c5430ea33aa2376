"""What an evaluation has scored so far, in a file from which the same command goes on."""

from __future__ import annotations

import io
import json
import time
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.files.atomic import write_atomically

UNFINISHED = "unfinished.npz"
SECONDS = 30.0  # between two saves: the most that is lost, beside the pair that is being scored
PLAIN = "plain"  # the entry that holds everything but the arrays, as JSON
ARRAY = "\0array"  # key of what stands in it for an array


class UnfinishedError(ValueError):
    """The file is damaged, or another evaluation's; one line that names it."""


class Unfinished:
    """OUT/unfinished.npz: there while an evaluation is not done, so that one that was ended, by kill -9 too, goes on.

    asked: what the figures depend on, by the name under which the user knows it; JSON's types. Another evaluation does
    not go on with the same file.
    """

    def __init__(self, out: Path, asked: Mapping[str, Any]) -> None:
        self.path = out / UNFINISHED
        self.asked = json.loads(json.dumps(asked))
        self._saved = time.monotonic()

    def load(self) -> dict[str, Any] | None:
        """What was saved last, None if nothing is there. Nothing in the file is executed.

        Raises UnfinishedError that names the file, if it is damaged or another evaluation's.
        """
        if not self.path.exists():
            return None
        try:
            with np.load(self.path, allow_pickle=False) as file:
                content = json.loads(file[PLAIN].item())
                asked, state = content["asked"], _with_arrays(content["state"], file)
        except (EOFError, ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, zlib.error):
            raise self.damaged() from None
        other = [name for name in sorted(asked.keys() | self.asked.keys()) if asked.get(name) != self.asked.get(name)]
        if other:
            raise UnfinishedError(
                f"{self.path}: of an unfinished evaluation with another {', another '.join(other)}; choose another "
                "--out, or delete it"
            )
        return state

    def damaged(self) -> UnfinishedError:
        """To be raised if what was loaded is of no use."""
        return UnfinishedError(f"{self.path}: not a readable state of an evaluation; delete it to begin anew")

    def save(self, state: Mapping[str, Any]) -> None:
        """Replace the file. state: nested dicts with text as keys and lists of JSON's types and of arrays."""
        arrays: dict[str, np.ndarray] = {}
        content = {"asked": self.asked, "state": _without_arrays(state, arrays)}
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **{PLAIN: np.array(json.dumps(content))}, **arrays)  # type: ignore[arg-type]
        write_atomically(self.path, buffer.getvalue())
        self._saved = time.monotonic()

    def save_now_and_then(self, state: Callable[[], Mapping[str, Any]]) -> None:
        """The same, if the last time is SECONDS ago."""
        if time.monotonic() - self._saved >= SECONDS:
            self.save(state())

    def remove(self) -> None:
        """The evaluation is done."""
        self.path.unlink(missing_ok=True)


def _without_arrays(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """The same with arrays, which are put into `arrays`, replaced by what names them there."""
    if isinstance(value, np.ndarray):
        name = str(len(arrays))
        arrays[name] = value
        return {ARRAY: name}
    if isinstance(value, Mapping):
        return {key: _without_arrays(item, arrays) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_arrays(item, arrays) for item in value]
    return value


def _with_arrays(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """What _without_arrays was given, with lists for tuples."""
    if isinstance(value, dict):
        if ARRAY in value:
            return arrays[value[ARRAY]]
        return {key: _with_arrays(item, arrays) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_arrays(item, arrays) for item in value]
    return value
