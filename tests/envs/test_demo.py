import pytest

from envs.demo import DemoConfig, demo, main


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


def test_a_wrong_number_is_told_before_anything_is_deleted(tmp_path, capsys):
    kept = tmp_path / "data" / "generate.json"
    kept.parent.mkdir()
    kept.write_text('{"seed": 20000}')
    with pytest.raises(ValueError, match="pairs must"):
        demo(DemoConfig(out=tmp_path, pairs=0))
    for flag in ("--pairs", "--workers"):
        assert main(["--out", str(tmp_path), flag, "0"]) == 2
        assert capsys.readouterr().err == f"error: {flag} must be at least 1, got 0\n"
    assert kept.is_file()
