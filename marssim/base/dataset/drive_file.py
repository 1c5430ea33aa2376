"""A recorded drive in one file, step by step: what the rover saw, what its navigator weighed, and what came of it.

The file is a zip archive of plain data:

    drive.json              episode, settings, cameras and steps, as drive.schema.json describes them
    left/0007.jpg           left eye at step 7, reduced
    right/0007.jpg          right eye
    depth/0007.png          depth of the left eye as the perception measured it, 16 bits, see depth_codes
    confidence/0007.png     its confidence, 8 bits, 255 for 1
    error/0007.png          its error against the truth, 8 bits, see error_codes; not with the true depth itself
    map/0007.png            the ground as the navigator judged it, 8 bits, north up, see MAP_CODES
    height/0007.png         the heights that it measured in the same cells, 16 bits, see height_codes

Depth, confidence and error show every n-th pixel of the left eye: `rig` is the camera of these pixels. Steps without a
look have no images and no heights, and drivers without a map have neither map nor heights. Records of earlier releases
have no heights. Reading a file from elsewhere executes nothing, and every fault is a DatasetError.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.camera import StereoRig
from marssim.base.files.json_file import DatasetError, json_text, parse_json, read_json
from marssim.base.files.json_schema import first_fault
from marssim.base.files.png import decode_png, png_size
from marssim.base.files.whole_file import refuse_endless
from marssim.base.files.zip_member import read_member

FORMAT, VERSION = "marsnav-drive", 1
INDEX = "drive.json"  # member with everything but pictures
LAYERS = {
    "left": "jpg", "right": "jpg", "depth": "png", "confidence": "png", "error": "png", "map": "png", "height": "png",
}  # fmt: skip
MOST_BYTES = 1 << 28  # of all members of a file together, unpacked
MOST_PIXELS = 4096  # along a side of a picture
JPEG_MAGIC = b"\xff\xd8\xff"
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
NEAREST, RATIO = 0.1, 1.004  # [m] depth of code 1, and the ratio of the depths of two codes
SKY = 65535  # code of depth without end
HEIGHT_STEP, LEVEL = 0.02, 32768  # [m] between the heights of two codes, and the code of height 0
FULL_COST = 8.0  # [m] extra cost of a metre, from which the map's code does not rise any more
MAP_CODES = {"unknown": 0, "free": 1, "costly": 200, "too_near": 220, "blocked": 250}
"""Codes of a map's cells: "free" at no extra cost, rising to "costly" at FULL_COST; "too_near" to an obstacle for the
rover's middle."""
NOT_DRIVEN = "; record the drive again with envs.evaluate --record"


@cache
def drive_schema() -> dict[str, Any]:
    """Return the JSON schema of drive.json."""
    return read_json(Path(__file__).with_name("drive.schema.json"))


def depth_codes(depth: np.ndarray) -> np.ndarray:
    """Return depth as codes, 0.4 % apart: 0 for unknown, SKY for inf, and else 1 + ln(depth / NEAREST) / ln(RATIO).

    Args:
        depth: (...) [m], inf in the sky, NaN where unknown.

    Returns:
        (...) uint16.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        code = 1 + np.round(np.log(depth / NEAREST) / np.log(RATIO))
    code = np.where(np.isposinf(depth), SKY, np.clip(np.nan_to_num(code, nan=0.0), 1, SKY - 1))
    return np.where(np.isnan(depth), 0, code).astype(np.uint16)


def depth_of(codes: np.ndarray) -> np.ndarray:
    """Return the depth (...) float32 [m] of codes (...), inf in the sky, NaN where unknown."""
    with np.errstate(over="ignore"):
        depth = NEAREST * RATIO ** (codes.astype(np.float64) - 1)
    return np.where(codes == SKY, np.inf, np.where(codes == 0, np.nan, depth)).astype(np.float32)


def height_codes(heights: np.ndarray) -> np.ndarray:
    """Return heights as codes, 2 cm apart: 0 for unknown, and else LEVEL + height / HEIGHT_STEP.

    Args:
        heights: (...) [m], world z, NaN where unknown.

    Returns:
        (...) uint16.
    """
    code = np.clip(np.round(np.nan_to_num(heights) / HEIGHT_STEP) + LEVEL, 1, 65535)
    return np.where(np.isnan(heights), 0, code).astype(np.uint16)


def height_of(codes: np.ndarray) -> np.ndarray:
    """Return the heights (...) float32 [m] of codes (...), NaN where unknown."""
    return np.where(codes == 0, np.nan, HEIGHT_STEP * (codes.astype(np.float64) - LEVEL)).astype(np.float32)


def error_codes(depth: np.ndarray, truth: np.ndarray, scored: np.ndarray) -> np.ndarray:
    """Return the error of depth as codes: 128 + 100 ln(depth / truth), from 1 to 255; 0 where it is not scored.

    Args:
        depth: (...) [m]; NaN is not scored.
        truth: (...) true depth [m].
        scored: (...) bool, where the error counts.

    Returns:
        (...) uint8.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        error = 128 + 100 * np.log(depth / truth)
    return np.where(scored & ~np.isnan(error), np.clip(np.nan_to_num(error), 1, 255), 0).round().astype(np.uint8)


def encode_drive(content: Mapping[str, Any], pictures: Mapping[str, bytes]) -> bytes:
    """Return the content of a drive's file.

    Args:
        content: What drive.json holds, without format and version.
        pictures: JPEG and PNG files by their name in the archive.
    """
    index = json_text({"format": FORMAT, "version": VERSION, **content})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in [(INDEX, index.encode()), *pictures.items()]:
            member = zipfile.ZipInfo(name)  # with a fixed date, so that the same drive makes the same file
            member.external_attr = 0o644 << 16
            packing = zipfile.ZIP_DEFLATED if name == INDEX else zipfile.ZIP_STORED
            archive.writestr(member, data, packing)
    return buffer.getvalue()


def picture_name(layer: str, step: int) -> str:
    """Return the name of a picture in the archive; layer: one of LAYERS."""
    return f"{layer}/{step:04d}.{LAYERS[layer]}"


@dataclass(frozen=True)
class DriveFile:
    """A drive that was read from its file."""

    path: Path
    """The file."""
    content: Mapping[str, Any]
    """What drive.json holds."""
    pictures: Mapping[str, bytes]
    """JPEG and PNG files by their name in the archive."""

    @property
    def steps(self) -> list[Mapping[str, Any]]:
        """The steps of the drive, the last one where it ended."""
        steps: list[Mapping[str, Any]] = self.content["steps"]
        return steps

    @property
    def rig(self) -> StereoRig:
        """The cameras of depth, confidence and error."""
        return StereoRig.from_dict(self.content["rig"])

    def picture(self, layer: str, step: int) -> bytes | None:
        """Return a JPEG or PNG file as it is; None if the step has none. layer: one of LAYERS."""
        return self.pictures.get(picture_name(layer, step))

    def codes(self, layer: str, step: int) -> np.ndarray | None:
        """Return the pixels of a PNG layer (H, W), uint8 or uint16; None if the step has none.

        Raises:
            DatasetError: The picture is broken, or has another size than it must have.
        """
        name = picture_name(layer, step)
        data = self.pictures.get(name)
        if data is None:
            return None
        cells = self.steps[step].get("map")
        camera = self.rig.camera
        on_map = layer in ("map", "height")
        size = (cells["cells"],) * 2 if on_map and cells else (camera.height, camera.width)
        kind = np.uint16 if layer in ("depth", "height") else np.uint8
        # the size in the header is checked first, as a small file may unpack to a huge picture
        pixels = decode_png(data) if png_size(data) == size else None
        if pixels is None or pixels.shape != size or pixels.dtype != kind:
            raise DatasetError(
                f"{self.path}: {name} must be a PNG of {size[1]} x {size[0]} px, {8 * kind().nbytes} bits{NOT_DRIVEN}"
            )
        return pixels

    def depth(self, step: int) -> np.ndarray | None:
        """Return the depth of a step (H, W) float32 [m], inf in the sky, NaN where unknown; None without a look."""
        codes = self.codes("depth", step)
        return None if codes is None else depth_of(codes)

    def confidence(self, step: int) -> np.ndarray | None:
        """Return the confidence of a step (H, W) float32 in [0, 1]; None without a look."""
        codes = self.codes("confidence", step)
        return None if codes is None else (codes / np.float32(255)).astype(np.float32)

    def heights(self, step: int) -> np.ndarray | None:
        """Return the highest points that the navigator measured in the cells of its map, world z, at a step.

        Returns:
            (cells, cells) float32 [m], north up, NaN where unknown; None without a look or a map, and in records of
            earlier releases.
        """
        codes = self.codes("height", step)
        return None if codes is None else height_of(codes)


def read_drive(path: Path, with_pictures: bool = True) -> DriveFile:
    """Read the file of a recorded drive and check it.

    Args:
        path: The file.
        with_pictures: Whether to read its pictures too, which are nearly all of it.

    Raises:
        DatasetError: It is missing, broken, or holds anything else. One line that names the file.
    """
    members = _members(path, None if with_pictures else INDEX)
    if INDEX not in members:
        raise DatasetError(f"{path}: holds no {INDEX}, so it is no recorded drive")
    content = parse_json(members.pop(INDEX), f"{path}: {INDEX}")
    if content.get("format") != FORMAT:
        raise DatasetError(f"{path}: {INDEX} is not that of a recorded drive")
    if content.get("version") != VERSION:
        raise DatasetError(f"{path}: is of version {content.get('version')!r:.20}, not {VERSION}{NOT_DRIVEN}")
    if fault := first_fault(content, drive_schema()) or _fault(content, members):
        raise DatasetError(f"{path}: {fault}{NOT_DRIVEN}")
    return DriveFile(path, content, members)


def _members(path: Path, only: str | None = None) -> dict[str, bytes]:
    """Return the files of an archive by their names; only: the name of the one that is wanted. Raises DatasetError."""
    try:
        refuse_endless(path)
        with zipfile.ZipFile(path) as archive:
            if len(set(archive.namelist())) < len(archive.namelist()):
                raise DatasetError(f"{path}: holds two files of one name, as no recorded drive does")
            if sum(member.file_size for member in archive.infolist()) > MOST_BYTES:
                raise DatasetError(f"{path}: unpacks to more than {MOST_BYTES >> 20} MiB")
            members = [member for member in archive.infolist() if only in (None, member.filename)]
            return {member.filename: read_member(archive, member.filename) for member in members}
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except OSError as error:
        raise DatasetError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except DatasetError:
        raise
    # what zipfile raises for damaged and encrypted archives, and for unknown ways of packing
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError, LookupError):
        raise DatasetError(f"{path}: is not a whole zip archive, as recorded drives are") from None


def _fault(content: Mapping[str, Any], pictures: Mapping[str, bytes]) -> str | None:
    """Return what is wrong with content that keeps to the schema, None if nothing."""
    try:
        camera = StereoRig.from_dict(content["rig"]).camera
    except ValueError as error:
        return str(error)
    if max(camera.width, camera.height) > MOST_PIXELS:
        return f"rig has more than {MOST_PIXELS} px along a side"
    for n, step in enumerate(content["steps"]):
        candidates = step["candidates"]
        if candidates is None:
            continue
        lists = {**{k: v for k, v in candidates.items() if k != "parts"}, **candidates["parts"]}
        number = len(candidates["cost"])
        for name, values in lists.items():
            if len(values) != number:
                return f"steps[{n}].candidates.{name} must have {number} items, as cost has, got {len(values)}"
        chosen = step["chosen"]
        if chosen is None:
            continue
        if not 0 <= chosen < number:
            return f"steps[{n}].chosen must be one of the {number} candidates, got {chosen}"
        if candidates["cost"][chosen] is None:
            return f"steps[{n}].chosen must be a candidate with a cost, got {chosen}, which has none"
    for name, data in pictures.items():
        if not data.startswith(JPEG_MAGIC if name.endswith(".jpg") else PNG_MAGIC):
            return f"{name} is no {'JPEG' if name.endswith('.jpg') else 'PNG'} file"
    return None
