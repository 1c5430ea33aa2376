"""What a reader of datasets can be told."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from marssim.base.camera import WIDEST

Format = Literal["auto", "marssim", "kitti", "sceneflow", "middlebury", "eth3d", "oaisys", "list", "folder"]
Part = Literal["train", "val", "test", "all"]

CAMERA_AND_SCORE = ("calib", "focal", "baseline", "normals", "resize", "depth_range")
FLAGS: dict[Format, tuple[str, ...]] = {  # what each layout can be told; the others say it themselves
    "marssim": (),
    "kitti": CAMERA_AND_SCORE,
    "sceneflow": CAMERA_AND_SCORE,
    "middlebury": CAMERA_AND_SCORE,
    "eth3d": CAMERA_AND_SCORE,
    "oaisys": ("left", "right", *CAMERA_AND_SCORE),
    "list": ("unit", *CAMERA_AND_SCORE),
    "folder": ("left", "right", "disparity", "depth", "unit", *CAMERA_AND_SCORE),
}


@dataclass(frozen=True)
class DataConfig:
    """How a dataset folder is read; needed for folders of your own, and where files do not say enough.

    Raises ValueError that names the field of a value that cannot work.
    """

    format: Format = "auto"
    """Layout of --data; auto: told by what lies there. list: lines of "left right disparity"; folder: patterns."""
    left: str | None = None
    """folder: pattern of the left images below --data, as left/*.png. oaisys: name of the left sensor."""
    right: str | None = None
    """folder: pattern of the right images; what its * match pairs them with the left ones. oaisys: the right sensor."""
    disparity: str | None = None
    """folder: pattern of disparity maps of the left eye [px]: pfm, 16-bit png (x 256), npy, tiff, exr."""
    depth: str | None = None
    """folder: pattern of depth maps instead [m along the optical axis]: exr, npy, pfm, tiff, 16-bit png (mm)."""
    unit: float | None = None
    """Stored number of 1 px, or of 1 m, where it is another than the above (CREStereo: 32)."""
    calib: Path | None = None
    """One calibration file for all pairs (any that m3depth.predict reads, or OAISYS's config), or "natecam"."""
    focal: float | None = None
    """Focal length of the rectified images [px], with --baseline instead of a calibration file."""
    baseline: float | None = None
    """Distance of the eyes [m]."""
    normals: Literal["none", "depth"] = "none"
    """Where a dataset holds no normals: none, depth is trained and scored alone; or those of planes fitted to depth."""
    resize: float = 1.0
    """Factor to which images are reduced as they are read; disparities and cameras follow."""
    depth_range: tuple[float, float] = (0.0, math.inf)
    """Depths that are scored [m] (marssim's datasets: always 0.5 to 15); what is outside is still trained."""

    def __post_init__(self) -> None:
        for name in ("unit", "focal", "baseline"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value != 0 and (value > 0 or name == "unit")):
                raise ValueError(f"{name} must be {'other than 0' if name == 'unit' else 'positive'}, got {value}")
        if self.baseline is not None and self.baseline > WIDEST:
            raise ValueError(f"baseline must be at most {WIDEST:g} m, got {self.baseline:g}; is it in millimetres?")
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

    def given(self) -> dict[str, Any]:
        """The fields that are not as they are by default, the layout's name among them."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) != f.default}

    def flags(self) -> list[str]:
        """The words of a command line that say the same."""
        words: list[str] = []
        for name, value in self.given().items():
            words += [flag(name), *map(str, value if isinstance(value, tuple) else (value,))]
        return words

    def check_layout(self, layout: Format) -> None:
        """Raise ValueError that names a flag which this layout has no use for."""
        for name in self.given():
            if name != "format" and name not in FLAGS[layout]:
                takes = ", ".join(map(flag, FLAGS[layout])) or "none: its files say everything"
                raise ValueError(f"{flag(name)} does not belong to layout {layout}, whose flags are {takes}")


def flag(name: str) -> str:
    """A field as the command line spells it."""
    return f"--{name.replace('_', '-')}"
