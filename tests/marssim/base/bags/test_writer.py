"""A bag appears whole or not at all."""

import sys

import pytest

from marssim.base.bags.messages import text_message
from marssim.base.bags.reader import Bag
from marssim.base.bags.writer import BagWriter
from marssim.base.files.json_file import DatasetError


def write(path, text, **flags):
    with BagWriter(path, **flags) as bag:
        bag.write("/said", 5, text_message(text))


def said(path):
    return [message.data for _, message in Bag(path).messages(["/said"])]


def test_an_exception_leaves_no_bag(tmp_path):
    with pytest.raises(KeyError), BagWriter(tmp_path / "bag") as bag:
        bag.write("/said", 5, text_message("half"))
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_a_bag_is_replaced_only_where_that_is_asked_for_and_by_a_whole_one(tmp_path):
    write(tmp_path / "bag", "first")
    with pytest.raises(DatasetError, match="bag: is there already; choose another folder"):
        write(tmp_path / "bag", "second")
    with pytest.raises(KeyError), BagWriter(tmp_path / "bag", replace=True):
        raise KeyError
    assert said(tmp_path / "bag") == ["first"]
    write(tmp_path / "bag", "second", replace=True)
    assert said(tmp_path / "bag") == ["second"] and [p.name for p in tmp_path.iterdir()] == ["bag"]


def test_the_files_do_not_depend_on_the_run(tmp_path):
    for folder in "ab":
        write(tmp_path / folder / "bag", "same")
    first, second = (sorted((tmp_path / folder / "bag").iterdir()) for folder in "ab")
    assert [p.name for p in first] == ["bag.mcap", "metadata.yaml"]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_without_rosbags_one_line_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags", None)
    for work in (BagWriter, Bag):
        with pytest.raises(
            ImportError, match=r'need rosbags, which is not installed; pip install "mars-m3depth\[real\]"'
        ):
            work(tmp_path / "bag")


@pytest.mark.parametrize("replace", [False, True])
def test_a_bag_that_cannot_be_finished_does_not_appear_and_an_earlier_one_stays(tmp_path, monkeypatch, replace):
    if replace:
        write(tmp_path / "bag", "first")
    bag = BagWriter(tmp_path / "bag", replace=replace)
    bag.write("/said", 5, text_message("second"))
    plain = bag._writer.close

    def full():
        plain()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bag._writer, "close", full)
    with pytest.raises(OSError, match="No space left"), bag:
        pass
    assert [file.name for file in tmp_path.iterdir()] == ["bag"] * replace
    assert not replace or said(tmp_path / "bag") == ["first"]
