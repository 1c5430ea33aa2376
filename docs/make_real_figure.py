"""Makes the figures of real ground in the README, in results/depth.md and in guides/own-images.md.

    python docs/make_real_figure.py NLMV0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01.IMG
    python docs/make_real_figure.py NLB_524534514EDR_F0562034NCAM00280M_.jpeg NRB_524534514EDR_F0562034NCAM00280M_.jpeg
    python docs/make_real_figure.py NLMV0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01.IMG --guide

The product of the first call is the left image of Perseverance's navigation cameras, from the Planetary Data System;
the right one lies beside it. m3depth.rectify makes a rectified pair of the two, by the camera models in their labels.
The images of the second call are of Curiosity's, as NASA's image server has them, without labels; their rows are fitted
to matched points. Each figure, perseverance.jpg or curiosity.jpg, has the left image, M3Depth's depth and normals, and
the normals of OpenCV's SGBM along eight paths: of the lower 4 x 3 of the view, and of a part of it, whose depth has
colours of its own range. Normals are black where M3Depth sees sky, and where SGBM has no match. With --guide, it makes
guide_navcam.jpg: what the guide's two commands write, the picture of m3depth.predict and that of nav.map.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import cv2
import numpy as np
import tyro

from m3depth import load_estimator
from m3depth.datasets.image_files import read_pair
from m3depth.predict import main as predict
from m3depth.rectify import main as rectify
from marssim.base.calibration.rectified import read_calibration
from marssim.base.camera import MAX_DEPTH
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER
from marssim.base.files.atomic import write_atomically
from marssim.base.images.colours import NEAR, depth_colours, normal_colours
from nav.map import main as nav_map

IMAGES = Path(__file__).parent / "images"
GUIDE = IMAGES / "guide_navcam.jpg"
GUIDE_WIDTH, GUIDE_QUALITY = 1100, 70  # [px], and of the JPEG: a picture of a guide has less than 100 kB
TILE = (400, 300)  # [px] width and height
GAP = 4  # [px] between the tiles
QUALITY = 88  # of the JPEG


class Figure(NamedTuple):
    """A figure, and how its pair is rectified."""

    file: Path
    """The figure."""
    command: Callable[[list[str]], int]
    """m3depth.rectify or m3depth.predict, which rectifies too."""
    flags: tuple[str, ...]
    """Flags of the command."""
    part: tuple[int, int]
    """Left and top of the part of 400 x 300 pixels [px], at the images' own resolution."""
    depths: tuple[float, float]
    """Nearest and farthest depth that have a colour in the whole view [m]."""


PERSEVERANCE = Figure(
    IMAGES / "perseverance.jpg", rectify, ("--focal", "560", "--size", "1024", "768"), (400, 300), (NEAR, MAX_DEPTH)
)
CURIOSITY = Figure(
    IMAGES / "curiosity.jpg", predict, ("--align", "--focal", "1236", "--baseline", "0.42"), (500, 690), (10.0, 50.0)
)


@dataclass(frozen=True)
class Options:
    """Makes a figure of real ground."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The left product of Perseverance (.IMG), or the left and the right image of Curiosity."""
    weights: str = "m3depth"
    """The network: m3depth, or m3depth:FILE for other weights."""
    out: Path | None = None
    """File of the figure; by default, that of the docs."""
    guide: bool = False
    """Make the figure of the guide instead, of the product and with the shipped weights."""

    def __post_init__(self) -> None:
        if len(self.images) not in (1, 2):
            raise ValueError(f"images must be one product or two images, got {len(self.images)} files")
        if self.guide and (len(self.images) == 2 or self.weights != "m3depth"):
            raise ValueError("guide takes one product, and no --weights")


def guide_figure(image: Path, folder: Path) -> np.ndarray:
    """Return the pictures that the guide's commands write, side by side, (H, W, 3) uint8 BGR."""
    flags = ["--left-right", "--cloud-frame", "rover"]
    if predict([str(image), *flags, "--out", str(folder / "pair")]):
        raise SystemExit(2)
    if nav_map([str(folder / "pair"), "--out", str(folder / "map")]):
        raise SystemExit(2)
    first, second = (cv2.imread(str(folder / name)) for name in ("pair/figure.png", "map/map.png"))
    size = (round(second.shape[1] * first.shape[0] / second.shape[0]), first.shape[0])
    both = np.hstack([first, np.full((size[1], 4 * GAP, 3), 255, np.uint8), cv2.resize(second, size)])
    height = round(both.shape[0] * GUIDE_WIDTH / both.shape[1])
    return cv2.resize(both, (GUIDE_WIDTH, height), interpolation=cv2.INTER_AREA)


def work(options: Options) -> None:
    """Make the figure, and write it."""
    if options.guide:
        with tempfile.TemporaryDirectory() as folder:
            _write(options.out or GUIDE, guide_figure(options.images[0], Path(folder)), GUIDE_QUALITY)
        return
    chosen = PERSEVERANCE if len(options.images) == 1 else CURIOSITY
    _write(options.out or chosen.file, real_figure(options, chosen), QUALITY)


def real_figure(options: Options, chosen: Figure) -> np.ndarray:
    """Return the view and a part of it, each in a row, (H, W, 3) uint8 BGR."""
    with tempfile.TemporaryDirectory() as folder:
        pair = Path(folder) / "pair"
        if chosen.command([*map(str, options.images), *chosen.flags, "--out", str(pair)]):
            raise SystemExit(2)
        pair = pair if chosen.command is rectify else pair / "rectified"
        left, right = read_pair(pair / "left.png", pair / "right.png")
        rig = read_calibration(pair / "rig.json").rig(left.shape[1], left.shape[0])
    ours, sgbm = (load_estimator(name).infer(left, right, rig) for name in (options.weights, "sgbm-hh"))
    left = cv2.cvtColor(left, cv2.COLOR_GRAY2RGB) if left.ndim == 2 else left
    normals = [normal_colours(p.normal) for p in (ours, sgbm) if p.normal is not None]
    normals[0][ours.is_sky] = 0
    normals[1][sgbm.confidence == 0] = 0
    x, y = chosen.part
    part = np.s_[y : y + TILE[1], x : x + TILE[0]]
    view = np.s_[-left.shape[1] * TILE[1] // TILE[0] :]
    near, far = np.nanpercentile(ours.depth[part], (0, 100))
    rows = [
        [left[view], depth_colours(ours.depth, *chosen.depths)[view], *(normal[view] for normal in normals)],
        [left[part], depth_colours(ours.depth[part], near, far), *(normal[part] for normal in normals)],
    ]
    rows = [[cv2.resize(image, TILE, interpolation=cv2.INTER_AREA) for image in row] for row in rows]
    white = {"borderType": cv2.BORDER_CONSTANT, "value": (255, 255, 255)}
    tiles = [[cv2.copyMakeBorder(tile, 0, GAP, 0, GAP, **white) for tile in row] for row in rows]
    return np.vstack([np.hstack(row) for row in tiles])[:-GAP, :-GAP, ::-1]


def _write(file: Path, picture: np.ndarray, quality: int) -> None:
    write_atomically(file, cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code."""
    return run_command(work, Options, "python docs/make_real_figure.py", __doc__, args, STARTS_OVER)


if __name__ == "__main__":
    sys.exit(main())
