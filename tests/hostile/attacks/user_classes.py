"""Estimators and drivers as users may write them: they raise, exit, hang, return nonsense or change their input."""

from __future__ import annotations

import sys
import time

import numpy as np

from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction


def _maps(shape, value=3.0, dtype=np.float32):
    return np.full(shape[:2], value, dtype)


class Raises:
    """Raises an exception, in one method or both."""

    error: BaseException = ZeroDivisionError("mine")

    def reset(self, env, seed):
        pass

    def infer(self, left, right, rig):
        raise self.error

    def act(self, env, observation):
        raise self.error


class RaisesValueError(Raises):
    error = ValueError("mine")


class RaisesKeyError(Raises):
    error = KeyError("mine")


class RaisesOSError(Raises):
    error = OSError("mine")


class RaisesMemoryError(Raises):
    error = MemoryError("mine")


class ExitsWell(Raises):
    error = SystemExit(0)


class ExitsBadly(Raises):
    error = SystemExit("mine")


class CallsExit(Raises):
    def infer(self, left, right, rig):
        sys.exit(0)

    def act(self, env, observation):
        sys.exit()


class ExitsWhenMade(Raises):
    def __init__(self):
        sys.exit(0)


class RaisesWhenMade(Raises):
    def __init__(self):
        raise TypeError("mine")


class Hangs(Raises):
    def infer(self, left, right, rig):
        time.sleep(1000)

    def act(self, env, observation):
        time.sleep(1000)


class ChangesItsInput:
    """Predicts as SGBM does, and then blackens the images."""

    def infer(self, left, right, rig):
        prediction = SGBM().infer(left, right, rig)
        left[:] = right[:] = 0
        return prediction

    def reset(self, env, seed):
        pass

    def act(self, env, observation):
        for values in observation.values():
            values[...] = np.nan
        return np.array([1.0, 0.0, 0.0], np.float32)


def _returning(name, prediction, action):
    """Return a class whose infer and act return what these functions make."""
    return type(name, (), {
        "__module__": __name__,
        "infer": lambda self, left, right, rig: prediction(left),
        "reset": lambda self, env, seed: None,
        "act": lambda self, env, observation: action(),
    })  # fmt: skip


NonsenseNone = _returning("NonsenseNone", lambda left: None, lambda: None)
NonsenseText = _returning("NonsenseText", lambda left: "depth", lambda: "ahead")
NonsenseArray = _returning("NonsenseArray", lambda left: _maps(left.shape), lambda: np.zeros(7))
NonsenseNaN = _returning(
    "NonsenseNaN", lambda left: Prediction(*(_maps(left.shape, np.nan),) * 2, None, _maps(left.shape, np.nan)),
    lambda: np.array([np.nan, np.nan]),
)  # fmt: skip
NonsenseInfinite = _returning(
    "NonsenseInfinite", lambda left: Prediction(*(_maps(left.shape, np.inf),) * 2, None, _maps(left.shape, 1.0)),
    lambda: np.array([np.inf, 0.0]),
)  # fmt: skip
NonsenseSize = _returning(
    "NonsenseSize", lambda left: Prediction(*(_maps((3, 3)),) * 2, None, _maps((3, 3))), lambda: 10**400
)
NonsenseNegative = _returning(
    "NonsenseNegative", lambda left: Prediction(*(_maps(left.shape, -3.0),) * 2, None, _maps(left.shape, 1.0)),
    lambda: [[1.0, 0.0]],
)  # fmt: skip
NonsenseObjects = _returning(
    "NonsenseObjects", lambda left: Prediction(*(_maps(left.shape, "x", object),) * 2, None, None), lambda: [{}, {}]
)
NonsenseComplex = _returning(
    "NonsenseComplex", lambda left: Prediction(*(_maps(left.shape, 1j, complex),) * 2, None, _maps(left.shape, 1.0)),
    lambda: np.array([1j, 0]),
)  # fmt: skip

RAISING = ("Raises", "RaisesValueError", "RaisesKeyError", "RaisesOSError", "RaisesMemoryError")
EXITING = ("ExitsWell", "ExitsBadly", "CallsExit", "ExitsWhenMade")
NONSENSE = tuple(name for name in globals() if name.startswith("Nonsense"))
