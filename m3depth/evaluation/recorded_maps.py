"""Maps of depth or disparity that another program wrote, scored as if an estimator had computed them.

A folder DIR holds a map of the left image for every pair, at the pair's size, under one of these names. `scene/view`
is the pair's name in the dataset (00001/03; in KITTI a number, 000011 or test/000011), NUMBER its place in the split,
from 000000:

    scene/view.EXT    scene_view.EXT    scene_view_10.EXT
    view.EXT          view_10.EXT                            where no two pairs have the same last part
    NUMBER_10.EXT     NUMBER.EXT                             where no name of a pair ends with a number of six digits

or a folder of that name that holds disparity.EXT, left_disparity.EXT or depth.EXT, as m3depth.predict writes it. These
are the names under which marssim.export writes the images (ETH3D, Middlebury and OpenStereo: scene_view; KITTI:
NUMBER_10). All files of a folder are named in the same of these three ways. EXT is the first of these that exists:

    npy               numbers of any kind
    pfm, tiff, tif    float
    png               16 bit, disparity x 256 (KITTI) or depth in mm; 0: none

Negative values and NaN are unknown, in disparity infinite ones too, and in depth 0. A disparity of 0 and an infinite
depth are sky, but in PFM files, which mark unknown pixels by it, an infinite depth is unknown. NAME_normal.npy,
(H, W, 3) in the camera's frame, and NAME_confidence.npy, 0 to 1, are read too where they exist beside NAME.EXT; in a
folder, normal.npy and confidence.npy.

A disparity is x_left - x_right in the images as the dataset holds them. Where the principal points of its two cameras
differ (Middlebury's doffs), that difference is added to disparities over 0, as it is to the true ones. Those of
m3depth.predict, which lie beside its prediction.json, contain it already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from m3depth.datasets.image_files import decode_image
from m3depth.prediction.files import RECORD
from m3depth.stereo.filling import filled_prediction
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig
from marssim.base.dataset.map_file import PNG_UNIT
from marssim.base.files.npy import read_npy
from marssim.base.files.whole_file import read_file

ENDINGS = ("npy", "pfm", "tiff", "tif", "png")  # of files of maps; the first that exists is read
IN_A_FOLDER = {"disparity": ("disparity", "left_disparity"), "depth": ("depth",)}  # names in a pair's own folder
BESIDE = ("normal", "confidence")  # what a file beside a map may hold
PLACE_DIGITS = 6  # of a file's name that is its pair's place in the split
Naming = Literal["name", "last", "place"]
FORM = "NAME=DIR[,depth][,scale=S][,fill]"  # of --predictions


class RecordedError(ValueError):
    """A file of predictions cannot be used; the message names it."""


@dataclass(frozen=True)
class RecordedPredictions:
    """The maps of one method.

    Attributes:
        folder: The folder of the maps.
        kind: Whether the numbers are disparity or depth.
        scale: Stored number of 1 px or 1 m; None: 1, and for 16-bit PNG 256 or 1000. RAFT-Stereo and Pandora store
            negative disparities, scale -1.
        fill: Whether unknown pixels are filled from the background, as those of the classical baselines are.
        naming: Whether files have the pairs' names, the last parts of these, or the pairs' places; None until
            `of_pairs` has looked.
    """

    folder: Path
    kind: Literal["disparity", "depth"] = "disparity"
    scale: float | None = None
    fill: bool = False
    naming: Naming | None = None

    @classmethod
    def parse(cls, text: str) -> tuple[str, RecordedPredictions]:
        """Return name and maps of a text NAME=DIR[,depth][,scale=S][,fill].

        Raises:
            ValueError: The text has another form.
        """
        name, equals, rest = text.partition("=")
        folder, *settings = rest.split(",")
        if not (name and equals and folder):
            raise ValueError(f"{text}: expected {FORM}")
        kind: Literal["disparity", "depth"] = "disparity"
        scale = None
        for setting in settings:
            key, _, value = setting.partition("=")
            if setting == "fill":
                continue
            if setting in ("disparity", "depth"):
                kind = "depth" if setting == "depth" else "disparity"
            elif key == "scale":
                try:
                    scale = float(value)
                except ValueError:
                    scale = np.nan
                if not np.isfinite(scale) or scale == 0:
                    raise ValueError(f"{text}: scale must be a number other than 0, got {value!r}")
            else:
                raise ValueError(f"{text}: {setting!r} is none of depth, disparity, scale=S, fill")
        return name, cls(Path(folder), kind, scale, "fill" in settings)

    def of_pairs(self, pairs: Sequence[tuple[str, int]], names: Sequence[str] = ()) -> RecordedPredictions:
        """Return these maps with the naming of their files, once every pair has its file.

        Args:
            pairs: Names and places of the pairs that are scored.
            names: Names of all pairs of the split, if those are only some of them.

        Raises:
            FileNotFoundError: The folder or the file of a pair is missing.
        """
        if not self.folder.is_dir():
            raise FileNotFoundError(f"{self.folder}: no such folder")
        namings = _namings(names or [pair for pair, _ in pairs])
        for naming in namings:
            if any(self._first(_names(*pair, naming)) for pair in pairs):
                break
        else:
            naming = None
        maps = replace(self, naming=naming)
        for pair, number in pairs:
            if maps._first(maps._tried(pair, number, namings)) is None:
                raise self._missing(pair, maps._tried(pair, number, namings))
        return maps

    def find(self, pair: str, number: int) -> Path:
        """Return the file of a pair.

        Args:
            pair: The pair's name in the dataset.
            number: Its place in the split.

        Raises:
            FileNotFoundError: There is none; the message lists the names that were tried.
        """
        tried = self._tried(pair, number, _namings([pair]))
        path = self._first(tried)
        if path is None:
            raise self._missing(pair, tried)
        return path

    def files(self, pairs: Sequence[tuple[str, int]]) -> list[Path]:
        """Return all files that the maps of pairs are read from.

        Args:
            pairs: Names and places of the pairs.

        Raises:
            FileNotFoundError: A pair has no map.
        """
        maps = [self.find(*pair) for pair in pairs]
        others = [(*(self._beside(path, what) for what in BESIDE), path.with_name(RECORD)) for path in maps]
        return [*maps, *(file for files in others for file in files if file is not None and file.is_file())]

    def _tried(self, pair: str, number: int, namings: Sequence[Naming]) -> list[str]:
        """Return the names that a pair's file may have: those of the naming, or of all namings before it is known."""
        return [name for naming in ([self.naming] if self.naming else namings) for name in _names(pair, number, naming)]

    def read(self, pair: str, number: int, rig: StereoRig, shift: float = 0.0) -> Prediction:
        """Return the recorded maps of a pair as a Prediction.

        Args:
            pair: The pair's name in the dataset.
            number: Its place in the split.
            rig: The cameras of the pair.
            shift: Difference of the principal points that the pair's true disparities contain [px]; it is added to
                recorded ones, but not to those of m3depth.predict.

        Raises:
            FileNotFoundError: The pair has no file.
            RecordedError: A file cannot be used.
        """
        path = self.find(pair, number)
        shape = (rig.camera.height, rig.camera.width)
        stored = read_recorded_map(path, shape)
        scale = self.scale or (PNG_UNIT[self.kind] if path.suffix == ".png" else 1.0)
        values = stored.astype(np.float32) / np.float32(scale)
        with np.errstate(invalid="ignore"):
            if self.kind == "depth":
                valid = (values > 0) & (np.isfinite(values) | (path.suffix != ".pfm"))
            else:
                valid = np.isfinite(values) & (values >= 0)
        if path.suffix == ".png":
            valid &= stored > 0
        values = np.where(valid, values, np.float32(np.nan))
        if self.kind == "disparity" and shift and not path.with_name(RECORD).is_file():
            with np.errstate(invalid="ignore"):  # what is then beyond infinity counts as infinitely far
                values = np.where(values > 0, np.maximum(values + np.float32(shift), 0), values)
        if self.kind == "disparity":
            disparity, depth = values, np.where(valid, rig.disparity_to_depth(values), np.float32(np.nan))
        else:
            disparity, depth = np.where(valid, rig.depth_to_disparity(values), np.float32(np.nan)), values
        normal, confidence = (self._beside(path, what) for what in BESIDE)
        prediction = Prediction(
            depth,
            disparity,
            None if normal is None else read_recorded_map(normal, (*shape, 3)).astype(np.float32),
            np.ones(shape, np.float32)
            if confidence is None
            else read_recorded_map(confidence, shape).astype(np.float32),
        )
        return filled_prediction(prediction, rig) if self.fill else prediction

    def _first(self, names: Sequence[str]) -> Path | None:
        """Return the first file of these names that exists."""
        for name in names:
            for base in (self.folder / name, *(self.folder / name / inner for inner in IN_A_FOLDER[self.kind])):
                for ending in ENDINGS:
                    path = base.with_name(f"{base.name}.{ending}")
                    if path.is_file():
                        return path
        return None

    def _missing(self, pair: str, names: Sequence[str]) -> FileNotFoundError:
        tried = ", ".join(dict.fromkeys(names))
        return FileNotFoundError(
            f"{self.folder}: no {self.kind} of pair {pair}; looked for {tried}, with .{', .'.join(ENDINGS)}"
        )

    def _beside(self, path: Path, what: str) -> Path | None:
        """Return the file of normals or confidence that belongs to a map, if it exists."""
        in_a_folder = path.stem in IN_A_FOLDER[self.kind]
        beside = path.with_name(f"{what}.npy" if in_a_folder else f"{path.stem}_{what}.npy")
        return beside if beside.is_file() else None


def _namings(pairs: Sequence[str]) -> list[Naming]:
    """Return the ways in which the files of pairs may be named, the surest first.

    Files are not looked up by the last parts of names if two pairs have the same, and not by their places if a name
    ends with a number like them: such a file might belong to another pair.
    """
    last = [pair.rpartition("/")[2] for pair in pairs]
    namings: list[Naming] = ["name"]
    if len(set(last)) == len(pairs) and any("/" in pair for pair in pairs):
        namings.append("last")
    if not any(pair.isdigit() or (name.isdigit() and len(name) == PLACE_DIGITS) for pair, name in zip(pairs, last)):
        namings.append("place")
    return namings


def _names(pair: str, number: int, naming: Naming) -> list[str]:
    """Return the names that the file of a pair may have in one naming, without its ending."""
    if naming == "place":
        place = f"{number:0{PLACE_DIGITS}d}"
        return [f"{place}_10", place]
    if naming == "last":
        last = pair.rpartition("/")[2]
        return [last, f"{last}_10"]
    flat = pair.replace("/", "_")
    return [pair, flat, f"{flat}_10"]


def read_recorded_map(path: Path, shape: tuple[int, ...]) -> np.ndarray:
    """Return the numbers of a file as an array of a shape; axes of length 1 are dropped.

    Args:
        path: The file.
        shape: Shape of the array.

    Raises:
        RecordedError: The file holds no such numbers; the message names it.
    """
    values: np.ndarray | None
    try:
        if path.suffix == ".npy":
            values = read_npy(path)
        else:
            values = decode_image(read_file(path))
    except ValueError:
        values = None
    if values is None or values.dtype.kind not in "fiu":
        raise RecordedError(f"{path}: holds no map that can be read; expected npy, pfm, tiff or 16-bit png")
    if path.suffix == ".png" and values.dtype != np.uint16:
        raise RecordedError(f"{path}: is an 8-bit picture; a PNG of measurements has 16 bits")
    if values.shape != shape and values.squeeze().shape != shape:
        raise RecordedError(f"{path}: is of shape {values.shape}, the pair's images are of shape {shape}")
    return values.reshape(shape)
