"""Make an elevation map and traversability of predicted depth, as GeoTIFF.

    python -m m3depth.predict left.png right.png --calib rig.json --mount 0.65 1.2 20 --out out/pair
    python -m nav.map out/pair --out out/map
    python -m m3depth.predict pairs.txt --calib rig.json --poses poses.txt --out out/drive
    python -m nav.map out/drive --out out/map

The command reads depth, confidence, rig and pose of each pair in the folder. Pairs with poses (of m3depth.predict
--poses, or of a dataset of marssim) become one map of the world. A single pair without one becomes a map of the rover's
frame, x ahead and y left, where the rover stands level. It writes into --out, as GeoTIFF with cells of --cell metres:

    elevation.tif        height of the ground [m]; NaN: not seen
    top.tif              height of the highest point in a cell [m]
    weight.tif           how sure the heights are [1 / m2]: inverse squares of the range errors of the points, summed
    step.tif             height by which a cell stands out of the ground [m]
    slope_deg.tif        slope of the ground under the rover's footprint [deg]
    roughness.tif        RMS distance of the ground from the plane of the footprint [m]
    cost.tif             extra cost of a metre at the rover's centre, 0 on even ground
    traversability.tif   0: free; 1: too near to an obstacle for the rover's centre; 2: obstacle; 255: unknown
    map.png              all of it as a picture, north up, with coordinates, the cameras and where they look
    map.json             what the map was made of

The files end where nothing more was seen. nav.replay --prior, and nav.read_map in Python, read them again.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from marssim.base.calibration.rectified import SHIFT_KEY
from marssim.base.camera import StereoRig
from marssim.base.command.progress import watched
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.dataset.map_file import find_map, read_map_file
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.pose import ROVER_KEY, recorded_pose
from marssim.base.results.claim import ResultFolder
from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import FEWEST_CELLS, ElevationConfig, ElevationMap
from nav.ground.map_files import BLOCKED, MOST_CELLS, RESULT, UNKNOWN, layers, window_of, write_map
from nav.ground.traversability import Traversability, TraversabilityConfig, assess

RECORD = "prediction.json"  # of m3depth.predict, beside the maps of a pair
OF_MANY = "predictions.json"  # of m3depth.predict, beside the folders of many pairs
MOSTLY = 0.9  # share of the depth that lies beyond the range from which on the map has a warning
LEAST_CONFIDENCE = ElevationConfig.min_confidence
LEAST_HEIGHT = 0.05  # [m] of a camera over the ground; from less, or from below, it sees something else
LEAST_AREA = 2.0  # [m2], about that of the rover's footprint
EDGE = 1.0  # [m] around what can be seen
COLUMNS = 1024  # of an image that are used, roughly: more than while driving, as time does not matter here


# ranges of EPSG codes that are geographic or geocentric, and single ones; a map needs a projected one
NOT_PROJECTED = (
    *(range(4001, 4026), range(4027, 4037), range(4039, 4048), range(4052, 4056)),
    *(range(4120, 4390), range(4600, 4647), range(4657, 4766), range(4801, 4822), range(4882, 5000)),
    (4075, 4081, 4490, 6318, 7844),
)


@dataclass(frozen=True)
class MapOptions:
    """Make an elevation map and traversability of predicted depth, as GeoTIFF.

    Raises:
        ValueError: A value that cannot work; the message names the field.
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Folder that m3depth.predict wrote, of one pair or of many."""
    out: Path
    """Folder to write the map to; a map in it is replaced."""
    cell: float = 0.1
    """Edge of a cell [m], from 0.02 to 0.5. Slopes are those of planes through squares of cells, 1.2 to 1.8 m wide
    up to cells of 0.3 m, and 3 m at 0.5 m."""
    max_range: float = 12.0
    """Depth [m], above 0.5, beyond which points are left out."""
    min_confidence: float | None = None
    """Confidence, from 0 to 1, below which a pixel is unknown. It needs pairs whose confidence was written. Left out:
    0.5 for those."""
    origin: tuple[float, float] = (0.0, 0.0)
    """East and north [m] of the world's origin in the coordinates of the files."""
    epsg: int | None = None
    """EPSG code, 1024 to 32766, of the projected coordinate system of --origin, in metres. Without it, the files have a
    local frame in metres."""

    def __post_init__(self) -> None:
        if not 0.02 <= self.cell <= 0.5:
            raise ValueError(f"cell must be 0.02 to 0.5 m, got {self.cell:g}")
        if not 0.5 < self.max_range < np.inf:
            raise ValueError(f"max_range must be finite and over 0.5 m, got {self.max_range:g}")
        if self.min_confidence is not None and not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence must be 0 to 1, got {self.min_confidence:g}")
        if not np.isfinite(self.origin).all():
            raise ValueError(f"origin must be two finite numbers [m], got {self.origin}")
        if self.epsg is not None and not 1024 <= self.epsg <= 32766:
            raise ValueError(f"epsg must be 1024 to 32766, got {self.epsg}")
        if any(self.epsg in codes for codes in NOT_PROJECTED):
            raise ValueError(f"epsg must be a projected coordinate system in metres, got {self.epsg}, which is not one")


@dataclass(frozen=True)
class PredictedPair:
    """A pair that m3depth.predict has predicted.

    Attributes:
        folder: The folder of its maps.
        rig: The cameras.
        pose: (4, 4) left camera to world, or to the rover where there is no world.
        camera_height: Height of the camera over the ground under the rover [m]; None where nothing says it.
        is_on_rover: Whether the pose is that on the rover.
        is_assumed: Whether that pose is an assumed one.
        shift: The right camera's cx minus the left one's [px].
    """

    folder: Path
    rig: StereoRig
    pose: np.ndarray
    camera_height: float | None = None
    is_on_rover: bool = False
    is_assumed: bool = False
    shift: float = 0.0

    def read(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Return depth (H, W) [m], and confidence (H, W), which is None where it was not written.

        Raises:
            DatasetError: There is no depth, or a file is broken; the message names it.
        """
        depth, confidence = find_map(self.folder, "depth"), find_map(self.folder, "confidence")
        if depth is None:
            raise DatasetError(f"{self.folder}: holds no depth; m3depth.predict --write depth confidence writes it")
        try:
            confidences = None if confidence is None else read_map_file(confidence, "confidence")
            maps = read_map_file(depth, "depth"), confidences
        except ValueError as error:
            raise DatasetError(str(error)) from None
        size = self.rig.camera.height, self.rig.camera.width
        if maps[0].shape != size:
            raise DatasetError(f"{self.folder}: depth is {maps[0].shape}, the rig's camera has {size} pixels")
        return maps


def find_pairs(data: Path) -> list[PredictedPair]:
    """Return the predicted pairs in a folder, in the order of their names.

    Args:
        data: A folder of m3depth.predict, of one pair or of many.

    Raises:
        DatasetError: There are none, a record is broken, or the pairs have no common frame; one line. Of many pairs,
            those without a pose are left out with a note.
    """
    if not data.is_dir():
        raise DatasetError(f"{data}: no such folder")
    files = [data / RECORD] if (data / RECORD).is_file() else sorted(data.rglob(RECORD))
    if not files:
        raise DatasetError(f"{data}: holds no {RECORD}; give a folder that m3depth.predict wrote")
    records = [(file, read_json(file)) for file in files]
    of_all = read_json(data / OF_MANY).get("pairs") if (data / OF_MANY).is_file() else None
    if isinstance(of_all, int) and len(records) < of_all:
        print(f"note: {data} holds {len(records)} of {of_all} pairs, and the map lacks the others", file=sys.stderr)
    worlds = sorted({str(record.get("world")) for _, record in records})
    if len(worlds) > 1:
        raise DatasetError(
            f"{data}: holds pairs of {len(worlds)} scenes; give the folder of one, such as {data / worlds[0]}"
        )
    placed = [(file, record) for file, record in records if record.get("pose") is not None]
    if len(records) == 1:
        placed = records
    elif not placed:
        raise DatasetError(f"{files[0]}: has no pose, which a map of many pairs needs; give m3depth.predict --poses")
    elif len(placed) < len(records):
        lacking = counted(len(records) - len(placed), "pair")
        print(f"note: the map lacks {lacking} of {len(records)}, which have no pose", file=sys.stderr)
    return [_pair(file, record) for file, record in placed]


def _pair(file: Path, record: dict[str, Any]) -> PredictedPair:
    try:
        rig = StereoRig.from_dict(record["rig"])
        given = record[ROVER_KEY] if record.get("pose") is None else record["pose"]
    except (KeyError, TypeError, ValueError):
        raise DatasetError(f"{file}: holds no rig and pose of a pair; predict it again") from None
    try:
        pose = recorded_pose(given)
    except ValueError as error:
        raise DatasetError(f"{file}: {error}; predict it again") from None
    on_rover, is_assumed = record.get("pose") is None, record.get("mount_assumed") is True
    height, shift = None if is_assumed else _height_on_rover(record), record.get(SHIFT_KEY, 0.0)
    if isinstance(shift, bool) or not isinstance(shift, int | float) or not math.isfinite(shift):
        raise DatasetError(f"{file}: {SHIFT_KEY} must be a number [px], got {shift!r:.40}; predict it again")
    return PredictedPair(file.parent, rig, pose, height, on_rover, on_rover and is_assumed, float(shift))


def _height_on_rover(record: dict[str, Any]) -> float | None:
    """Return the height of a camera over the ground under its rover [m]; None where the record has none."""
    try:
        height = float(recorded_pose(record.get(ROVER_KEY))[2, 3])
    except ValueError:
        return None
    return height if height > LEAST_HEIGHT else None


@dataclass
class DepthCount:
    """How many pixels of pairs have depth, and how many of them lie beyond the map's range."""

    known: int = 0
    beyond: int = 0

    def add(self, depth: np.ndarray, max_range: float) -> None:
        """Count a depth map (H, W) [m]; inf and NaN are no depth."""
        with np.errstate(invalid="ignore"):
            finite = np.isfinite(depth) & (depth > 0)
            self.known += int(finite.sum())
            self.beyond += int((finite & (depth > max_range)).sum())


def make_map(
    pairs: Sequence[PredictedPair], options: MapOptions, count: DepthCount | None = None
) -> tuple[ElevationMap, Traversability]:
    """Fuse the depth of pairs into one map, and judge it for the rover.

    Args:
        pairs: The pairs, in one frame.
        options: The command's flags.
        count: The pixels of the pairs are added to it.

    Raises:
        DatasetError: A file of a pair cannot be used, or the map would be too large.
    """
    places = np.array([pair.pose[:2, 3] for pair in pairs])
    low, high = places.min(axis=0), places.max(axis=0)
    cameras = {pair.rig.camera for pair in pairs}
    # how far away a pixel at the corner of an image may be at that depth
    reach = options.max_range * max(float(np.linalg.norm(camera.rays(), axis=-1).max()) for camera in cameras)
    size = float((high - low).max()) + 2 * (reach + EDGE)
    cells = max(FEWEST_CELLS, int(np.ceil(size / options.cell)))
    if cells > MOST_CELLS:
        apart = float((high - low).max())
        flag = f"--max-range {options.max_range:g}" if 2 * reach > apart else f"--cell {options.cell:g}"
        instead = "a smaller range" if 2 * reach > apart else "larger cells, or fewer pairs"
        raise DatasetError(
            f"{flag}: the pairs lie up to {apart:.0f} m apart, and depth reaches {reach:.0f} m, so the map would have "
            f"{cells} x {cells} cells, over {MOST_CELLS} x {MOST_CELLS}; give {instead}"
        )
    config = ElevationConfig(
        cell=options.cell, size=cells * options.cell, max_range=options.max_range,
        min_confidence=LEAST_CONFIDENCE if options.min_confidence is None else options.min_confidence, columns=COLUMNS,
    )  # fmt: skip
    middle = (low + high) / 2
    elevation = ElevationMap(config, (float(middle[0]), float(middle[1])))
    for pair in _watched(pairs):
        depth, confidence = pair.read()
        if count is not None:
            count.add(depth, options.max_range)
        try:
            height = pair.camera_height or _height_over_ground(depth, pair)
            elevation.integrate(depth, confidence, pair.rig, pair.pose, height, pair.shift)
        except ValueError as error:
            raise DatasetError(f"{pair.folder}: {error}") from None
    return elevation, assess(elevation, ZHURONG, TraversabilityConfig())


def _height_over_ground(depth: np.ndarray, pair: PredictedPair) -> float:
    """Return how high a camera is over the nearest tenth of what it sees [m], for want of its place on the rover.

    Zhurong's height is the most, since ground that falls away makes a camera look higher than it is. It is also taken
    where nothing lies below the camera.
    """
    measured = np.isfinite(depth) & (depth > 0)
    near = measured & (depth <= np.quantile(depth[measured], 0.1)) if measured.any() else measured
    below = -(pair.rig.camera.rays()[near] @ pair.pose[2, :3]) * depth[near]
    height = float(np.median(below)) if below.size else 0.0
    return min(height, ZHURONG.mount.height) if height > LEAST_HEIGHT else ZHURONG.mount.height


def _watched(pairs: Sequence[PredictedPair]) -> Iterator[PredictedPair]:
    return watched(pairs, "pair", "map") if len(pairs) > 1 else iter(pairs)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, MapOptions, "python -m nav.map", __doc__, args, STARTS_OVER)


def _work(options: MapOptions) -> None:
    pairs = find_pairs(options.data)
    folder = ResultFolder(options.out, "map")
    folder.check()
    if (options.out / RECORD).is_file() or (options.out / OF_MANY).is_file():
        raise DatasetError(f"--out {options.out}: holds predictions; choose another")
    for flag, value, given in (
        ("--epsg", options.epsg, options.epsg is not None),
        ("--origin", "{:g} {:g}".format(*options.origin), any(options.origin)),
    ):
        if given and pairs[0].is_on_rover:
            raise ValueError(f"{flag} {value}: {options.data} has no pose in a world; its map is in the rover's frame")
    unrated = [pair.folder for pair in pairs if find_map(pair.folder, "confidence") is None]
    if unrated and options.min_confidence is not None:
        raise ValueError(
            f"--min-confidence {options.min_confidence:g}: {unrated[0]} holds no confidence; m3depth.predict --write "
            "depth confidence writes it"
        )
    count = DepthCount()
    elevation, ground = make_map(pairs, options, count)
    far = (
        f"{100 * count.beyond / max(count.known, 1):.0f} % of the depth lies beyond --max-range {options.max_range:g} m"
    )
    if not elevation.measured.any():
        too_far = count.known > 0 and count.beyond >= MOSTLY * count.known
        reason = f"makes a map: {far}" if too_far else "is sure enough for a map"
        raise DatasetError(f"{options.data}: no depth of up to {options.max_range:g} m {reason}")
    for message in _doubts(pairs, elevation, far if count.beyond > MOSTLY * count.known else None, unrated):
        print(f"warning: {message}", file=sys.stderr)
    poses = np.array([pair.pose for pair in pairs])
    window = window_of(elevation, ground, poses[:, :2, 3], options.origin)
    with folder.claim():
        (options.out / RESULT).unlink(missing_ok=True)  # of an earlier map, whose layers are replaced now
        write_map(options.out, elevation, ground, window, poses, options.epsg, of_rover=pairs[0].is_on_rover)
        write_json(options.out / RESULT, {
            "data": str(options.data), "pairs": len(pairs), "cell_m": options.cell,
            "rows_columns": list(window.shape), "west_south_m": [window.west, window.south],
            "origin_m": list(options.origin), "frame": "rover" if pairs[0].is_on_rover else "world",
            "max_range_m": options.max_range,
            "min_confidence": None if len(unrated) == len(pairs) else elevation.config.min_confidence,
            "epsg": options.epsg,
        }, sort_keys=False)  # fmt: skip
    print(f"{options.out}: {_summary(pairs, elevation, ground)}")


def _doubts(
    pairs: Sequence[PredictedPair], elevation: ElevationMap, far: str | None, unrated: Sequence[Path]
) -> list[str]:
    """Return what speaks against a map.

    Args:
        pairs: The pairs.
        elevation: The heights.
        far: What to say if nearly all depth lies beyond the range.
        unrated: Folders of the pairs without a confidence.
    """
    doubts = []
    if unrated:
        doubts.append(
            f"{counted(len(unrated), 'pair')} of {len(pairs)} have no confidence, as {unrated[0]}, so all their depth "
            "is taken as sure; m3depth.predict --write depth confidence writes it"
        )
    if any(pair.is_assumed for pair in pairs):
        doubts.append(
            f"{pairs[0].folder}: nothing said where the camera is on the rover, so Zhurong's place was assumed, and "
            "heights and distances are from there; give m3depth.predict --mount"
        )
    if far is not None:
        doubts.append(f"{far}: give a larger one")
    area = float(elevation.measured.sum()) * elevation.config.cell**2
    if area < LEAST_AREA:
        doubts.append(f"only {area:.2g} m2 of ground are visible, too little for a rover to stand on")
    return doubts


def _summary(pairs: Sequence[PredictedPair], elevation: ElevationMap, ground: Traversability) -> str:
    """Return what the map shows, in a line."""
    code, area = layers(elevation, ground)["traversability"], elevation.config.cell**2
    heights = elevation.low[elevation.measured]
    low, high = np.percentile(heights, [5, 95])
    visible_area, blocked_area = ((code != UNKNOWN).sum() * area, (code == BLOCKED).sum() * area)
    return (
        f"{counted(len(pairs), 'pair')}; {visible_area:.0f} m2 visible, heights {low:.2f} to {high:.2f} m (5 to 95 %); "
        f"obstacles on {blocked_area:.1f} m2"
    )


if __name__ == "__main__":
    sys.exit(main())
