"""Every way to break a dataset gives a finding that names the file."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.sample import IMAGES, sample_digest
from marssim.base.files.json_file import DatasetError
from marssim.inspection.integrity import UNFINISHED, check_extra, check_index, check_samples, check_trajectories
from marssim.scene.trajectory import tum_lines

SAMPLE = "scenes/00001/01"


@pytest.fixture
def folder(closed_form_set, tmp_path) -> Path:
    return shutil.copytree(closed_form_set, tmp_path / "set")


def findings(folder: Path, results: Path | None = None) -> list[str]:
    dataset = StereoDataset(folder)
    reported = check_index(dataset)
    for _, problems in check_samples(dataset):
        reported += problems
    return [str(finding) for finding in reported + check_trajectories(dataset) + check_extra(dataset, results)]


def change(path: Path, edit: Callable[[dict], object]) -> None:
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


def test_a_good_dataset_has_no_findings(folder):
    assert findings(folder) == []
    assert [name for name, _ in check_samples(StereoDataset(folder), threads=3)] == StereoDataset(folder).names


def record(folder: Path, occluded: bytes) -> None:
    """Replace the occlusion mask of the sample, and correct the hashes."""
    (folder / SAMPLE / "occluded.png").write_bytes(occluded)
    digest = hashlib.sha256(occluded).hexdigest()
    change(folder / SAMPLE / "sample.json", lambda c: c["sha256"].update({"occluded.png": digest}))
    whole = sample_digest(folder / SAMPLE)
    change(folder / "dataset.json", lambda c: c["samples"][3].update(sha256=whole))


@pytest.mark.parametrize("name", IMAGES)
def test_every_image_is_checked(folder, name):
    file = folder / SAMPLE / name
    data = file.read_bytes()
    for broken, problem in (
        (data[:-20], "truncated"),
        (data + b"x", "its content is not what sample.json records"),
        (b"", "empty"),
        (data[:60] + bytes([data[60] ^ 1]) + data[61:], "its content is not what sample.json records"),
    ):
        file.write_bytes(broken)
        assert findings(folder) == [f"{SAMPLE}/{name}: {problem}"]
    file.unlink()
    assert findings(folder) == [f"{SAMPLE}/{name}: missing"]
    file.mkdir()
    assert len(findings(folder)) == 2 and "cannot be read" in findings(folder)[0]


def test_a_wrong_image_with_a_right_hash_is_found_by_its_header(folder):
    """Someone wrote the sample again, with its hashes, yet with an image of another size or kind."""
    for image in (np.zeros((5, 7), np.uint8), np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64), np.uint16)):
        record(folder, cv2.imencode(".png", image)[1].tobytes())
        reported = findings(folder)
        assert len(reported) == 1 and reported[0].startswith(
            f"{SAMPLE}/occluded.png: {image.shape[1]} x {image.shape[0]} px "
        )


def test_a_file_that_is_no_png_is_found_although_its_hash_is_right(folder):
    image = (folder / SAMPLE / "occluded.png").read_bytes()
    for data in (b"", image[:20], image[:-1], bytes(16) + image[16:], image[:8]):
        record(folder, data)
        assert findings(folder) == [f"{SAMPLE}/occluded.png: {'not a complete PNG image' if data else 'empty'}"]
    record(folder, image)
    assert findings(folder) == []


@pytest.mark.parametrize(
    ("edit", "problem"),
    [
        (lambda c: c.pop("rig"), "field 'rig' is missing"),
        (lambda c: c["rig"].pop("fx"), "fx"),
        (lambda c: c["rig"].update(baseline=-1), "baseline"),
        (lambda c: c.pop("pose"), "field 'pose' is missing"),
        (lambda c: c["pose"].pop(), "pose must be 4 rows of 4 finite numbers"),
        (lambda c: c.update(pose="north"), "pose must be 4 rows of 4 finite numbers"),
        (lambda c: c["pose"][0].__setitem__(3, None), "pose must be 4 rows of 4 finite numbers"),
        (lambda c: c["pose"].__setitem__(3, [9.0] * 4), "pose must be a rotation and a translation"),
        (lambda c: c["pose"][0].__setitem__(0, 3.0), "pose must be a rotation and a translation"),
        (lambda c: c.update(sun=[0.5 * c["sun"][0], 0.0, c["sun"][2]]), "sun is not a unit vector"),
        (lambda c: c.update(sun="high"), "sun is not a unit vector"),
        (lambda c: c.update(sun_elevation_deg=31.0), "sun_elevation_deg"),
        (lambda c: c.pop("sun_elevation_deg"), "sun_elevation_deg"),
        (lambda c: c.update(timestamp=None), "timestamp must be a number from 0 to 2e+09 s"),
        (lambda c: c.update(timestamp=True), "timestamp must be a number"),
        (lambda c: c.update(rover={}), "rover.pose must be 4 rows of 4 finite numbers"),
        (lambda c: c.update(rover=[1]), "rover.pose must be 4 rows of 4 finite numbers"),
        (lambda c: c.update(camera_to_rover=[1]), "camera_to_rover: pose must be 4 rows of 4 finite numbers"),
        (lambda c: c.update(surface_ids={}), "surface_ids must name the surfaces of rocks"),
        (lambda c: c.update(surface_ids={"rocks": ["a", 2]}), "surface_ids must hold [first, last] or [] for rocks"),
        (lambda c: c.update(sha256={}), "sha256"),
        (lambda c: c["sha256"].update({"left.png": "0" * 64}), "its content is not what dataset.json records"),
        (lambda c: c.update(preset="hard"), "its content is not what dataset.json records"),
        (lambda c: c["scene_config"]["rocks"].update(k=0.0701), "its content is not what dataset.json records"),
        (lambda c: c.update(note="mine"), "its content is not what dataset.json records"),
    ],
)
def test_a_broken_sample_json(folder, edit, problem):
    change(folder / SAMPLE / "sample.json", edit)
    reported = findings(folder)
    assert reported and reported[0].startswith(f"{SAMPLE}/sample.json: ") and problem in reported[0]
    assert all(finding.startswith(SAMPLE) for finding in reported)


def test_a_sample_with_a_broken_json_or_none_is_found(folder):
    (folder / SAMPLE / "sample.json").write_text("{")
    (folder / SAMPLE / "left.png").unlink()
    first, second = findings(folder)
    assert first.startswith(f"{SAMPLE}/sample.json: ") and second == f"{SAMPLE}/left.png: missing"
    shutil.rmtree(folder / SAMPLE)
    assert findings(folder) == [f"{SAMPLE}: missing"]


def test_a_report_may_lie_deeper_in_the_dataset(folder):
    results = folder / "reports" / "today"
    results.mkdir(parents=True)
    (results / "statistics.png").write_text("")
    assert findings(folder, results) == []
    (folder / "reports" / "notes.txt").write_text("mine")
    assert findings(folder, results) == ["reports/notes.txt: a file that the index does not list"]


def test_files_that_do_not_belong_are_named(folder):
    (folder / SAMPLE / "left.png~").write_text("a backup")
    (folder / "scenes" / "00001" / ".02.partial").mkdir()
    shutil.copytree(folder / SAMPLE, folder / "scenes" / "00007" / "00")
    (folder / "notes.txt").write_text("mine")
    (folder / "README.md").write_text("of the dataset")
    (folder / "report").mkdir()
    (folder / ".lock").write_text("")
    (folder / ".README.md.12.part").write_text("half")
    reported = set(findings(folder, folder / "report"))
    assert reported == {
        f"{SAMPLE}/left.png~: a file that the index does not list",
        f"scenes/00001/.02.partial: {UNFINISHED}",
        f".README.md.12.part: {UNFINISHED}",
        "scenes/00007: a folder that the index does not list",
        "notes.txt: a file that the index does not list",
    }


def test_the_index_is_checked(folder):
    change(folder / "dataset.json", lambda c: c["samples"][2].update(split="train"))
    assert findings(folder) == ["dataset.json: 00001/00 is in train, its scene belongs to test"]


def test_a_whole_sample_put_in_place_of_another_is_found(folder):
    shutil.rmtree(folder / SAMPLE)
    shutil.copytree(folder / "scenes/00001/00", folder / SAMPLE)
    assert findings(folder) == [f"{SAMPLE}/sample.json: its content is not what dataset.json records"]


def test_a_drive_has_its_poses_beside_it(folder):
    drive = {}
    for name in StereoDataset(folder).names:
        file = folder / "scenes" / name / "sample.json"
        change(file, lambda c: c.update(timestamp=4.0 * c["view"]))
        drive.setdefault(name[:5], []).append(json.loads(file.read_text()))
    write_index(folder, {"trajectory": True}, StereoDataset(folder).names)
    for scene, metas in drive.items():
        text = tum_lines([meta["timestamp"] for meta in metas], np.array([meta["pose"] for meta in metas]))
        (folder / "scenes" / scene / "trajectory.txt").write_text(text)
    assert findings(folder) == []
    short, moved = folder / "scenes/00002/trajectory.txt", folder / "scenes/00001/trajectory.txt"
    short.write_text("".join(short.read_text().splitlines(keepends=True)[:-1]))
    moved.write_text(moved.read_text().replace("1.000000000", "1.000000001", 1))
    (folder / "scenes/00003/trajectory.txt").unlink()
    assert findings(folder) == [
        "scenes/00001/trajectory.txt: its poses or times are not those of the views",
        "scenes/00002/trajectory.txt: its poses or times are not those of the views",
        "scenes/00003/trajectory.txt: missing, or cannot be read",
    ]


def test_the_settings_are_those_that_the_index_holds(folder):
    settings = {"seed": 3, "command": "--seed 3"}
    (folder / "generate.json").write_text(json.dumps(settings))
    assert findings(folder) == []
    (folder / "generate.json").write_text(json.dumps({**settings, "seed": 4}))
    assert findings(folder) == ["generate.json: its settings are not those that dataset.json records"]
    (folder / "generate.json").write_text("{")
    assert len(findings(folder)) == 1 and findings(folder)[0].startswith("generate.json: is not JSON")


def test_data_of_version_2_can_be_checked(folder):
    """Its samples do not record a rotation of the right camera."""
    for name in StereoDataset(folder).names:
        change(folder / "scenes" / name / "sample.json", lambda c: c.pop("right_rotation"))
    write_index(folder, {"seed": 3}, StereoDataset(folder).names)
    change(folder / "dataset.json", lambda c: c.update(version=2))
    assert findings(folder) == []


def test_a_turn_of_the_right_camera_that_is_no_rotation_is_found(folder):
    change(folder / SAMPLE / "sample.json", lambda c: c.update(right_rotation=[[1, 0, 0], [0, 1, 0], [0, 0, 3]]))
    write_index(folder, {"seed": 3}, StereoDataset(folder).names)
    assert findings(folder) == [f"{SAMPLE}/sample.json: right_rotation is not a 3 x 3 rotation"]


def test_data_of_an_older_version_are_not_called_good(folder):
    change(folder / "dataset.json", lambda c: c.update(version=1))
    with pytest.raises(DatasetError, match=r"dataset\.json: has version 1, .* not cover sample\.json: .* again"):
        findings(folder)
