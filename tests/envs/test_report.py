import pytest
from recorded_drives import drive_bytes

from envs.report import main


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


def test_mistakes_exit_with_2_and_one_line(run_folder, tmp_path, capsys):
    a, b = (str(run_folder / "drives" / name) for name in ("a.zip", "b.zip"))
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.zip").write_text("no archive")
    for arguments, named in (
        ([], "name a folder, one drive or two"), ([a, b], "two drives need --out"), ([a, b, a], "one drive or two"),
        ([str(tmp_path / "none.zip")], "none.zip: no such file"), ([str(run_folder), a, "--out", "x"], "is a folder"),
        ([str(tmp_path / "text.zip")], "text.zip: is not a whole zip archive"), ([a, "--out", a], "is a drive"),
        ([str(tmp_path / "empty")], "empty: holds no recorded drives"),
    ):  # fmt: skip
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert named in error and error.startswith("error: ") and error.count("\n") == 1
