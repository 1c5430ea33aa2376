"""Stereo datasets, by their documented names. The code is in `marssim.base.dataset`."""

from marssim.base.dataset.dataset import StereoDataset, split_of, write_index
from marssim.base.dataset.sample import StereoSample, read_sample, write_sample
from marssim.base.files.json_file import DatasetError

__all__ = [
    "DatasetError",
    "StereoDataset",
    "StereoSample",
    "read_sample",
    "split_of",
    "write_index",
    "write_sample",
]
