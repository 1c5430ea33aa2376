from pathlib import Path

import pytest
from recorded_drives import content, drive_bytes, step

from envs.report import main
from marssim.base.dataset.drive_file import encode_drive, read_drive


@pytest.fixture
def run_folder(tmp_path):
    folder = tmp_path / "out" / "drives"
    folder.mkdir(parents=True)
    for name in ("a.zip", "b.zip"):
        (folder / name).write_bytes(drive_bytes())
    return folder.parent


def test_a_folder_gets_a_page_for_each_of_its_drives(run_folder, capsys):
    assert main([str(run_folder)]) == 0
    assert capsys.readouterr().out == f"2 pages in {run_folder / 'drives'}\n"
    assert sorted(p.name for p in (run_folder / "drives").glob("*.html")) == ["a.html", "b.html"]


def test_two_drives_get_one_page(run_folder, tmp_path, capsys):
    a, b = (run_folder / "drives" / name for name in ("a.zip", "b.zip"))
    assert main([str(a), str(b), "--out", str(tmp_path / "pair.html")]) == 0
    assert b"navigator, sgbm: course 3, k=0.1, slope=0 beside navigator" in (tmp_path / "pair.html").read_bytes()
    assert main([str(a)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(a.with_suffix(".html"))


@pytest.mark.parametrize(("course", "difference"), [
    ({"goal": [9.0, 0.5]}, "their goals are 0.5 m apart"),
    ({"shortest_path": [[0.0, 0.3], [9.0, 0.0]]}, "their starts are 0.3 m apart"),
    ({"shortest_path": [[0.0, 0.0], [4.0, 3.0], [9.0, 0.0]]}, "their shortest paths are 9.0 and 10.8 m long"),
    ({"shortest_path": []}, "only one has a shortest path"),
    ({"obstacles": []}, "they have 1 and 0 rocks that block"),
])  # fmt: skip
def test_drives_of_different_courses_get_no_page(run_folder, tmp_path, capsys, course, difference):
    a, b, page = *(run_folder / "drives" / name for name in ("a.zip", "b.zip")), tmp_path / "pair.html"
    other = content([step(), step(x=9.0, outcome="goal")])
    other["episode"] |= course
    b.write_bytes(encode_drive(other, {}))
    assert main([str(a), str(b), "--out", str(page)]) == 2 and not page.exists()
    assert capsys.readouterr().err == f"error: {a} and {b} are drives of different courses: {difference}\n"
    assert main([str(b), str(b), "--out", str(page)]) == 0


def test_mistakes_exit_with_2_and_one_line(run_folder, tmp_path, capsys):
    a, b = (str(run_folder / "drives" / name) for name in ("a.zip", "b.zip"))
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.zip").write_text("no archive")
    for arguments, named in (
        ([], "name a folder, one drive or two"), ([a, b], "two drives need --out"), ([a, b, a], "one drive or two"),
        ([str(tmp_path / "none.zip")], "none.zip: no such file"), ([str(run_folder), a, "--out", "x"], "is a folder"),
        ([str(tmp_path / "text.zip")], "text.zip: is not a whole zip archive"), ([a, "--out", a], "must end in .html"),
        ([a, "--out", b], "b.zip: must end in .html"), ([a, "--out", str(run_folder / "results.json")], ".html"),
        ([str(tmp_path / "empty")], "empty: holds no recorded drives"),
    ):  # fmt: skip
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert read_drive(Path(b)).steps
        assert named in error and error.startswith("error: ") and error.count("\n") == 1
