"""One interface for everything that turns a stereo pair into depth, and one reader of the names of methods.

Importing this module loads no torch; `load_estimator("m3depth")` does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np

from m3depth.class_files import class_files, joint_digest
from m3depth.network.device import chosen_device
from m3depth.rivals.config import SOURCES
from m3depth.runtimes.choice import check_runtime, chosen_runtime, is_other_network
from m3depth.stereo.prediction import Prediction
from m3depth.user_module import ChangedModuleError, import_user_module
from m3depth.weights import SHIPPED, SHIPPED_WEIGHTS, check_weights_file, named_by
from m3depth.weights.config_json import kind_in_file
from marssim.base.camera import StereoRig
from marssim.base.command.spelling import did_you_mean
from marssim.base.results.code_state import source_file

M3DEPTH = "m3depth"
# OpenCV's and the paper's (App. C). Every command takes these names; load_estimator makes the methods.
Classical = Literal["sgbm", "sgbm-hh", "ssd", "sad", "ncc", "ssd-sgm", "sad-sgm", "ncc-sgm"]
CLASSICAL: tuple[Classical, ...] = get_args(Classical)
MCCNN = "mccnn"  # of the package mccnn, with semi-global matching
BUILT_IN = (*CLASSICAL, MCCNN)  # methods that need no file of weights or class from the user
FORMS = (M3DEPTH, "sgbm", "m3depth:WEIGHTS", "package.module:Class", *BUILT_IN[1:])  # every name that is understood
Holes = Literal["given", "fill", "unfilled"]  # what is done with unknown pixels; the last two may follow a name


@runtime_checkable
class Estimator(Protocol):
    """A stereo method, as evaluation, prediction and the driving environment use it.

    A method whose normals are planes fitted to its disparity sets the class attribute `normals_are_fitted = True`, so
    that evaluation does not fit them again. Another, `files`, names what it reads (m3depth.class_files). A method that
    remembers earlier images has a method `begin_drive()`, which environments call before each drive, to forget them.
    """

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Return the maps of the left image of a rectified pair.

        Args:
            left: (H, W) or (H, W, 3) uint8, RGB.
            right: The right image, of the same shape and type.
            rig: The cameras of these images.
        """
        ...


def for_pair(estimator: Estimator, sample: Any) -> Estimator:
    """Return an estimator for a pair whose truth is known: the same, unless it is one that gets the true depth.

    Args:
        estimator: The estimator; with the method `with_truth(disparity)`, that returns the one for the pair.
        sample: Holds the true disparity, (H, W) [px].
    """
    with_truth = getattr(estimator, "with_truth", None)
    return estimator if with_truth is None else with_truth(sample.disparity)


def gets_truth(estimator: object) -> bool:
    """Return whether a method gets the true depth of each pair, so that its figures are no estimates from images."""
    return bool(getattr(estimator, "takes_truth", False))


@dataclass(frozen=True)
class EstimatorName:
    """The name of a stereo method, as every command takes it.

    Attributes:
        name: "m3depth" (the shipped weights), "m3depth:PATH" (other weights of m3depth.train, of any network that it
            trains), one of BUILT_IN, or "package.module:Class" (a class without arguments that has infer).
        given_label: What tables call the method instead of its default label; None for the default.
        holes: What is to be done with unknown pixels: "fill" fills them from the background, as those of the classical
            methods are; "unfilled" leaves the holes of a classical method unknown; "given" changes nothing.
    """

    name: str
    given_label: str | None = None
    holes: Holes = "given"

    @property
    def form(self) -> str:
        """The name, with ",fill" or ",unfilled" after it."""
        return self.name if self.holes == "given" else f"{self.name},{self.holes}"

    @classmethod
    def parse(
        cls, text: str, role: str = "estimator", others: Sequence[str] = (), labelled: bool = False,
        fillable: bool = False,
    ) -> EstimatorName:  # fmt: skip
        """Read a name.

        Args:
            text: The name; with `labelled` also LABEL=NAME.
            role: What the caller calls it, for the message: a flag or an argument.
            others: Names that the caller alone understands, for the message.
            labelled: Whether a label may precede the name.
            fillable: Whether ",fill" may follow the name, or ",unfilled" that of a built-in method.

        Raises:
            ValueError: The name has none of these forms.
        """
        before, equals, after = text.partition("=")
        label, name = (before, after) if labelled and equals and ":" not in before else (None, text)
        holes: Holes = "given"
        for way in get_args(Holes)[1:] if fillable else ():
            if name.endswith(f",{way}"):
                name, holes = name.removesuffix(f",{way}"), way
        if holes == "unfilled" and name not in BUILT_IN:
            raise ValueError(f"{role} {text!r}: only {', '.join(BUILT_IN)} can be left unfilled")
        first, _, second = name.partition(":")
        if label == "" or not (name in (M3DEPTH, *BUILT_IN) or (first and second)):
            forms = ", ".join((*others, *FORMS))
            put_before = "; LABEL= before it names it in tables" if labelled else ""
            names = (*others, M3DEPTH, *BUILT_IN)
            similar = "" if label == "" or ":" in name else did_you_mean(name, names)
            raise ValueError(f"{role} {text!r} is unknown{similar}; choose from {forms}{put_before}")
        return cls(name, label, holes)

    @property
    def weights(self) -> Path | None:
        """The file of weights of M3Depth, or of another network that m3depth.train trained; None for other methods."""
        first, _, path = self.name.partition(":")
        return (Path(path) if path else SHIPPED_WEIGHTS) if first == M3DEPTH else None

    @property
    def file(self) -> Path | None:
        """The file that the method is read from: its weights or a class's module; None for classical methods, and for a
        module that Python does not find, which load_estimator explains."""
        if self.weights is not None:
            return self.weights
        if self.name == MCCNN:
            from m3depth.stereo.mc_cnn import mccnn_weights

            return mccnn_weights()
        module, colon, _ = self.name.partition(":")
        try:
            return source_file(module) if colon else None
        except ImportError:
            return None

    def digest(self) -> str | None:
        """Return the SHA-256 of `file` and of the files that a class names; None without a file.

        The source file of a network that this program has added counts with its weights. What a module imports does
        not count.

        Raises:
            OSError: A file is missing or cannot be read.
            ValueError: A class names its files wrongly.
        """
        if self.weights is not None:
            check_weights_file(self.weights)
        if self.file is None:
            return None
        source = None if self.weights is None else SOURCES.get(kind_in_file(self.weights) or "")
        return joint_digest((self.file, *class_files(self.name), *([] if source is None else [source])))

    def label(self, parts: int = 1) -> str:
        """Return what tables call the method.

        That is the given label, "M3Depth" for the shipped weights, "SGBM" and its like for built-in methods, the name
        of a class, and for other weights that of their file, or of the folder of their run.

        Args:
            parts: How many parts of the path the label of a weights file has, to tell files of one name apart.
        """
        if self.given_label is not None:
            return self.given_label
        if self.name in BUILT_IN:
            return self.name.upper() + ", unfilled" * (self.holes == "unfilled")
        if self.weights is None:
            return self.name.rpartition(":")[2]
        path = self._label_path()
        return "M3Depth" if path is None else "/".join(path[-parts:])

    def longest_label(self) -> int:
        """Return the number of parts from which `label` grows no longer."""
        path = self._label_path()
        return 1 if self.given_label is not None or path is None else len(path)

    def _label_path(self) -> tuple[str, ...] | None:
        """The path that a label of weights is the end of; None for methods without weights and for shipped ones."""
        if self.weights is None or self.weights.resolve() == SHIPPED_WEIGHTS.resolve():
            return None
        path = self.weights.absolute()
        return (path.parent if path.stem == "weights" and path.parent.name else path.with_suffix("")).parts[1:]


def name_with_weights(path: Path) -> str:
    """Return the name of the estimator that has a file of weights, which the word "shipped" names too."""
    return M3DEPTH if path == Path(SHIPPED) else f"{M3DEPTH}:{path}"


def distinct_labels(names: Sequence[EstimatorName]) -> list[str]:
    """Return the labels of several methods; weights files of one name get as much of their path as they need.

    Labels that the user gave, and those of a method that is named twice, may still be equal.
    """
    parts = [1] * len(names)
    while True:
        labels = [name.label(count) for name, count in zip(names, parts, strict=True)]
        times = Counter(labels)
        longer = [
            min(count + (times[label] > 1), name.longest_label())
            for name, count, label in zip(names, parts, labels, strict=True)
        ]
        if longer == parts:
            return labels
        parts = longer


def load_estimator(
    spec: str | Estimator, role: str = "estimator", others: tuple[str, ...] = (), device: str = "auto",
    runtime: str = "auto",
) -> Estimator:  # fmt: skip
    """Return the estimator of a name.

    Args:
        spec: A name as EstimatorName describes it, or an object that has infer, which comes back as it is.
        role: What the caller calls it, for the messages.
        others: Names that the caller alone understands, for the messages.
        device: Device that M3Depth runs on: cpu, cuda, or auto for a GPU if there is one. Other methods use the CPU.
        runtime: Program that runs M3Depth: pytorch, openvino, or auto, which is OpenVINO where it is installed and the
            device is the CPU. Other methods take no notice of it.

    Raises:
        ValueError: The name is unknown, the class is no estimator, or there is no GPU; in one line.
        FileNotFoundError: The weights are missing; the message names the file.
        ImportError: OpenVINO or mccnn is asked for and not installed; the message names the extra.
    """
    check_runtime(runtime, device)
    if not isinstance(spec, str):
        if isinstance(spec, type):
            cls = f"{spec.__module__}:{spec.__qualname__}"
            raise ValueError(f"{role} is the class {cls}: give an instance of it, or its name as text, {cls!r}")
        if not isinstance(spec, Estimator):
            raise ValueError(f"{role} {spec!r} has no method infer(left, right, rig)")
        _check_arguments(spec, f"{role} {spec!r}")
        return spec
    name = EstimatorName.parse(spec, role, others)
    if name.weights is not None:
        return _load_weights(name.weights, role, device, runtime)
    if name.name in ("sgbm", "sgbm-hh"):
        from m3depth.stereo.classical import SGBM

        return SGBM(directions=5 if name.name == "sgbm" else 8)
    if name.name in CLASSICAL:
        from m3depth.stereo.classical import BlockMatching

        cost, _, sgm = name.name.partition("-")
        return BlockMatching(cost, "sgm" if sgm else "wta")  # type: ignore[arg-type]
    if name.name == MCCNN:
        from m3depth.stereo.mc_cnn import McCnn

        try:
            return McCnn()
        except ImportError as error:
            raise ImportError(f"{role}: {error}") from None
    return _load_class(role, *name.name.split(":", 1))


def _load_weights(weights: Path, role: str, device: str, runtime: str) -> Estimator:
    chosen = "pytorch" if is_other_network(f"{M3DEPTH}:{weights}") else chosen_runtime(runtime, device)
    with named_by(role):
        check_weights_file(weights)  # before torch is imported
        from m3depth.kinds.networks import load_network
        from m3depth.network.model import M3Depth

        model = load_network(weights)
    if chosen == "openvino" and isinstance(model, M3Depth):
        from m3depth.runtimes.openvino_network import OpenVinoM3Depth

        return OpenVinoM3Depth(model)
    return model.to(chosen_device(device))


def _load_class(role: str, module_name: str, class_name: str) -> Estimator:
    where = f"{role} '{module_name}:{class_name}'"
    try:
        module = import_user_module(module_name)
    except (ModuleNotFoundError, ChangedModuleError) as error:
        raise ValueError(f"{where}: {error}") from None
    cls = getattr(module, class_name, None)
    if not isinstance(cls, type):
        raise ValueError(f"{where}: module {module_name} has no class {class_name!r}")
    try:
        estimator = cls()
    except TypeError as error:
        raise ValueError(f"{where}: cannot be made without arguments ({error})") from None
    if not isinstance(estimator, Estimator):
        raise ValueError(f"{where}: the class has no method infer(left, right, rig)")
    _check_arguments(estimator, where)
    return estimator


def _check_arguments(estimator: Estimator, where: str) -> None:
    """Raise ValueError if infer cannot be called as infer(left, right, rig); where: the estimator, for the message."""
    try:
        asked = signature(estimator.infer, follow_wrapped=False)  # a decorator may supply arguments
    except (TypeError, ValueError):  # of compiled code, which does not say what it takes
        return
    try:
        asked.bind(None, None, None)
    except TypeError as error:
        raise ValueError(f"{where}: infer{asked} must take left, right and rig ({error})") from None
