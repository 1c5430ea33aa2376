"""Reading and writing of JSON files."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from marssim.base.files.json_file import DatasetError, as_json, json_text, read_json, write_json

RESULT = {"b": 1, "a": [math.nan, 1.5, (math.inf, -math.inf)], "c": {"d": math.nan, "e": "NaN"}}


def test_numbers_that_are_not_finite_become_null(tmp_path):
    """Strict readers, those of browsers among them, refuse NaN and Infinity."""
    file = tmp_path / "new" / "results.json"
    write_json(file, RESULT)
    strict = json.loads(file.read_text(), parse_constant=lambda name: pytest.fail(name))
    assert strict == {"b": 1, "a": [None, 1.5, [None, None]], "c": {"d": None, "e": "NaN"}} == read_json(file)
    assert as_json(RESULT) == strict and json.loads(json_text(RESULT)) == strict


def test_the_order_of_keys_is_sorted_or_kept(tmp_path):
    write_json(tmp_path / "sorted.json", RESULT)
    write_json(tmp_path / "kept.json", RESULT, sort_keys=False)
    assert list(read_json(tmp_path / "sorted.json")) == ["a", "b", "c"]
    assert list(read_json(tmp_path / "kept.json")) == ["b", "a", "c"]
    assert (tmp_path / "sorted.json").read_bytes().endswith(b"\n}\n")


def test_a_text_is_what_json_makes_of_finite_content():
    content = {"x": [1, 2.5, None, True, "a"], "y": {"z": (0.1,)}}
    assert json_text(content, indent=1, sort_keys=True) == json.dumps(content, indent=1, sort_keys=True)


def test_settings_come_back_as_they_are_read():
    assert as_json({"path": Path("a/b"), "pair": (1, 2)}) == {"path": "a/b", "pair": [1, 2]}
    with pytest.raises(TypeError):
        json_text({"path": Path("a/b")})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "is not JSON"), ("[1]", "not a JSON object"), ("\xff", "is not JSON"),
        ('{"a":' * 70 + "1" + "}" * 70, "more than 64"), ("[" * 100_000, "more than 64"),
        (f'{{"a": {"9" * 400}}}', "an integer of 400 digits"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_read_is_named(tmp_path, text, problem):
    file = tmp_path / "broken.json"
    file.write_text(text, encoding="latin-1")
    with pytest.raises(DatasetError, match=rf"^{file}: .*{problem}"):
        read_json(file)
    with pytest.raises(DatasetError, match="no such file"):
        read_json(tmp_path / "none.json")


def test_a_pipe_that_nobody_writes_to_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", Path("/dev/zero")):
        with pytest.raises(DatasetError, match=rf"^{path}: is a pipe or a device, not a file$"):
            read_json(path)


def test_numbers_of_numpy_are_numbers():
    content = {"a": np.int64(2), "b": [np.float32(0.5), np.float64("nan")], "c": np.bool_(True)}
    assert as_json(content) == json.loads(json_text(content)) == {"a": 2, "b": [0.5, None], "c": True}


def test_a_mark_of_the_encoding_is_no_fault(tmp_path):
    (tmp_path / "a.json").write_text('{"a": 1}', encoding="utf-8-sig")
    assert read_json(tmp_path / "a.json") == {"a": 1}
