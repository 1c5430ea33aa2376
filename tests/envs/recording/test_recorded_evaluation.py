import json
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import pytest

import envs.evaluate
from envs.drives.config import EvaluateConfig
from envs.evaluate import evaluate
from envs.world.eyes import EyesConfig
from marssim.base.dataset.drive_file import read_drive

pytestmark = pytest.mark.usefixtures("undrawn_figures")


class Links(HTMLParser):
    """Collects the links of a page, and its text."""

    def __init__(self, page):
        super().__init__()
        self.links, self.text = [], ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.links += [value for name, value in attributes if name == "href"]

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def recorded(small_scene, tmp_path_factory):
    from marssim.scene.place_file import save_place

    folder = tmp_path_factory.mktemp("recorded")
    save_place(small_scene, folder / "place.json")
    config = EvaluateConfig(
        folder / "out", driver=("straight",), perception=("ground_truth",), dynamics="kinematic", goal_distance=4.0,
        k=(0.01,), videos=False, episodes=1, scene=str(folder / "place.json"), eyes=EyesConfig(64, 64), record="all",
    )  # fmt: skip
    return config, evaluate(config)


def test_the_results_page_leads_to_the_page_of_every_drive(recorded):
    config, _ = recorded
    (file,) = (config.out / "drives").glob("*.zip")
    drive = read_drive(file)
    assert drive.content["settings"]["goal_distance"] == 4.0 and drive.content["episode"]["driver"] == "straight"
    text = (config.out / "results.html").read_text(encoding="utf-8")
    assert "default-src 'none'; style-src 'unsafe-inline'" in text and "<script" not in text
    page = Links(text)
    assert f"drives/{file.stem}.html" in page.links
    assert all((config.out / link).is_file() for link in page.links)
    assert "inspect" in page.text and "results.json" in page.links
    assert "No drive is recorded" not in page.text


def test_finished_drives_without_a_record_are_driven_again_for_it(recorded, tmp_path, monkeypatch):
    config, content = recorded
    config = replace(config, out=shutil.copytree(config.out, tmp_path / "out"))
    driven, drive = [], envs.evaluate.drive
    monkeypatch.setattr(envs.evaluate, "drive", lambda *a: driven.append(a[1]) or drive(*a))
    evaluate(config)
    assert driven == []
    shutil.rmtree(config.out / "drives")
    arrived = content["results"][0]["success_rate"] == 1
    evaluate(replace(config, record="failures"))
    assert len(driven) == (0 if arrived else 1)
    page = Links((config.out / "results.html").read_text(encoding="utf-8"))
    assert ("No drive failed, so that none is recorded" in page.text) == arrived
    evaluate(config)
    assert len(driven) == 1 and len(list((config.out / "drives").glob("*.html"))) == 1


def with_film_and_bag(recorded, out):
    """A copy of the evaluation with a film and a bag of its drive, and the paths of both."""
    config = replace(recorded[0], out=shutil.copytree(recorded[0].out, out))
    (record,) = (out / "episodes").iterdir()
    film, bag = out / "videos" / f"{record.stem}.mp4", out / "bags" / record.stem / "metadata.yaml"
    for file in (film, bag):
        file.parent.mkdir(parents=True)
        file.write_text("old")
    (out / "videos.json").write_text(json.dumps({f"videos/{film.name}": record.name, "best.mp4": "other.json"}))
    return config, film, bag


@pytest.mark.parametrize("record", ["none", "all"])
def test_a_drive_whose_record_was_deleted_loses_all_that_was_made_of_it(recorded, tmp_path, record):
    config, film, bag = with_film_and_bag(recorded, tmp_path / "out")
    (drive,) = (config.out / "drives").glob("*.zip")
    old = drive.stat().st_mtime_ns
    shutil.rmtree(config.out / "episodes")
    evaluate(replace(config, record=record))
    assert not film.exists() and not bag.parent.exists()
    assert json.loads((config.out / "videos.json").read_text()) == {"best.mp4": "other.json"}
    page = Links((config.out / "results.html").read_text(encoding="utf-8"))
    if record == "none":
        assert not list((config.out / "drives").iterdir()) and "inspect" not in page.text
    else:
        assert drive.stat().st_mtime_ns > old and f"drives/{drive.stem}.html" in page.links


def test_a_drive_that_is_driven_again_to_be_recorded_keeps_its_film_and_bag(recorded, tmp_path):
    config, film, bag = with_film_and_bag(recorded, tmp_path / "out")
    shutil.rmtree(config.out / "drives")
    evaluate(config)
    assert film.read_text() == bag.read_text() == "old" and len(list((config.out / "drives").iterdir())) == 2
    assert len(json.loads((config.out / "videos.json").read_text())) == 2
