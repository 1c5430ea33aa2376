"""Stereo datasets by their documented names; `marssim.base.dataset` holds the code."""

from marssim.base.dataset.dataset import (
    DatasetError,
    StereoDataset,
    StereoSample,
    read_sample,
    split_of,
    write_index,
    write_sample,
)

__all__ = [
    "DatasetError",
    "StereoDataset",
    "StereoSample",
    "read_sample",
    "split_of",
    "write_index",
    "write_sample",
]
