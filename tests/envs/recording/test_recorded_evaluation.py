import json
import os
import re
import shutil
import time
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from envs.drives.episodes import Cell, EpisodeRecord
from envs.drives.metrics import paired_difference, summarise
from envs.evaluate import evaluate
from envs.evaluation import driving
from envs.evaluation.config import EvaluateConfig
from envs.recording.page_colours import colour_rules, outcome_style
from envs.recording.results_page import FILMED, _files, write_results_page
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
    assert colour_rules() in text and f'style="{outcome_style(drive.content["episode"]["outcome"])}"' in text
    page = Links(text)
    assert f"drives/{file.stem}.html" in page.links
    assert all((config.out / link).is_file() for link in page.links)
    assert "inspect" in page.text and "results.json" in page.links
    assert "No drive is recorded" not in page.text


def records_page(recorded, out, *changes):
    """The page of the evaluation if its drive had been driven several times, each with changes to its record."""
    config, content = recorded
    (file,) = (config.out / "episodes").iterdir()
    record = EpisodeRecord(**json.loads(file.read_text()))
    records = [replace(record, **change) for change in changes]
    rows = []
    for r in records:
        cell = Cell(condition=r.cell.removeprefix("condition=")).content()
        rows.append({"driver": r.driver, "perception": r.perception, "cell": cell, **summarise([r])})
    difference = {"driver": "a", "perception": "b", "less": ["c", "d"], **paired_difference(records, records)}
    content = {**content, "results": rows, "differences": [difference]}
    write_results_page(out, content, records, [f"{n}.json" for n in range(len(records))])
    return Links((out / "results.html").read_text(encoding="utf-8"))


def test_near_misses_are_shown_of_drives_that_arrived_too(recorded, tmp_path):
    page = records_page(recorded, tmp_path, {"cell": "condition=clear", "outcome": "goal", "near_miss": True})
    assert re.search(r"goal SPL [\d.]+, [\d.]+ m, near miss", page.text) and "all drives" not in page.text


def test_a_page_of_many_conditions_begins_with_all_drives_and_leads_to_the_failures(recorded, tmp_path):
    (tmp_path / "drives").mkdir()
    (tmp_path / "drives" / "1.html").touch()
    failure = {"outcome": "no_path", "cause": "detour"}
    page = records_page(
        recorded, tmp_path, {"cell": "condition=clear", "outcome": "goal"}, {"cell": "condition=storm", **failure},
        {"cell": "condition=ditch", "episode": 7, **failure},
    )  # fmt: skip
    head, failures = page.text.index("all drives"), page.text.index("failures")
    assert head < failures < page.text.index("course 0")
    assert "straightground_truth333 %" in page.text  # three drives, a third of which arrived
    assert "straight, ground_truthno pathdetour2storm: 0, ditch: 7" in page.text
    assert "a, b less c, d, paired, 3 episodes: +0 points of success" in page.text
    assert page.links[:4] == ["#cell-0", "#cell-1", "#cell-2", "drives/1.html"]


def test_the_page_of_the_present_folder_has_its_name(recorded, tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")
    assert "Results of mine" in records_page(recorded, Path(), {}).text


def test_a_broken_drive_is_a_warning_and_has_no_page(recorded, tmp_path, capsys):
    config = replace(recorded[0], out=shutil.copytree(recorded[0].out, tmp_path / "out"))
    (file,) = (config.out / "drives").glob("*.zip")
    file.write_bytes(b"half a drive")
    os.utime(file, (time.time() + 9, time.time() + 9))
    evaluate(config)
    assert f"warning: {file}: is not a whole zip archive" in capsys.readouterr().err
    page = Links((config.out / "results.html").read_text(encoding="utf-8"))
    assert "inspect" not in page.text and "no pages, since their files are broken. Run envs.report" in page.text


@pytest.mark.parametrize("record", ["none", "failures"])
def test_a_broken_drive_is_no_sign_of_success(recorded, tmp_path, record):
    """Joined results have "none", whatever their shards have."""
    config, content = recorded
    content = {**content, "config": {**content["config"], "record": record}}
    text = records_page((config, content), tmp_path, {"outcome": "goal"}).text
    assert ("No drive failed" in text, "No drive is recorded" in text) == (record == "failures", record == "none")
    assert "No drive failed" not in records_page((config, content), tmp_path, {"outcome": "stuck"}).text
    (tmp_path / "drives").mkdir()
    (tmp_path / "drives/a.zip").write_bytes(b"half a drive")
    text = records_page((config, content), tmp_path, {"outcome": "stuck"}).text
    assert "their files are broken" in text and "No drive" not in text


def test_a_folder_whose_name_is_no_utf8_has_a_page_too(recorded, tmp_path):
    out = tmp_path / os.fsdecode(b"ergebnis_\xe4")
    try:
        out.mkdir()
    except OSError:
        pytest.skip("this file system takes only names in UTF-8")
    assert r"Results of ergebnis_\udce4" in records_page(recorded, out, {}).text


def test_finished_drives_without_a_record_are_driven_again_for_it(recorded, tmp_path, monkeypatch):
    config, content = recorded
    config = replace(config, out=shutil.copytree(config.out, tmp_path / "out"))
    driven, drive = [], driving.drive
    monkeypatch.setattr(driving, "drive", lambda *a: driven.append(a[1]) or drive(*a))
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


def test_films_of_an_earlier_run_are_not_linked(tmp_path):
    ends = {"best.mp4": "a.json", "worst.mp4": "b.json"}
    (tmp_path / FILMED).write_text(json.dumps({"best.mp4": "a.json", "worst.mp4": "c.json"}))
    for name in ends:
        (tmp_path / name).touch()
    links = _files(tmp_path, ends)
    assert 'href="best.mp4"' in links and "worst.mp4" not in links
