"""The saved state of an unfinished evaluation, from which the same command continues."""

from __future__ import annotations

import hashlib
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
from marssim.base.files.json_file import as_json

UNFINISHED = "unfinished.npz"  # name of the file in the folder of results
SECONDS = 30.0  # between two saves: a killed evaluation loses at most this and the pair that is being scored
PLAIN = "plain"  # the entry that holds everything but the arrays, as JSON
DEPENDENCIES = "dependencies"  # key of the dependencies in that JSON
DIGEST = hashlib.sha256().digest_size  # bytes at the end of the file, of all before them
ARRAY = "\0array"  # key of an object in that JSON that stands for an array


class SavedStateError(ValueError):
    """A saved state is damaged or belongs to another evaluation; the one-line message names its file."""


class SavedState:
    """The file OUT/unfinished.npz, which exists until an evaluation is done; one that was killed continues from it.

    Attributes:
        path: The file.
        dependencies: What the figures depend on, by the name of the flag, in JSON's types. Only an evaluation with the
            same dependencies continues from the file.
    """

    def __init__(self, out: Path, dependencies: Mapping[str, Any]) -> None:
        self.path = out / UNFINISHED
        self.dependencies = as_json(dependencies)
        self._saved = time.monotonic()

    def load(self) -> dict[str, Any] | None:
        """Return the state that was saved last; None without a file. Nothing in the file is executed.

        Raises:
            SavedStateError: The file is damaged or belongs to another evaluation.
        """
        if not self.path.exists():
            return None
        try:
            data = self.path.read_bytes()
            if hashlib.sha256(data[:-DIGEST]).digest() != data[-DIGEST:]:
                raise ValueError("damaged")
            with np.load(io.BytesIO(data[:-DIGEST]), allow_pickle=False) as file:
                content = json.loads(file[PLAIN].item())
                saved, state = content.get(DEPENDENCIES, {}), _with_arrays(content["state"], file)
        except (EOFError, ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, zlib.error):
            raise self.damaged() from None
        names = sorted(saved.keys() | self.dependencies.keys())
        other = [name for name in names if saved.get(name) != self.dependencies.get(name)]
        if other:
            raise SavedStateError(
                f"{self.path}: belongs to an unfinished evaluation with another {', another '.join(other)}; choose "
                "another --out, or delete this file to score from the beginning"
            )
        return state

    def damaged(self) -> SavedStateError:
        """Return the error for a state that cannot be used."""
        return SavedStateError(
            f"{self.path}: is not a readable state of an evaluation; delete it to score from the beginning"
        )

    def save(self, state: Mapping[str, Any]) -> None:
        """Replace the file in one step.

        Args:
            state: Nested dicts and lists of JSON's types and of arrays.

        Raises:
            OSError: The file cannot be written; the message names it.
        """
        arrays: dict[str, np.ndarray] = {}
        content = {DEPENDENCIES: self.dependencies, "state": _without_arrays(state, arrays)}
        buffer = io.BytesIO()
        # json.dumps keeps NaN, unlike json_text: the sums of a scoring may hold it.
        np.savez_compressed(buffer, **{PLAIN: np.array(json.dumps(content))}, **arrays)  # type: ignore[arg-type]
        data = buffer.getvalue()
        write_atomically(self.path, data + hashlib.sha256(data).digest())
        self._saved = time.monotonic()

    def save_now_and_then(self, state: Callable[[], Mapping[str, Any]]) -> None:
        """Save the state if the last save was SECONDS ago.

        Args:
            state: Returns what `save` takes.
        """
        if time.monotonic() - self._saved >= SECONDS:
            self.save(state())

    def remove(self) -> None:
        """Remove the file, when the evaluation is done."""
        self.path.unlink(missing_ok=True)


def _without_arrays(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return the value with each array replaced by its name, and put the arrays into `arrays`."""
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
    """Return the value that _without_arrays was given, with lists for tuples."""
    if isinstance(value, dict):
        if ARRAY in value:
            return arrays[value[ARRAY]]
        return {key: _with_arrays(item, arrays) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_arrays(item, arrays) for item in value]
    return value
