"""The layout that OpenStereo reads: lists of files, and the files."""

from __future__ import annotations

from collections.abc import Sequence

from marssim.layouts.layout import (
    Content,
    Item,
    Layout,
    dense_pfm,
    occlusion_png,
)
from marssim.layouts.middlebury import calibration_file


def _files(item: Item) -> dict[str, Content]:
    return {
        f"left/{item.flat}.png": lambda: item.image("left.png"),
        f"right/{item.flat}.png": lambda: item.image("right.png"),
        f"disparity/left/{item.flat}.pfm": lambda: dense_pfm(item),
        f"occluded/{item.flat}.png": lambda: occlusion_png(item),
        f"calib/{item.flat}.txt": lambda: calibration_file(item),
    }


def _lists(split: str, items: Sequence[Item]) -> dict[str, str]:
    lines = (f"left/{item.flat}.png right/{item.flat}.png disparity/left/{item.flat}.pfm\n" for item in items)
    return {f"{split}.txt": "".join(lines)}


OPENSTEREO = Layout(
    _files,
    _lists,
    """\
OpenStereo. `train.txt`, `val.txt`, `test.txt` list "left right disparity" a line, paths from this folder (its
DATA_PATH; the lists are its DATA_SPLIT). PFM, positive, without NaN; the sky has disparity 0, which its losses mask.
There is no right-eye disparity (RETURN_RIGHT_DISP: false). The list of a split without pairs is empty. OpenStereo
does not read `occluded/` (255 where the right eye does not see the point) and `calib/` (Middlebury's format).
""",
)
