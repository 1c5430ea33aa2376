"""Predict depth, normals and point clouds of rectified stereo pairs: of one, a folder, a list, a video or a bag.

    python -m m3depth.predict left.png right.png --focal 595.9 --baseline 0.27 --out RESULT
    python -m m3depth.predict image_2/000000_10.png image_3/000000_10.png --calib calib.txt --out RESULT
    python -m m3depth.predict left.png right.png --calib left.yaml right.yaml --out RESULT      # ROS CameraInfo
    python -m m3depth.predict --left 'drive/*_L.png' --right 'drive/*_R.png' --calib calib.yml --out RESULT
    python -m m3depth.predict DATASET --split test --out RESULT     # layouts as in m3depth.evaluate
    python -m m3depth.predict pairs.txt --calib calib.yml --out RESULT          # lines of "left right"
    python -m m3depth.predict left.mp4 right.mp4 --calib calib.yml --out RESULT # or one video, eyes side by side
    python -m m3depth.predict BAG --out RESULT                                  # a ROS 2 bag with CameraInfo
    python -m m3depth.predict NLMV0709_...IMG --out RESULT          # products of rovers: one, two or a folder of them
    python -m m3depth.predict left.png right.png --calib stereo.yml --out RESULT    # raw images: K1 D1 K2 D2 R T
    python -m m3depth.predict left.png right.png --align --focal 1236 --baseline 0.42 --out RESULT   # no calibration

The images must be rectified: what the left eye sees at a pixel, the right eye sees in the same row, farther left. Those
that are not are rectified first, as m3depth.rectify does it, if they are products of rovers, if the calibration is of
raw cameras alone (OpenCV's K1 D1 K2 D2 R T, Kalibr, labels), or with --rectify always. --align fits their rows to
matches, where the calibration is not quite right or where there is none. The command reports exchanged eyes, rows that
lie apart and images without contrast. Where the result would be meaningless, it writes nothing and exits with 2, or
skips that one of many pairs; --unchecked writes it nevertheless. Rows that lie a little apart, as in a rig whose
calibration has aged, it aligns by turning the right image.

A calibration file (KITTI, Middlebury, ETH3D, OpenCV's stereoRectify, ROS CameraInfo, a rig file of marssim or a
dataset's sample.json) gives the focal lengths, the principal point and the baseline; flags beside it replace its
values. The command writes into RESULT, or for many pairs into a folder of each in RESULT:

    depth.npy          float32 [m]; inf: sky, or too far to be measured; NaN: unknown
    depth.png          uint16 [mm]; 0: none, or farther than 65.5 m
    disparity.npy      float32 [px], f B / depth; it includes the difference of the eyes' principal points (doffs)
    disparity.png      uint16, disparity times 256; 0: none, or 256 px and more
    normal.npy         float32, camera frame (x right, y down, z forward); 0 0 0: none (sky, or unknown)
    normal.png         uint16, red right, green up, blue to the camera: red is (1 + x) / 2 times 65535; black: none
    confidence.npy     float32, 0 to 1; 0: unknown
    confidence.png     uint16, confidence times 65535
    sky.png            uint8, 255: sky, or too far to be measured; 0: ground, or unknown
    left_right.npy     float32 [px], with --left-right: difference of both eyes' disparities; NaN: not compared
    cloud.ply          coloured points [m], camera frame, without points that hang between two surfaces
    figure.png         image, depth, normals and confidence; grey: sky, or farther than the scale; black: unknown
    steps.png          with --steps: depth after each refinement step, and what the step changed
    rectified/         for raw images: what m3depth.rectify writes; the maps are of the left image in it
    prediction.json    method, SHA-256 of its weights, runtime, rig, what was done to the rows, versions of packages

--view shows the clouds on a page in the browser at the end.

--map-format also writes .tiff and .pfm; a PFM has inf for unknown. Many pairs give in RESULT:

    overview.jpg       pictures of up to 20 pairs
    video.mp4          the pictures of all pairs, for a video, a bag or with --video
    bag/               for a ROS 2 bag as source: another one, of depth, DisparityImage and PointCloud2
    fused_cloud.ply    the points of all pairs in one world, for pairs with poses
    predictions.json   the settings; the same command goes on where an earlier one was stopped or killed
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from m3depth.estimator import Estimator
from m3depth.prediction.batch import (
    MARK,
    BatchOutcome,
    cloud_pose,
    ending,
    mount_warnings,
    predict_many,
    read_and_prepare,
    record_of,
)
from m3depth.prediction.files import files_in, single_folder, write_prediction
from m3depth.prediction.left_right import AGREEMENT
from m3depth.prediction.one_pair import Method, PairPrediction, predict_pair
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.pictures.figure import depth_range_shown
from m3depth.prediction.shots import predicted_shots
from m3depth.prediction.sources.inputs import Inputs, find_inputs
from m3depth.prediction.sources.pair_input import PairInput
from m3depth.prediction.sources.raw_pairs import FOLDER
from m3depth.stereo.prediction import Prediction
from marssim.base.command.run import run_command
from marssim.base.command.wording import GOES_ON, counted
from marssim.base.view.show import check_viewer, show


def predict(options: PredictOptions, estimator: Estimator | None = None) -> Prediction | BatchOutcome:
    """Read the pairs, predict, write the files, and print a summary in one line; warnings go to stderr.

    Args:
        options: The command's flags.
        estimator: A method to use instead of the one that the flags name.

    Returns:
        The maps of one pair, as they are written; for a source of many pairs, which of them have results.

    Raises:
        FileNotFoundError: A file is missing; nothing was written.
        ImportError: An extra is missing: `real` for a product or a bag, or that of the method or of --view.
        ValueError: A flag or the pair cannot be used; nothing was written.
    """
    if options.view:
        check_viewer()
    inputs = find_inputs(options)
    options = inputs.remaining(options)
    if inputs.single:
        if options.video:
            raise ValueError("--video is of many pairs, and this is a single one")
        prediction = _predict_one(options, inputs, estimator)
        _view(options, inputs, inputs.pairs)
        return prediction
    batch = predict_many(options, inputs, estimator)
    line = f"{len(batch.done)} of {counted(len(inputs.pairs), 'pair')}"
    if batch.skipped:
        line = f"{line}; {len(batch.skipped)} skipped, see the warnings"
    print(f"{options.out}: {line}")
    done = set(batch.done)
    _view(options, inputs, [pair for pair in inputs.pairs if pair.name in done])
    return batch


def _view(options: PredictOptions, inputs: Inputs, pairs: Sequence[PairInput]) -> None:
    """Show predicted pairs in the browser if --view says so."""
    if options.view:
        show(predicted_shots(options, inputs, pairs), options.out.resolve().name)


def _predict_one(options: PredictOptions, inputs: Inputs, estimator: Estimator | None) -> Prediction:
    """Predict one pair into --out itself. Raises as `predict` does."""
    (pair,) = inputs.pairs
    folder = single_folder(options.out)
    folder.check()
    if (options.out / MARK).is_file():
        raise ValueError(f"--out {options.out}: holds predictions of many pairs; choose another")
    read, prepared = read_and_prepare(inputs, pair, options)
    method = Method.from_options(options, estimator)
    record = record_of(read, inputs, prepared.rig, method, options)
    for message in (*prepared.warnings, *mount_warnings(record, options)):
        print(f"warning: {message}", file=sys.stderr)
    result = predict_pair(prepared, method, options)
    shown = depth_range_shown(result.prediction.depth)
    with folder.claim() as previous:
        record |= ending(result, shown)
        earlier = files_in(options.out)
        count = write_prediction(
            options.out, result, options, record, shown, cloud_pose(record), single=True, replaces=previous is not None
        )
    if deleted := [name for name in earlier if not (options.out / name).exists()]:
        print(f"note: {options.out}: deleted {', '.join(deleted)} of the earlier prediction", file=sys.stderr)
    if result.rectified is not None:
        print(f"{options.out / FOLDER}: {result.rectified.summary()}")
    print(f"{options.out}: {_summary(result, count if 'cloud' in options.write else None)}")
    return result.prediction


def _summary(result: PairPrediction, points: int | None) -> str:
    """Return the depths of a prediction, and what was done to the rows, in a line.

    Args:
        result: The prediction.
        points: Number of points of the cloud; None without one.
    """
    valid = np.isfinite(result.prediction.depth)
    depths = "no depth"
    if valid.any():
        low, middle, high = np.percentile(result.prediction.depth[valid], [5, 50, 95])
        depths = f"depth {low:.2f} to {high:.2f} m (5 to 95 %), median {middle:.2f} m"
    line = f"{depths} on {100 * valid.mean():.0f} % of the pixels"
    if points is not None:
        line = f"{line}; {counted(points, 'point')}"
    if result.removed is not None:
        line = f"{line}; rows aligned, which lay apart by {result.removed}"
    if result.compared == 0:
        return line
    share = 100 * result.agreeing / result.compared
    return f"{line}; the eyes agree within {AGREEMENT:g} px on {share:.1f} % of what is compared"


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user, and for images that are no pair."""
    interrupted = f"{GOES_ON}; of a single pair, it starts over"
    return run_command(predict, PredictOptions, "python -m m3depth.predict", __doc__, args, interrupted)


if __name__ == "__main__":
    sys.exit(main())
