"""The stereo methods that a process has loaded, for the drives that follow."""

from __future__ import annotations

from threading import get_ident

from envs.world.perception import BeginsDrives, is_ours, load_perception
from m3depth.estimator import Estimator, EstimatorName
from m3depth.weights import named_by

# By name, runtime and, for a user's class, thread: the digest of the files that a method was read from, and the method.
_LOADED: dict[tuple[str, str, int], tuple[str | None, str | Estimator]] = {}


def loaded_method(name: str, runtime: str) -> str | Estimator:
    """Return what an environment takes as perception. A process loads a network once, and again if its file changes.

    Each drive has its own instance of a user's class, as of a driver, since what it keeps of a drive must not reach the
    next. A class that can begin a drive has one for all drives of a thread.

    Args:
        name: A perception, as MarsNavEnv takes it.
        runtime: Program that runs M3Depth, as MarsNavEnv takes it.

    Raises:
        ImportError, OSError, ValueError: As load_perception.
    """
    key = name, runtime, 0 if is_ours(name) else get_ident()
    with named_by("`perception`"):
        digest = EstimatorName(name).digest()
    if key in _LOADED and _LOADED[key][0] == digest:
        return _LOADED[key][1]
    method = load_perception(name, runtime) or name
    if is_ours(name) or isinstance(method, BeginsDrives):
        _LOADED[key] = digest, method
    return method
