import pytest

from marssim.base.files.json_file import DatasetError
from marssim.base.results.out_folder import check_around, check_out
from marssim.generate import GenerateConfig, generate_dataset


def test_a_dataset_and_what_lies_in_one_take_no_results(tmp_path):
    for name, mark in (("made", "generate.json"), ("exported", "export.json")):
        (tmp_path / name / "scenes").mkdir(parents=True)
        (tmp_path / name / mark).write_text("{}")
        with pytest.raises(DatasetError, match=rf"^--out .*{name}: is a dataset; choose"):
            check_out(tmp_path / name)
        for inside in ("score", "scenes/score"):
            with pytest.raises(DatasetError, match=rf"{name}/{inside}: lies in the dataset {tmp_path / name}; choose"):
                check_out(tmp_path / name / inside)
    (tmp_path / "link").symlink_to(tmp_path / "made")
    with pytest.raises(DatasetError, match="link: is a dataset"):
        check_out(tmp_path / "link")


def test_no_dataset_is_made_in_another(tmp_path):
    (tmp_path / "made" / "scenes").mkdir(parents=True)
    (tmp_path / "made" / "generate.json").write_text("{}")
    check_around(tmp_path / "made")  # it may be gone on with
    with pytest.raises(DatasetError, match=rf"^--out .*made/more: lies in the dataset {tmp_path / 'made'}; choose"):
        check_around(tmp_path / "made" / "more")
    with pytest.raises(DatasetError, match="lies in the dataset"):
        generate_dataset(GenerateConfig(out=tmp_path / "made" / "more", pairs=1))
    assert not (tmp_path / "made" / "more").exists()


def test_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match=r"^--out .*file: is not a folder; choose another$"):
        check_out(tmp_path / "file")


def test_any_other_folder_is_accepted(tmp_path):
    """A folder around a dataset, one that does not exist, and one with another program's generate.json."""
    (tmp_path / "data" / "scenes").mkdir(parents=True)
    (tmp_path / "data" / "generate.json").write_text("{}")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "generate.json").write_text("{}")
    for folder in (tmp_path, tmp_path / "new" / "score", tmp_path / "other", tmp_path / "other" / "score"):
        check_out(folder)
