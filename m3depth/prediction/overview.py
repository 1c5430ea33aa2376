"""What shows many predictions at once: a sheet of their pictures, a video, and the fused cloud.

All three are made of the files of the pairs, so that they do not depend on how often a run was stopped.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from m3depth.prediction.files import CLOUD, FIGURE, RECORD, read_cloud
from m3depth.prediction.fused_cloud import fuse
from m3depth.stereo.pairs import spread
from marssim.base.command.wording import without_middle
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import read_json
from marssim.base.files.png import decode_png
from marssim.base.images.video_file import written_video
from marssim.base.pose import ROVER_KEY, moved

SHEET, VIDEO, FUSED = "overview.jpg", "video.mp4", "fused_cloud.ply"
MOST, COLUMNS = 20, 4  # pictures of the sheet
SHEET_WIDTH, SPACE = 2000, 8  # [px] largest width of the sheet, and what is left free beside a picture
FONT = (cv2.FONT_HERSHEY_SIMPLEX, 0.42)  # and its size
LINE = 18  # [px] height of a name
RATE = 5.0  # frames a second of pairs that are not those of a video


def write_sheet(out: Path, names: Sequence[str]) -> None:
    """Write the sheet: at most 20 pictures, spread evenly over the pairs, each with its name.

    Args:
        out: The folder of the results.
        names: Folders of the pairs in it.
    """
    chosen = [names[i] for i in spread(len(names), MOST)]
    columns = min(COLUMNS, len(chosen))
    width = min(SHEET_WIDTH // columns - SPACE, _picture(out / chosen[0]).shape[1])
    cells = []
    for name in chosen:
        picture = _picture(out / name)
        height = max(1, round(picture.shape[0] * width / picture.shape[1]))
        small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        bar = np.full((LINE, width, 3), 255, np.uint8)
        cv2.putText(bar, shortened(name, width - 6), (3, 13), *FONT, (0, 0, 0), 1, cv2.LINE_AA)
        cells.append(np.concatenate([bar, small]))
    tall = max(cell.shape[0] for cell in cells)
    page = np.full((-(-len(cells) // columns) * (tall + SPACE), columns * (width + SPACE), 3), 255, np.uint8)
    for number, cell in enumerate(cells):
        row, column = divmod(number, columns)
        page[row * (tall + SPACE) :, column * (width + SPACE) :][: len(cell), :width] = cell
    write_atomically(out / SHEET, cv2.imencode(".jpg", page, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes())


def shortened(name: str, width: int) -> str:
    """Return a name whose middle is left out as far as it is longer than a width [px] in FONT.

    The beginning of a product's name says which camera it is of, and the end of a path which pair.
    """
    kept = len(name)
    while kept > 2 and cv2.getTextSize(without_middle(name, kept), *FONT, 1)[0][0] > width:
        kept -= 1
    return without_middle(name, kept)


def write_video(out: Path, names: Sequence[str], rate: float) -> None:
    """Write the pictures of the pairs, in order, as video (MPEG-4), reduced to the size of the first.

    Args:
        out: The folder of the results.
        names: Folders of the pairs in it.
        rate: Frames a second.

    Raises:
        OSError: The video cannot be written whole.
    """
    height, width = (side // 2 * 2 for side in _picture(out / names[0]).shape[:2])  # codecs want even sides
    with written_video(out / VIDEO, (width, height), rate) as write:
        for name in names:
            picture = _picture(out / name)
            if picture.shape[:2] != (height, width):
                picture = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
            write(picture)


def write_fused_cloud(out: Path, names: Sequence[str], voxel: float) -> None:
    """Fuse the clouds of the pairs, all of which have poses in one world.

    Args:
        out: The folder of the results.
        names: Folders of the pairs in it.
        voxel: Edge of the cubes in which points are averaged [m].
    """
    write_atomically(out / FUSED, fuse(_clouds(out, names), voxel).encode())


def _clouds(out: Path, names: Sequence[str]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the points in the world [m] and the colours of each pair."""
    for name in names:
        record = read_json(out / name / RECORD)
        (points, colours), pose = read_cloud(out / name / CLOUD), np.array(record["pose"])
        if record["cloud_frame"] == "rover":
            pose = pose @ np.linalg.inv(record[ROVER_KEY])
        if record["cloud_frame"] != "world":
            points = moved(points, pose)
        if len(points):
            yield points, colours


def _picture(folder: Path) -> np.ndarray:
    """Return the picture of a pair, (H, W, 3) uint8 BGR."""
    path = folder / FIGURE
    picture = decode_png(path.read_bytes()) if path.is_file() else None
    if picture is None or picture.ndim != 3:
        raise ValueError(f"{path}: is not a readable picture; delete {folder} to predict this pair again")
    return picture
