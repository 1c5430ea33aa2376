"""Graphs of OpenVINO on disk: to convert a network takes several seconds, which the next process saves.

They lie in the user's folder of caches, `$XDG_CACHE_HOME/mars-m3depth` or `~/.cache/mars-m3depth`, a zip file each,
named after all that a graph depends on. A file is written in one step and checked when it is read, so processes may
share it; instead of a damaged one the network is converted again. Where none can be written, each process converts.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import torch

from m3depth.network.model import M3Depth
from m3depth.runtimes.graphs import unpacked
from m3depth.runtimes.openvino_import import openvino
from marssim.base.command.notes import say
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import json_text
from marssim.base.results.code_state import source_digest

KEPT = 16  # files in the folder; those that were not used for longest are deleted
CONVERTING = "converting the network for OpenVINO takes some seconds, once for these weights"


def cache_folder() -> Path | None:
    """Return the folder of the files; None for a user without a home."""
    with suppress(RuntimeError):
        base = os.environ.get("XDG_CACHE_HOME")
        return (Path(base) if base else Path.home() / ".cache") / "mars-m3depth"
    return None


def graph_name(network: M3Depth, finer: bool, dtype: torch.dtype) -> str:
    """Return a name that differs for graphs that differ: by weights, config, code, versions and precision."""
    digest = hashlib.sha256(json_text(asdict(network.config)).encode())
    for name, tensor in sorted(network.state_dict().items()):
        digest.update(name.encode() + tensor.detach().cpu().contiguous().numpy().tobytes())
    code = source_digest(("m3depth.network", "m3depth.runtimes"))
    digest.update(f"{code} {openvino.__version__} {torch.__version__} {dtype} {finer}".encode())
    return digest.hexdigest()[:24]


def kept(name: str, convert: Callable[[], bytes]) -> openvino.Model:
    """Return the graph of a name from the folder, or convert it and keep it there.

    Args:
        name: The graph_name.
        convert: Makes the graph, as graphs.converted does.
    """
    folder = cache_folder()
    path = None if folder is None else folder / f"{name}.zip"
    if path is not None:
        with suppress(OSError, ValueError):  # missing or damaged
            graph = unpacked(path.read_bytes())
            with suppress(OSError):  # another user's
                path.touch()
            return graph
    say(CONVERTING)
    data = convert()
    if path is not None:
        with suppress(OSError):  # a full disk, or a folder that cannot be written
            write_atomically(path, data)
            _delete_old(path.parent)
    return unpacked(data)


def _delete_old(folder: Path) -> None:
    files = sorted(folder.glob("*.zip"), key=lambda file: file.stat().st_mtime)
    for file in files[:-KEPT]:
        file.unlink(missing_ok=True)
