"""Patterns that name the files of a folder."""

import pytest

from m3depth.datasets.folders import matches
from marssim.base.files.json_file import DatasetError


def test_brackets_in_a_pattern_stand_for_themselves(tmp_path):
    for name in ("sol[3]/a_L.png", "sol[3]/b_L.png", "sol3/c_L.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = matches(tmp_path, "sol[3]/*_L.png")
    assert {keys: path.name for keys, path in found.items()} == {("a",): "a_L.png", ("b",): "b_L.png"}
    with pytest.raises(DatasetError, match="no file matches"):
        matches(tmp_path, "sol[4]/*_L.png")
