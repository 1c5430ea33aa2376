"""The settings of a dataset's reader: flags of every command that reads datasets."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from marssim.base.camera import WIDEST_BASELINE

Format = Literal["auto", "marssim", "kitti", "sceneflow", "middlebury", "eth3d", "oaisys", "list", "folder"]
Split = Literal["train", "val", "test", "all"]
NormalFrame = Literal["opencv", "opengl"]
DepthAlong = Literal["axis", "ray"]

CAMERA_AND_SCORE = ("calib", "focal", "baseline", "normals", "resize", "depth_range")
PATTERNS = ("left", "right", "disparity", "depth", "normal")
FLAGS: dict[Format, tuple[str, ...]] = {  # the fields that each layout takes; its files say the rest
    "marssim": (),
    "kitti": CAMERA_AND_SCORE,
    "sceneflow": CAMERA_AND_SCORE,
    "middlebury": CAMERA_AND_SCORE,
    "eth3d": CAMERA_AND_SCORE,
    "oaisys": ("left", "right", *CAMERA_AND_SCORE),
    "list": ("unit", *CAMERA_AND_SCORE),
    "folder": (*PATTERNS, "depth_along", "unit", "normal_frame", *CAMERA_AND_SCORE),
}


@dataclass(frozen=True)
class DataConfig:
    """How a dataset folder is read. Datasets of marssim need none of these settings.

    Raises:
        ValueError: A value that cannot work; the message names the field.
    """

    format: Format = "auto"
    """Layout of the dataset folders; auto recognises it by the files in them.
    list is a text file with lines of "left right disparity", paths with spaces in double quotes; folder finds files by
    patterns.
    """
    left: str | None = None
    """Pattern of the left images below --data, such as left/*.png (--format folder).
    With --format oaisys: name of the left sensor.
    """
    right: str | None = None
    """Pattern of the right images below --data, such as right/*.png (--format folder).
    Two images are a pair if * stands for the same text in both names. With --format oaisys: name of the right sensor.
    """
    disparity: str | None = None
    """Pattern of the left images' disparity maps [px] (--format folder).
    Their files are pfm, npy, tiff, exr or 16-bit png (256 times the disparity).
    """
    depth: str | None = None
    """Pattern of depth maps instead of disparity maps [m] (--format folder).
    Their files are exr, npy, pfm, tiff or 16-bit png (millimetres). Infinite depth is sky, but unknown in a pfm.
    """
    depth_along: DepthAlong = "axis"
    """Direction in which the depth maps measure: axis is depth along the optical axis; ray is the distance from the
    camera, as in AirSim's DepthPerspective and Isaac Sim's distance_to_camera.
    """
    unit: float | None = None
    """Number that the maps store for 1 px of disparity or 1 m of depth, not 0. CREStereo's datasets have 32. Without
    it, PNG files have 256 for disparity and 1000 for depth, and other files have 1."""
    normal: str | None = None
    """Pattern of the left images' normal maps (--format folder).
    Their files are 8- or 16-bit png, which stand for -1 to 1, or npy, exr or tiff of three numbers a pixel.
    """
    normal_frame: NormalFrame = "opencv"
    """Axes of the normals in these files: opencv has x right, y down, z forward; opengl has y up, z towards the camera.
    Normals face the camera.
    """
    calib: Path | None = None
    """One calibration file for all pairs, or the word natecam for Zhurong's camera.
    It may be any file of rectified cameras that m3depth.predict takes alone, or the config file of OAISYS.
    """
    focal: float | None = None
    """Focal length of the rectified images [px], above 0, given with --baseline instead of a calibration file."""
    baseline: float | None = None
    """Distance between the two cameras [m], above 0 and up to 10, given with --focal."""
    normals: Literal["none", "depth"] = "none"
    """Normals of datasets without true ones: none trains and scores depth alone; depth fits planes to it, in windows
    of 7 x 7 px of which every pixel is known: sparse maps, as of a lidar (KITTI), give few or none. Those that --normal
    finds need no such choice.
    """
    resize: float = 1.0
    """Factor by which images are reduced when they are read, above 0 and at most 1; disparities and cameras follow."""
    depth_range: tuple[float, float] = (0.0, math.inf)
    """Nearest and farthest true depth [m] of the pixels that count in scores.
    Datasets of marssim always have 0.5 to 15 m.
    """

    def __post_init__(self) -> None:
        for name in ("unit", "focal", "baseline"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value != 0 and (value > 0 or name == "unit")):
                raise ValueError(f"{name} must be {'other than 0' if name == 'unit' else 'positive'}, got {value}")
        if self.baseline is not None and self.baseline > WIDEST_BASELINE:
            raise ValueError(
                f"baseline must be at most {WIDEST_BASELINE:g} m, got {self.baseline:g}; is it in millimetres?"
            )
        if not 0 < self.resize <= 1:
            raise ValueError(f"resize must be over 0 and at most 1, got {self.resize}")
        low, high = self.depth_range
        if not 0 <= low < high:
            raise ValueError(f"depth_range must be two distances, the nearer one first, got {low} {high}")
        if (self.focal is None) != (self.baseline is None):
            raise ValueError("focal and --baseline belong together: give both")
        if self.calib is not None and self.focal is not None:
            raise ValueError("calib and --focal exclude each other: give one")
        if self.disparity is not None and self.depth is not None:
            raise ValueError("disparity and --depth exclude each other: give one")
        if self.depth is None and self.depth_along != "axis":
            raise ValueError("depth_along belongs to --depth: give both")
        if self.normal is not None and self.normals != "none":
            raise ValueError("normal and --normals exclude each other: give one")
        if self.normal is None and self.normal_frame != "opencv":
            raise ValueError("normal_frame belongs to --normal: give both")

    def changed_fields(self) -> dict[str, Any]:
        """Return the fields that differ from their defaults, the layout's name included."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) != f.default}

    def flags(self) -> list[str]:
        """Return the words of a command line that give the same config."""
        words: list[str] = []
        for name, value in self.changed_fields().items():
            words += [flag(name), *map(str, value if isinstance(value, tuple) else (value,))]
        return words

    def check_layout(self, layout: Format) -> None:
        """Raise ValueError that names a given flag which this layout does not take."""
        for name in self.changed_fields():
            if name != "format" and name not in FLAGS[layout]:
                takes = ", ".join(map(flag, FLAGS[layout])) or "none, because its files say everything"
                raise ValueError(f"{flag(name)} does not belong to layout {layout}, whose flags are {takes}")


def flag(name: str) -> str:
    """Return the flag of a field, such as --depth-range."""
    return f"--{name.replace('_', '-')}"
