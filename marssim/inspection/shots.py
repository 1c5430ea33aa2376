"""Pairs of a dataset with their ground truth as the browser's viewer shows them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from marssim.base.dataset.sample import read_sample
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.pose import recorded_pose
from marssim.base.view.clouds import FARTHEST, view_of_maps
from marssim.base.view.scene import Shot, View


def dataset_shots(root: Path, names: Sequence[str], farthest: float = FARTHEST) -> list[Shot]:
    """Return what a page shows of samples; those of one scene are in one world.

    Args:
        root: Folder of the dataset.
        names: Names of the samples, SCENE/VIEW.
        farthest: Largest depth of their points [m].

    Raises:
        DatasetError: There are no samples, or one records no pose; the message names the file.
    """
    if not names:
        raise DatasetError(f"{root}: holds no pairs to show")
    shots = []
    for name in names:
        file = root / "scenes" / name / "sample.json"
        recorded = read_json(file).get("pose")
        try:
            pose = recorded_pose(recorded)
        except ValueError as error:
            raise DatasetError(f"{file}: {error}") from None
        shots.append(Shot(name, pose, partial(_view, file.parent, farthest), name.partition("/")[0]))
    return shots


def _view(folder: Path, farthest: float) -> View:
    sample = read_sample(folder)
    # the rover itself, in view, is no part of the ground
    depth = np.where(sample.rock < 0, np.float32(np.nan), sample.depth)
    return view_of_maps(sample.rig, depth, sample.left, sample.normal, farthest=farthest)[0]
