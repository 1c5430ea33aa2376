"""The layout of SceneFlow's FlyingThings3D."""

from __future__ import annotations

from marssim.layouts.layout import (
    Content,
    Item,
    Layout,
    SameAs,
    dense_pfm,
    no_lists,
    occlusion_png,
)
from marssim.layouts.middlebury import calibration_file

SEQUENCE = "A"  # the one that holds all scenes; FlyingThings3D has A, B and C


def _files(item: Item) -> dict[str, Content]:
    scene, view = item.name.split("/")
    part = f"{item.split.upper()}/{SEQUENCE}/{scene}"
    name = f"{int(view):04d}"
    clean, final = (f"FlyingThings3D/frames_{kind}pass/{part}" for kind in ("clean", "final"))
    return {
        f"{clean}/left/{name}.png": lambda: item.image("left.png"),
        f"{clean}/right/{name}.png": lambda: item.image("right.png"),
        f"{final}/left/{name}.png": SameAs(f"{clean}/left/{name}.png"),
        f"{final}/right/{name}.png": SameAs(f"{clean}/right/{name}.png"),
        f"FlyingThings3D/disparity/{part}/left/{name}.pfm": lambda: dense_pfm(item),
        f"FlyingThings3D/disparity_occlusions/{part}/left/{name}.png": lambda: occlusion_png(item),
        f"FlyingThings3D/calib/{part}/{name}.txt": lambda: calibration_file(item),
    }


SCENEFLOW = Layout(
    _files,
    no_lists,
    """\
SceneFlow's FlyingThings3D tree: `TRAIN`, `VAL` and `TEST` below `frames_cleanpass`, `frames_finalpass` (the same
images) and `disparity` (PFM, positive, left eye only). The sky has disparity 0, since it is infinitely far. Trainers
mask pixels that are too near for them (RAFT-Stereo: 512 px). They do not read `disparity_occlusions` (255 where the
right eye does not see the point) and `calib` (Middlebury's format).
""",
)
