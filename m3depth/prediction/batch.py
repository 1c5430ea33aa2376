"""Many pairs, one after the other: the next one is read and checked, and the last one written, while one is predicted.

Memory does not grow with the number of pairs. Each pair has a folder, whose prediction.json is written last: a run that
was stopped or killed continues with the first pair without one.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from m3depth.checked_inference import errors_at
from m3depth.estimator import Estimator, EstimatorName
from m3depth.prediction.files import RECORD, write_prediction
from m3depth.prediction.one_pair import Method, PairPrediction, PreparedPair, method_record, predict_pair, prepare
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.overview import FUSED, RATE, write_fused_cloud, write_sheet, write_video
from m3depth.prediction.pictures.figure import depth_range_shown
from m3depth.prediction.pictures.step_figure import steps_record
from m3depth.prediction.result_bag import write_bag
from m3depth.prediction.sources.bag_pairs import BagPairs
from m3depth.prediction.sources.calibration import make_calibration
from m3depth.prediction.sources.inputs import Inputs
from m3depth.prediction.sources.pair_input import PairInput
from m3depth.prediction.sources.poses import ASSUMED_KEY, MOUNT_ASSUMED
from m3depth.prediction.sources.video_frames import EndOfVideo
from marssim.base.calibration.rectified import SHIFT_KEY
from marssim.base.camera import StereoRig
from marssim.base.command.progress import watched
from marssim.base.command.run import describe
from marssim.base.command.signals import stop_on_signal
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.pose import ROVER_KEY
from marssim.base.results.claim import PARTIAL, ResultFolder
from marssim.base.results.code_state import source_digest, versions

MARK = "predictions.json"  # settings of the pairs in a folder
PERCENTILES = (5, 50, 95)  # of depth, in the record
THOROUGH = 10  # every pair of this number is matched both ways round to check it
NOT_SETTINGS = (
    "images", "out", "weights", "estimator", "left", "right", "poses", "calib", "raw", "mask", "voxel", "video", "view",
    "device",  # which the runtime names
)  # fmt: skip


class NoResult(ValueError):
    """No pair can be used."""


class WrongCalibration(ValueError):
    """The calibration of a pair cannot be used."""


@dataclass
class BatchOutcome:
    """What became of the pairs.

    Attributes:
        done: Names of the pairs that have results, in order.
        skipped: Why the others have none, by name.
        resumed: How many were done by an earlier run.
    """

    done: list[str] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    resumed: int = 0


def batch_folder(options: PredictOptions, inputs: Inputs, estimator: Estimator | None = None) -> ResultFolder:
    """Return the folder of many pairs, which only the same settings and the same method continue."""
    method = method_record(options, estimator)
    is_of_weights = estimator is None and EstimatorName(method["estimator"]).weights is not None
    of_files = "weights" if is_of_weights else "Files of the method"
    settings = {
        **{name: _plain(value) for name, value in vars(options).items() if name not in NOT_SETTINGS},
        **vars(options.raw),
        "estimator": method["estimator"], of_files: method.get("sha256"), "runtime": method.get("runtime"),
        **inputs.state(),
        "Code": source_digest(("marssim", "m3depth")),
    }  # fmt: skip
    digests = ("images", "calibration, masks and poses")
    return ResultFolder(
        options.out, "prediction", MARK, settings, digests=digests, has_results=_has_results,
        partial=(f"**/{PARTIAL}",), notes=("pairs",),
    )  # fmt: skip


def _has_results(folder: Path) -> bool:
    return next(folder.rglob(RECORD), None) is not None


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def read_and_prepare(
    inputs: Inputs, pair: PairInput, options: PredictOptions, thorough: bool = True
) -> tuple[PairInput, PreparedPair]:
    """Read a pair, check it, and align it.

    Args:
        inputs: All pairs.
        pair: The pair.
        options: The command's flags that remain for pairs that are read.
        thorough: See `prepare`.

    Returns:
        The pair as it is read, and as the method sees it.

    Raises:
        WrongCalibration: The calibration cannot be used; the message names it.
        ValueError, OSError: The pair cannot be used; the message names a file.
        EndOfVideo: The video ends before this pair.
    """
    read = inputs.read(pair)
    height, width = read.left.shape[:2]
    try:
        calibration = make_calibration(options, height, width, pair.given[0], read.pair.calibration)
    except (ValueError, FileNotFoundError) as error:
        raise WrongCalibration(str(error)) from None
    checked = read.rectified
    if checked is not None and checked.pair.view is None:
        checked = checked.with_scale(calibration)
    return read.pair, prepare(
        read.left, read.right, calibration, options, inputs.labels(pair), inputs.files(pair), thorough, read.valid,
        checked,
    )  # fmt: skip


def record_of(
    pair: PairInput, inputs: Inputs, rig: StereoRig, method: Method, options: PredictOptions
) -> dict[str, Any]:
    """Return what prediction.json holds but what was done to the rows.

    Args:
        pair: The pair, as it is read.
        inputs: All pairs.
        rig: The cameras.
        method: The method.
        options: The command's flags.

    Raises:
        ValueError: The clouds should be in the world or on the rover, and the pair has no pose there.
    """
    pose = inputs.pose(pair, rig, options)
    if pose is None and options.cloud_frame == "world":
        name = pair.name or str(pair.given[0])
        raise ValueError(f"{name}: has no pose, which --cloud-frame world needs: give --poses")
    if options.cloud_frame == "rover" and inputs.lacks_frames(pair):
        raise ValueError(
            f"{pair.name}: the frames of the bag do not say where the camera is on the rover at this time, which "
            "--cloud-frame rover needs"
        )
    return {
        **method.record,
        "left": str(pair.left), "right": str(pair.right),
        **({} if pair.raw is None else {"raw": [str(path) for path in pair.raw]}),
        **({} if inputs.recording is None else inputs.recording.record(pair.number)),
        "rig": rig.to_dict(),
        ROVER_KEY: inputs.on_rover(pair, rig, options).tolist(),
        ASSUMED_KEY: inputs.is_mount_assumed(pair, options),
        "pose": None if pose is None else pose.tolist(),
        "world": pair.group or None,
        "cloud_frame": options.cloud_frame,
    }  # fmt: skip


def mount_warnings(record: Mapping[str, Any], options: PredictOptions) -> list[str]:
    """Return a warning if the clouds or the poses of a pair depend on an assumed place of the cameras on the rover.

    Args:
        record: As of record_of.
        options: The command's flags.
    """
    matters = options.cloud_frame == "rover" or (options.poses is not None and options.pose_axes == "camera")
    return [MOUNT_ASSUMED] if matters and record[ASSUMED_KEY] else []


def cloud_pose(record: dict[str, Any]) -> np.ndarray:
    """Return the pose of the camera in the frame of the point cloud, (4, 4)."""
    frame = record["cloud_frame"]
    return np.eye(4) if frame == "camera" else np.array(record["pose" if frame == "world" else ROVER_KEY])


def ending(result: PairPrediction, shown: tuple[float, float]) -> dict[str, Any]:
    """Return what prediction.json says last: rows, what the maps hold, refinement steps, the scale shown, versions."""
    removed = None if result.removed is None else result.removed.to_dict()
    depth = result.prediction.depth[np.isfinite(result.prediction.depth)]
    percentiles = None
    if depth.size:
        values = np.percentile(depth, PERCENTILES)
        percentiles = {f"percentile_{p}": round(float(v), 4) for p, v in zip(PERCENTILES, values, strict=True)}
    agreeing = round(result.agreeing / result.compared, 4) if result.compared else None
    steps = {"steps": steps_record(result.steps)} if result.steps else {}
    return {
        SHIFT_KEY: result.shift,
        "rows_aligned": removed,
        "depth_m": percentiles,
        "share_with_depth": round(depth.size / result.prediction.depth.size, 4),
        "eyes_agree_share": agreeing,
        **steps,
        "depth_shown_m": list(shown),
        "versions": versions(),
    }


def predict_many(options: PredictOptions, inputs: Inputs, estimator: Estimator | None = None) -> BatchOutcome:
    """Predict all pairs that have no results yet, and write what shows all of them.

    A pair that cannot be used is skipped with a warning.

    Args:
        options: The command's flags.
        inputs: The pairs.
        estimator: The method; None for the one that the flags name, which is loaded if there is a pair to predict.

    Raises:
        DatasetError: The folder holds results of other settings, or something else.
        ValueError: No pair can be used.
        KeyboardInterrupt: After a signal (stop_on_signal), once the pairs at work are written.
    """
    folder = batch_folder(options, inputs, estimator)
    folder.check()
    if options.cloud_frame == "world" and not any(map(inputs.has_pose, inputs.pairs)):
        raise ValueError("--cloud-frame world needs poses: give --poses")
    is_whole = all(_is_done(options, pair) for pair in inputs.pairs)
    method = None if is_whole else Method.from_options(options, estimator)
    with folder.claim(pairs=len(inputs.pairs)), stop_on_signal() as signals:
        try:
            batch = _predict_remaining(options, inputs, method, signals)
            if not (batch.done or signals):
                raise NoResult(f"no pair of {len(inputs.pairs)} can be used, see the warnings")
        except (WrongCalibration, NoResult):
            if not _has_results(options.out):
                folder.mark_path.unlink(missing_ok=True)  # so that nothing is left of a new folder
            raise
        if signals:
            raise KeyboardInterrupt
        folder.note(pairs=len(batch.done) + len(batch.skipped))  # a video may end before its header says
        _write_overview(options, inputs, batch)
    return batch


def _predict_remaining(
    options: PredictOptions, inputs: Inputs, method: Method | None, signals: Sequence[int]
) -> BatchOutcome:
    """Predict the pairs that have no results. The next pair is read, and the last one written, at the same time."""
    rest = [pair for pair in inputs.pairs if not _is_done(options, pair)]
    batch = BatchOutcome(resumed=len(inputs.pairs) - len(rest))
    if batch.resumed:
        print(
            f"predict: {batch.resumed} of {counted(len(inputs.pairs), 'pair')} are predicted already", file=sys.stderr
        )
    shown = _depth_shown(options, inputs)

    def ready(pair: PairInput) -> tuple[PairInput, PreparedPair]:
        thorough = pair.number // options.every % THOROUGH == 0
        return read_and_prepare(inputs, pair, options, thorough)

    with ThreadPoolExecutor(1) as reader, ThreadPoolExecutor(1) as pool:
        writer = _Writer(pool)
        warned: list[str] = []
        for pair, prepared in zip(watched(rest, "pair", "predict"), _ahead(reader, ready, rest)):
            assert method is not None
            try:
                read, work = prepared.result()
                record = record_of(read, inputs, work.rig, method, options)
            except EndOfVideo:
                _warn(f"the video ends at {pair.name}, before its header says")
                break
            except (ValueError, OSError) as error:
                if isinstance(error, WrongCalibration) and shown is None:
                    raise  # it is most likely that of all pairs
                if len(inputs.pairs) == 1:
                    raise NoResult(describe(error)) from None
                batch.skipped[pair.name] = describe(error)
                _warn(f"{pair.name} is skipped: {describe(error)}")
                continue
            if not warned:
                warned = mount_warnings(record, options)
                for message in warned:
                    _warn(message)
            for message in work.warnings:
                _warn(f"{pair.name}: {message}")
            with errors_at(f"pair {pair.name}"):
                result = predict_pair(work, method, options)
            if shown is None:
                shown = depth_range_shown(result.prediction.depth)
            record |= ending(result, shown)
            writer.write(options.out / pair.name, result, options, record, shown, cloud_pose(record))
            if signals:
                break
        writer.wait()
    batch.done = [pair.name for pair in inputs.pairs if _is_done(options, pair)]
    return batch


def _depth_shown(options: PredictOptions, inputs: Inputs) -> tuple[float, float] | None:
    """Return the range of depth [m] that the pictures of an earlier run show; None where it wrote none."""
    for pair in inputs.pairs:
        if _is_done(options, pair):
            file = options.out / pair.name / RECORD
            shown = read_json(file).get("depth_shown_m")
            if not isinstance(shown, list) or [type(value) in (int, float) for value in shown] != [True, True]:
                raise DatasetError(f"{file}: depth_shown_m must be two numbers; delete the file to repeat the pair")
            return shown[0], shown[1]
    return None


def _warn(message: str) -> None:
    tqdm.write(f"warning: {message}", file=sys.stderr)


class _Writer:
    """Writes the prediction of a pair in a thread, while the next pair is predicted."""

    def __init__(self, pool: ThreadPoolExecutor) -> None:
        self._pool = pool
        self._pending: Future[int] | None = None

    def write(self, *arguments: Any) -> None:
        """Write a prediction, once the one before is written. Arguments are those of write_prediction."""
        self.wait()
        self._pending = self._pool.submit(write_prediction, *arguments)

    def wait(self) -> None:
        """Wait for the last prediction, and raise what kept it from being written."""
        if self._pending is not None:
            self._pending.result()


def _is_done(options: PredictOptions, pair: PairInput) -> bool:
    return (options.out / pair.name / RECORD).is_file()


def _ahead(
    pool: ThreadPoolExecutor, make: Callable[[PairInput], tuple[PairInput, PreparedPair]], pairs: Sequence[PairInput]
) -> Iterator[Future[tuple[PairInput, PreparedPair]]]:
    """Yield what becomes of each pair, while the next one is made."""
    waiting: deque[Future[tuple[PairInput, PreparedPair]]] = deque()
    for pair in pairs:
        waiting.append(pool.submit(make, pair))
        if len(waiting) > 1:
            yield waiting.popleft()
    yield from waiting


def _write_overview(options: PredictOptions, inputs: Inputs, batch: BatchOutcome) -> None:
    """Write the sheet, the video, the bag and the fused cloud that the flags ask for."""
    if "figure" in options.write:
        write_sheet(options.out, batch.done)
        if options.video or inputs.recording is not None:
            rate = 0.0 if inputs.recording is None else inputs.recording.rate / options.every
            write_video(options.out, batch.done, rate or RATE)
    if "bag" in options.write and isinstance(inputs.recording, BagPairs):
        write_bag(options.out, inputs.recording, batch.done, options.cloud_frame)
    if "cloud" in options.write:
        done = set(batch.done)
        posed = [pair for pair in inputs.pairs if pair.name in done and inputs.has_pose(pair)]
        if len({pair.group for pair in posed}) == 1:
            write_fused_cloud(options.out, [pair.name for pair in posed], options.voxel)
            if len(posed) < len(done):
                without = counted(len(done) - len(posed), "pair")
                print(f"note: {FUSED} lacks {without} of {len(done)}, which have no pose", file=sys.stderr)
