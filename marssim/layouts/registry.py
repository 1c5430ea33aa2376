"""The layouts by the names that marssim.export knows.

A layout gives the path of each file of a sample, and a function that makes its content, so that an export makes only
the files that are missing. All maps are of the left eye. A pixel is known if it is not sky, at whatever depth.
"""

from __future__ import annotations

from marssim.layouts.kitti import KITTI
from marssim.layouts.layout import Layout
from marssim.layouts.middlebury import ETH3D, MIDDLEBURY
from marssim.layouts.openstereo import OPENSTEREO
from marssim.layouts.sceneflow import SCENEFLOW

LAYOUTS: dict[str, Layout] = {
    "kitti": KITTI,
    "sceneflow": SCENEFLOW,
    "middlebury": MIDDLEBURY,
    "eth3d": ETH3D,
    "openstereo": OPENSTEREO,
}
