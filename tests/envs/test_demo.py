import pytest

from envs.demo import DemoConfig, demo


class Unused:
    def infer(self, left, right, rig):
        raise AssertionError("no image is to be predicted")


@pytest.fixture(autouse=True)
def _no_network(monkeypatch):
    monkeypatch.setattr("envs.demo.load_estimator", lambda name: Unused())


def test_other_data_in_the_folder_is_refused_and_untouched(tmp_path):
    precious = tmp_path / "data" / "generate.json"
    precious.parent.mkdir()
    precious.write_text('{"seed": 1}')
    with pytest.raises(ValueError, match="not the demo's"):
        demo(DemoConfig(out=tmp_path))
    precious.unlink()
    (tmp_path / "data" / "thesis.txt").write_text("years of work")
    with pytest.raises(ValueError, match=r"generate\.json"):
        demo(DemoConfig(out=tmp_path))
    assert (tmp_path / "data" / "thesis.txt").is_file()


def test_a_wrong_number_is_told_before_anything_is_deleted(tmp_path):
    kept = tmp_path / "data" / "generate.json"
    kept.parent.mkdir()
    kept.write_text('{"seed": 20000}')
    with pytest.raises(ValueError, match="--pairs"):
        demo(DemoConfig(out=tmp_path, pairs=0))
    assert kept.is_file()
