"""The folders of well-known stereo benchmarks, filled with our samples.

Each layout lists the files of one sample by their path, with a function that makes the content, so that only what is
missing is made. Left images and maps are of the left eye. Known means not sky; known pixels are kept at any depth.
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
