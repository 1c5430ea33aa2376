"""Predicted pairs as the browser's viewer shows them, read from the files that predict wrote."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.datasets.image_files import read_pair
from m3depth.prediction.files import RECORD, trusted_pixels
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.inputs import Inputs
from m3depth.prediction.sources.pair_input import PairInput
from m3depth.prediction.sources.video_frames import VideoFrames
from m3depth.stereo.pairs import in_colour
from marssim.base.camera import StereoRig
from marssim.base.dataset.map_file import MapKind, find_map, read_map_file
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.pose import ROVER_KEY
from marssim.base.view.clouds import view_of_maps
from marssim.base.view.scene import Shot, View


def predicted_shots(options: PredictOptions, inputs: Inputs, pairs: Sequence[PairInput]) -> list[Shot]:
    """Return what a page shows of predicted pairs, in the world of their poses, or in the frame of the rover.

    Args:
        options: The command's flags; they choose the points as those of the point clouds.
        inputs: All pairs.
        pairs: Those that have results.

    Raises:
        DatasetError: A prediction.json is missing or broken; the message names it.
    """
    shots = []
    for pair in pairs:
        record = read_json(options.out / pair.name / RECORD)
        pose = record[ROVER_KEY] if record["pose"] is None else record["pose"]
        # pairs without poses have no common world
        world = f"{record['world']}" if record["pose"] is not None else pair.name
        name = pair.name or pair.given[0].name
        shots.append(Shot(name, np.array(pose, float), partial(_view, options, inputs, pair, record), world))
    return shots


def _view(options: PredictOptions, inputs: Inputs, pair: PairInput, record: dict[str, Any]) -> View:
    folder, rig = options.out / pair.name, StereoRig.from_dict(record["rig"])
    depth = _read(folder, "depth")
    if depth is None:
        raise DatasetError(f"{folder}: holds no depth; delete it, and predict this pair again")
    normal, confidence = _read(folder, "normal"), _read(folder, "confidence")
    sure = np.ones_like(depth) if confidence is None else confidence
    keep = trusted_pixels(rig.depth_to_disparity(depth), sure, options.cloud_confidence)
    near, far = record["depth_shown_m"]
    view, _ = view_of_maps(
        rig, np.where(keep, depth, np.float32(np.nan)), _left_image(inputs, pair), normal, confidence,
        scale=(near, far), farthest=options.max_range,
    )  # fmt: skip
    return replace(view, note=f"depth by {record['estimator']}")


def _read(folder: Path, kind: MapKind) -> np.ndarray | None:
    path = find_map(folder, kind)
    return None if path is None else read_map_file(path, kind)


def _left_image(inputs: Inputs, pair: PairInput) -> np.ndarray:
    """Return the left image of a pair, (H, W, 3) uint8; a video is read from its beginning, as it cannot go back."""
    if pair.raw is not None:
        return in_colour(read_pair(pair.left, pair.right)[0])
    if isinstance(inputs.recording, VideoFrames):
        inputs = replace(inputs, recording=VideoFrames(inputs.recording.paths))
    return in_colour(inputs.read(pair).left)
