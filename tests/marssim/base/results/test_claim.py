"""How a command claims the folder of its results, and which folders it refuses."""

import errno
import json
import math
import os
from contextlib import nullcontext

import pytest

from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.results import lock
from marssim.base.results.claim import ResultFolder, as_typed, differences
from marssim.base.results.lock import FolderInUse, sole_writer

SETTINGS = {"seed": 3, "goal_distance": 20.0, "rocks": {"k": [0.1, 0.2]}}


def folder_of(path, **changes):
    return ResultFolder(path, "drive", **{"mark": "drive.json", "settings": SETTINGS, "notes": ("times",), **changes})


def claimed(path, **changes):
    with folder_of(path, **changes).claim() as previous:
        return previous


def test_a_new_folder_gets_the_settings_and_the_same_settings_go_on(tmp_path):
    out = tmp_path / "a" / "b"
    with folder_of(out).claim(times=[1]) as previous:
        assert previous is None and read_json(out / "drive.json") == {**SETTINGS, "times": [1]}
    folder = folder_of(out, settings={**SETTINGS, "goal_distance": 20, "rocks": {"k": (0.1, 0.2)}})
    with folder.claim(times=[2]) as previous:
        assert previous == {**SETTINGS, "times": [1]} == read_json(out / "drive.json")
        folder.note(times=[1, 2])
    assert read_json(out / "drive.json") == {**SETTINGS, "times": [1, 2]}
    assert [file.name for file in out.iterdir()] == ["drive.json"]


def test_other_settings_are_refused_with_both_values_and_nothing_is_written(tmp_path):
    claimed(tmp_path)
    before = (tmp_path / "drive.json").read_bytes()
    message = r"drive\.json: the drive in this folder has other settings \({}\); choose another --out$"
    for change, other in (
        ({"seed": 4, "drift": 0.1}, "--seed 3, not 4; --drift none, not 0.1"),
        ({"rocks": {"k": [0.1, 0.3]}, "seed": None}, "--seed 3, not none; --rocks.k 0.1 0.2, not 0.1 0.3"),
        ({"scene": "x" * 90, "a": 1, "b": 1, "c": 1, "d": 1},
         r"--scene none, not x{30}\.\.\.x{30}; --a none, not 1; --b none, not 1; and 2 more"),
    ):  # fmt: skip
        with pytest.raises(DatasetError, match=message.format(other)):
            claimed(tmp_path, settings={**SETTINGS, **change})
    assert (tmp_path / "drive.json").read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_a_digest_that_differs_is_called_other_data(tmp_path):
    claimed(tmp_path, settings={"sha256": "1" * 64, "seed": 1}, digests=("sha256",))
    with pytest.raises(DatasetError, match=r"other settings \(--seed 1, not 2; other data\); choose"):
        claimed(tmp_path, settings={"sha256": "2" * 64, "seed": 2}, digests=("sha256",))


def test_settings_that_are_not_finite_are_continued(tmp_path):
    """JSON has no infinity, so it is written as null."""
    settings = {"farthest": math.inf}
    claimed(tmp_path, settings=settings)
    assert json.loads((tmp_path / "drive.json").read_text()) == {"farthest": None}
    assert claimed(tmp_path, settings=settings) is not None
    (tmp_path / "drive.json").write_text('{"farthest": Infinity}')  # as earlier versions wrote it
    assert claimed(tmp_path, settings=settings) is not None


def test_settings_without_results_are_replaced(tmp_path):
    def has_results(out):
        return (out / "done").exists()

    claimed(tmp_path, has_results=has_results)
    assert claimed(tmp_path, has_results=has_results) is None
    assert claimed(tmp_path, has_results=has_results, settings={"seed": 4}) is None
    assert read_json(tmp_path / "drive.json") == {"seed": 4}
    (tmp_path / "done").touch()
    assert claimed(tmp_path, has_results=has_results, settings={"seed": 4}) == {"seed": 4}
    with pytest.raises(DatasetError, match="--seed 4, not 3"):
        claimed(tmp_path, has_results=has_results)


def test_a_folder_of_something_else_is_refused_unless_it_may_be_shared(tmp_path):
    (tmp_path / ".lock").touch()
    (tmp_path / ".drive.json.77.part").touch()  # of a run that was killed as it began
    claimed(tmp_path)
    (tmp_path / "drive.json").unlink()
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DatasetError, match=rf"^--out {tmp_path}: the folder is not empty and holds no drive of this"):
        claimed(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.tex"]
    claimed(tmp_path, shared=True)
    (tmp_path / "drive.json").unlink()
    with pytest.raises(DatasetError, match=r"drive\.json: no such file, so another command wrote the files"):
        claimed(tmp_path, shared=True, has_results=lambda out: True)


def test_results_of_another_command_are_not_replaced(tmp_path):
    (tmp_path / "results.json").write_text('{"mine": 1}')
    with pytest.raises(DatasetError, match=r"its results\.json is of another command"):
        claimed(tmp_path, mark=None, results_key="by_step")
    claimed(tmp_path, mark=None, results_key="mine")
    assert [file.name for file in tmp_path.iterdir()] == ["results.json"]


def test_a_text_marks_a_folder_whose_results_are_replaced(tmp_path):
    assert claimed(tmp_path, mark="MINE.txt", mark_text="made by a test\n") is None
    assert (tmp_path / "MINE.txt").read_text() == "made by a test\n"
    (tmp_path / "old.png").touch()
    assert claimed(tmp_path, mark="MINE.txt", mark_text="made by a test\n") == {}


def test_half_written_files_of_a_killed_run_are_deleted(tmp_path):
    claimed(tmp_path)
    (tmp_path / ".results.json.123.part").touch()
    (tmp_path / "scenes" / ".00.partial").mkdir(parents=True)
    for kept in ("results.part", ".mine.part", ".bashrc"):
        (tmp_path / kept).touch()
    claimed(tmp_path)
    assert not (tmp_path / ".results.json.123.part").exists()
    assert {file.name for file in tmp_path.iterdir()} >= {"results.part", ".mine.part", ".bashrc", "scenes"}
    claimed(tmp_path, partial=("scenes/.*",))
    assert not list((tmp_path / "scenes").iterdir())
    (tmp_path / "others").mkdir()
    (tmp_path / "others" / "file").touch()
    (tmp_path / ".a.1.part").symlink_to(tmp_path / "others", target_is_directory=True)
    claimed(tmp_path)
    assert not (tmp_path / ".a.1.part").is_symlink() and (tmp_path / "others" / "file").exists()


@pytest.mark.parametrize("pattern", ["scenes/*/.*", "**/.*", "scenes/*/drawn/.*"])
@pytest.mark.parametrize("link", ["scenes", "scenes/1"])
def test_nothing_is_deleted_through_a_link_in_place_of_a_folder(tmp_path, pattern, link):
    out, others = tmp_path / "out", tmp_path / "others"
    claimed(out)
    (others / "1").mkdir(parents=True)
    (out / link).parent.mkdir(parents=True, exist_ok=True)
    for kept in (others / ".bashrc", others / "1" / ".ssh"):
        kept.touch()
    (out / link).symlink_to(others)
    with pytest.raises(DatasetError, match=rf"^{out / link}: is a link, through which nothing is written or deleted"):
        claimed(out, partial=(pattern,))
    assert (others / ".bashrc").exists() and (others / "1" / ".ssh").exists()


@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_a_second_command_in_the_folder_is_refused(tmp_path):
    with folder_of(tmp_path).claim(), pytest.raises(FolderInUse, match=rf"\(process {os.getpid()} .*let it end first$"):
        claimed(tmp_path)
    with sole_writer(tmp_path / "new"), pytest.raises(FolderInUse):
        claimed(tmp_path / "new")
    assert list((tmp_path / "new").iterdir()) == []


def test_the_check_is_repeated_once_the_folder_is_held(tmp_path, monkeypatch):
    """Another command may have claimed and left the folder between the check and the lock."""
    check = ResultFolder.check

    def overtaken(folder):
        check(folder)
        monkeypatch.setattr(ResultFolder, "check", check)
        claimed(tmp_path, settings={"seed": 9})

    monkeypatch.setattr(ResultFolder, "check", overtaken)
    with pytest.raises(DatasetError, match="--seed 9, not 3"):
        claimed(tmp_path)


def test_a_new_folder_is_deleted_if_nothing_was_written(tmp_path):
    def failing(out, writes):
        with pytest.raises(KeyError), folder_of(out, mark=None).claim():
            if writes:
                (out / "file").touch()
            raise KeyError

    failing(tmp_path / "new", writes=False)
    failing(tmp_path / "used", writes=True)
    (tmp_path / "empty").mkdir()
    failing(tmp_path / "empty", writes=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "used"]


def test_a_folder_that_may_not_be_written_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write anywhere
    with pytest.raises(PermissionError) as error:
        claimed(tmp_path)
    assert error.value.filename == str(tmp_path) and not list(tmp_path.iterdir())


def test_differences_name_the_outer_settings_first_and_compare_lists_by_their_parts():
    before = {"scenes": [{"rocks": {"k": 0.1}}, 1], "name": "one", "pair": [1, 2]}
    now = {"scenes": [{"rocks": {"k": 0.2}}, 1], "name": "two", "pair": [1, 3]}
    assert differences(before, now) == ["name one, not two", "pair 1 2, not 1 3", "scenes[0].rocks.k 0.1, not 0.2"]
    assert differences(before, before) == [] and differences({}, {"new": None}) == []
    assert as_typed(None) == "none" and as_typed((1, 2.5)) == "1 2.5"


@pytest.mark.parametrize(("code", "passes"), [(errno.ENOTEMPTY, True), (errno.ENOENT, True), (errno.EACCES, False)])
def test_a_half_written_folder_in_which_a_worker_still_writes_is_left(tmp_path, monkeypatch, code, passes):
    """Workers of a cluster finish their tasks after a Ctrl-C, and the same command may be called again at once."""
    (tmp_path / ".00.1.partial").mkdir()

    def failing(folder):
        raise OSError(code, "changed meanwhile", str(folder))

    folder = ResultFolder(tmp_path, "dataset", partial=(".*.partial",))
    with monkeypatch.context() as patch:
        patch.setattr("marssim.base.results.claim.shutil.rmtree", failing)
        with nullcontext() if passes else pytest.raises(OSError):
            folder.clear_partial()
    folder.clear_partial()
    assert not list(tmp_path.iterdir())
