"""Many pairs in one run: what is written, and that stopping it makes no difference."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial import cKDTree
from small_rivals import TINY

from m3depth.kinds.networks import new_network
from m3depth.predict import main, predict
from m3depth.prediction.files import read_cloud
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.overview import shortened, write_sheet
from m3depth.prediction.sources import inputs
from m3depth.stereo.classical import SGBM
from marssim.base.files.json_file import DatasetError, read_json

COUNT = 4


class Counted(SGBM):
    """SGBM that counts its calls, and ends the run at one of them as a kill does."""

    calls = 0
    last = None

    def infer(self, left, right, rig):
        Counted.calls += 1
        if Counted.calls == Counted.last:
            raise SystemExit
        return super().infer(left, right, rig)


class Unsure(SGBM):
    """SGBM that is sure of the first pair alone."""

    calls = 0

    def infer(self, left, right, rig):
        self.calls += 1
        maps = super().infer(left, right, rig)
        return maps if self.calls == 1 else replace(maps, confidence=np.zeros_like(maps.confidence))


@pytest.fixture(autouse=True)
def reset():
    Counted.calls, Counted.last = 0, None


@pytest.fixture(scope="module")
def folder(tmp_path_factory, plane_samples) -> Path:
    """Pairs of planes as images, with their poses: the camera moves 1 m to the right between two."""
    root = tmp_path_factory.mktemp("pairs")
    for eye in ("left", "right"):
        (root / eye).mkdir()
        for number, sample in enumerate(plane_samples):
            cv2.imwrite(str(root / eye / f"{number}.png"), getattr(sample, eye)[..., ::-1])
    (root / "poses.txt").write_text("".join(f"1 0 0 {x} 0 0 1 0 0 -1 0 1.2\n" for x in range(COUNT)))
    return root


def options(folder, out, **changes) -> PredictOptions:
    flags = {"left": "left/*.png", "right": "right/*.png", "focal": 100.0, "baseline": 0.27, "estimator": "sgbm"}
    return PredictOptions((folder,), out, **{**flags, **changes})


def contents(out: Path) -> dict[str, bytes]:
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


def test_a_folder_is_continued_with_the_same_class_alone(folder, tmp_path):
    predict(options(folder, tmp_path), SGBM())
    predict(options(folder, tmp_path), SGBM())
    with pytest.raises(DatasetError, match="estimator"):
        predict(options(folder, tmp_path), Counted())
    assert Counted.calls == 0
    assert read_json(tmp_path / "predictions.json")["pairs"] == 4


def test_changed_files_of_a_class_are_reported_as_such(folder, tmp_path, monkeypatch):
    module = tmp_path / "my_method.py"
    module.write_text("from m3depth.stereo.classical import SGBM as Net\n")
    monkeypatch.syspath_prepend(tmp_path)
    flags = {"estimator": "my_method:Net", "write": ("depth",)}
    predict(options(folder, tmp_path / "out", **flags))
    module.write_text(module.read_text() + "# another state\n")
    with pytest.raises(DatasetError, match=r"other settings \(Files of the method [0-9a-f.]+, not [0-9a-f.]+\)"):
        predict(options(folder, tmp_path / "out", **flags))


def test_a_folder_of_another_network_is_not_continued_in_another_precision(folder, tmp_path, monkeypatch):
    new_network(TINY["raft-stereo"]).save_pretrained(tmp_path / "raft.safetensors")
    out = tmp_path / "out"
    flags = {"estimator": f"m3depth:{tmp_path / 'raft.safetensors'}", "write": ("depth",), "unchecked": True}
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: None)
    predict(options(folder, out, **flags))
    record = json.loads((out / "0/prediction.json").read_text())
    assert record["runtime"].startswith("pytorch ") and record["runtime"].endswith(" fp32")
    predict(options(folder, out, **flags))
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: torch.bfloat16)
    with pytest.raises(DatasetError, match=r"runtime pytorch .* fp32, not pytorch .* bf16"):
        predict(options(folder, out, **flags))


def test_each_pair_has_a_folder_and_all_of_them_an_overview(folder, tmp_path, capsys):
    predict(options(folder, tmp_path, poses=folder / "poses.txt", video=True), SGBM())
    assert {path.name for path in tmp_path.iterdir()} == {
        *"0123", "overview.jpg", "video.mp4", "fused_cloud.ply", "predictions.json",
    }  # fmt: skip
    assert capsys.readouterr().out == f"{tmp_path}: 4 of 4 pairs\n"
    for name in "0123":
        assert {path.name for path in (tmp_path / name).iterdir()} >= {"depth.npy", "figure.png", "prediction.json"}
    record = json.loads((tmp_path / "2/prediction.json").read_text())
    assert record["rig"]["fx"] == 100 and np.array(record["pose"])[0, 3] == 2
    assert cv2.imread(str(tmp_path / "overview.jpg")).shape[1] == 2000
    video = cv2.VideoCapture(str(tmp_path / "video.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == COUNT
    fused = trimesh.load(tmp_path / "fused_cloud.ply").vertices
    single = trimesh.load(tmp_path / "3/cloud.ply").vertices
    assert 100 < len(fused) < 4 * len(single)
    # the world has z up: y of the camera is -z, and its z is y
    world = np.column_stack([single[:, 0] + 3, single[:, 2], 1.2 - single[:, 1]])
    assert cKDTree(fused).query(world)[0].max() < 0.05 * np.sqrt(3)


def test_a_killed_run_continues_without_a_difference(folder, tmp_path, capsys):
    flags = {"poses": folder / "poses.txt", "map_format": ("npy",), "video": True}
    predict(options(folder, tmp_path / "whole", **flags), Counted())
    Counted.calls, Counted.last = 0, 3
    with pytest.raises(SystemExit):
        predict(options(folder, tmp_path / "parts", **flags), Counted())
    done = [path for path in (tmp_path / "parts").glob("*/prediction.json")]
    assert len(done) == 2 and not (tmp_path / "parts/overview.jpg").exists()
    (tmp_path / "parts/2").mkdir(exist_ok=True)
    (tmp_path / "parts/2/depth.npy").write_bytes(b"half of it")
    (tmp_path / "parts/2/.confidence.npy.123.part").write_bytes(b"what a kill leaves")
    Counted.calls, Counted.last = 0, None
    capsys.readouterr()
    predict(options(folder, tmp_path / "parts", **flags), Counted())
    assert Counted.calls == 2 and "predict: 2 of 4 pairs are predicted already" in capsys.readouterr().err
    whole, parts = contents(tmp_path / "whole"), contents(tmp_path / "parts")
    assert whole.keys() == parts.keys() and [name for name in whole if whole[name] != parts[name]] == []


def test_a_whole_folder_loads_nothing_again_and_other_settings_are_refused(folder, tmp_path, monkeypatch):
    predict(options(folder, tmp_path, write=("depth",)))
    monkeypatch.setattr("m3depth.prediction.one_pair.load_estimator", lambda *a, **k: pytest.fail("loaded"))
    predict(options(folder, tmp_path, write=("depth",)))
    if not torch.cuda.is_available():  # auto is the CPU
        predict(options(folder, tmp_path, write=("depth",), device="cpu"))
    with pytest.raises(DatasetError, match=r"--min-confidence none, not 0\.3"):
        predict(options(folder, tmp_path, write=("depth",), min_confidence=0.3))
    (folder / "left/9.png").write_bytes((folder / "left/0.png").read_bytes())
    (folder / "right/9.png").write_bytes((folder / "right/0.png").read_bytes())
    try:
        with pytest.raises(DatasetError, match=r"other settings \(other data\)"):
            predict(options(folder, tmp_path, write=("depth",)))
    finally:
        for eye in ("left", "right"):
            (folder / eye / "9.png").unlink()


@pytest.mark.parametrize("shown", ["{}", '{"depth_shown_m": [1]}', '{"depth_shown_m": ["a", 2]}'])
def test_a_damaged_record_of_an_earlier_run_is_named(folder, tmp_path, shown):
    predict(options(folder, tmp_path, write=("depth",)), SGBM())
    (tmp_path / "0/prediction.json").write_text(shown)
    (tmp_path / "3/prediction.json").unlink()
    with pytest.raises(DatasetError, match=r"0/prediction\.json: depth_shown_m must be two numbers; delete the file"):
        predict(options(folder, tmp_path, write=("depth",)), SGBM())


def test_only_what_is_asked_for_is_written_in_the_formats_that_are(folder, tmp_path):
    predict(options(folder, tmp_path, write=("depth", "confidence"), map_format=("tiff", "pfm")), SGBM())
    assert {path.name for path in tmp_path.iterdir()} == {*"0123", "predictions.json"}
    assert {path.name for path in (tmp_path / "0").iterdir()} == {
        "depth.tiff", "depth.pfm", "confidence.tiff", "confidence.pfm", "prediction.json",
    }  # fmt: skip


def test_a_pair_that_cannot_be_used_is_skipped(folder, tmp_path, capsys):
    for eye in ("left", "right"):
        (tmp_path / eye).mkdir()
        for number in range(COUNT):
            (tmp_path / eye / f"{number}.png").write_bytes((folder / eye / f"{number}.png").read_bytes())
    (tmp_path / "left/1.png").write_bytes(b"broken")
    (tmp_path / "right/2.png").write_bytes((tmp_path / "left/2.png").read_bytes())
    predict(options(tmp_path, tmp_path / "out", write=("depth",)), SGBM())
    printed = capsys.readouterr()
    assert printed.out.endswith("2 of 4 pairs; 2 skipped, see the warnings\n")
    assert f"1 is skipped: {tmp_path}/left/1.png: not a readable image" in printed.err
    assert "are one and the same image" in printed.err
    assert sorted(path.parent.name for path in (tmp_path / "out").glob("*/prediction.json")) == ["0", "3"]


def test_a_pair_of_another_size_or_that_cannot_be_opened_is_skipped(folder, tmp_path, capsys, monkeypatch):
    """The calibration is for 96 x 64 px. If the first pair does not fit it, it is that of no pair."""
    for eye in ("left", "right"):
        (tmp_path / eye).mkdir()
        for number in range(COUNT):
            image = cv2.imread(str(folder / eye / f"{number}.png"))
            cv2.imwrite(str(tmp_path / eye / f"{number}.png"), image[:50] if number == 2 else image)
    (tmp_path / "calib.txt").write_text("cam0=[100 0 47.5; 0 100 31.5; 0 0 1]\nbaseline=270\nwidth=96\nheight=64\n")
    read = inputs.read_pair

    def locked(left, right):
        if left.name == "1.png":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(left))
        return read(left, right)

    monkeypatch.setattr(inputs, "read_pair", locked)
    flags = {"focal": None, "baseline": None, "write": ("depth",)}
    predict(options(tmp_path, tmp_path / "out", **flags), SGBM())
    printed = capsys.readouterr()
    assert printed.out.endswith("2 of 4 pairs; 2 skipped, see the warnings\n")
    assert f"1 is skipped: {tmp_path}/left/1.png: permission denied" in printed.err
    assert f"2 is skipped: {tmp_path}/calib.txt: is for 96 x 64 px" in printed.err
    (tmp_path / "calib.txt").write_text("cam0=[100 0 47.5; 0 100 31.5; 0 0 1]\nbaseline=270\nwidth=9\nheight=6\n")
    with pytest.raises(ValueError, match="is for 9 x 6 px"):
        predict(options(tmp_path, tmp_path / "other", **flags), SGBM())


def test_what_is_wrong_for_all_pairs_is_one_line(folder, tmp_path, capsys):
    words = [str(folder), "--left", "left/*.png", "--right", "right/*.png", "--estimator", "sgbm"]
    for flags, message in (
        ([], "--focal is missing"),
        (["--focal", "4", "--baseline", "0.2"], "--focal 4 px makes images of 96 px 170 deg wide"),
        (["--focal", "100", "--baseline", "0.2", "--cloud-frame", "world"], "--cloud-frame world needs poses"),
        (["--focal", "100", "--baseline", "0.2", "--mask", str(tmp_path / "gone.png")], "gone.png: no such mask"),
    ):
        assert main([*words, *flags, "--out", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1


def test_where_no_pair_can_be_used_each_reason_is_given_once_and_nothing_is_left(folder, tmp_path, capsys):
    for eye in ("left", "right"):
        (tmp_path / eye).mkdir()
        for number in range(2):
            (tmp_path / eye / f"{number}.png").write_bytes(b"broken")
    words = ["--left", f"{tmp_path}/left/*.png", "--right", f"{tmp_path}/right/*.png", "--estimator", "sgbm"]
    words += ["--focal", "100", "--baseline", "0.2", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if line.startswith(("warning", "error"))] == [
        *(f"warning: {n} is skipped: {tmp_path}/left/{n}.png: not a readable image" for n in range(2)),
        "error: no pair of 2 can be used, see the warnings",
    ]
    assert not (tmp_path / "out").exists()
    for eye in ("left", "right"):
        (tmp_path / eye / "1.png").unlink()
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if "readable" in line] == [f"error: {tmp_path}/left/0.png: not a readable image"]
    assert not (tmp_path / "out").exists()


def test_the_sheet_has_large_pictures_of_few_pairs_and_names_with_both_ends(folder, tmp_path):
    for number in range(2):
        (tmp_path / f"{number}").mkdir()
        cv2.imwrite(str(tmp_path / f"{number}/figure.png"), np.zeros((700, 1286, 3), np.uint8))
    write_sheet(tmp_path, ["0", "1"])
    assert cv2.imread(str(tmp_path / "overview.jpg")).shape[1] == 2000
    name = "NLMV0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01"
    assert shortened(name, 600) == name
    short = shortened(name, 200)
    assert short.startswith("NLMV0709") and short.endswith("2LLJ01") and "..." in short and len(short) < 35


def test_frames_of_a_video_are_predicted(plane_samples, tmp_path):
    frames = [np.concatenate([s.left, s.right], axis=1) for s in plane_samples[:3]]
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (192, 64))
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    flags = {"focal": 100.0, "baseline": 0.27, "every": 2, "write": ("depth", "figure")}
    predict(PredictOptions((tmp_path / "v.avi",), tmp_path / "out", **flags), SGBM())
    assert sorted(p.parent.name for p in (tmp_path / "out").glob("*/depth.npy")) == ["frame_000000", "frame_000002"]
    depth, true = np.load(tmp_path / "out/frame_000002/depth.npy"), plane_samples[2].depth
    both = np.isfinite(depth) & np.isfinite(true)
    assert both.mean() > 0.5 and np.median(np.abs(depth - true)[both] / true[both]) < 0.02
    assert cv2.VideoCapture(str(tmp_path / "out/video.mp4")).get(cv2.CAP_PROP_FPS) == 5


def test_masks_and_clouds_of_the_rover_and_of_the_world(folder, tmp_path):
    mask = np.full((64, 96), 255, np.uint8)
    mask[40:] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    flags = {"write": ("depth", "cloud"), "mask": (tmp_path / "mask.png",), "poses": folder / "poses.txt"}
    for frame in ("camera", "rover", "world"):
        predict(options(folder, tmp_path / frame, cloud_frame=frame, mount=(0.0, 1.2, 0.0), **flags), SGBM())
    assert np.isnan(np.load(tmp_path / "camera/1/depth.npy")[40:]).all()
    camera, rover, world = (trimesh.load(tmp_path / f / "1/cloud.ply").vertices for f in ("camera", "rover", "world"))
    x, y, z = camera.T
    np.testing.assert_allclose(rover, np.column_stack([z, 0.135 - x, 1.2 - y]), atol=1e-4)
    np.testing.assert_allclose(world, np.column_stack([x + 1, z, 1.2 - y]), atol=1e-4)
    fused = [(tmp_path / frame / "fused_cloud.ply").read_bytes() for frame in ("camera", "rover", "world")]
    points = [trimesh.load(tmp_path / frame / "fused_cloud.ply").vertices for frame in ("camera", "rover", "world")]
    assert len(fused[0]) > 1000
    for other in points[1:]:
        assert other.mean(axis=0) == pytest.approx(points[0].mean(axis=0), abs=0.02)


def test_pairs_without_points_add_none_to_the_fused_cloud(folder, tmp_path):
    flags = {"write": ("depth", "cloud"), "poses": folder / "poses.txt"}
    predict(options(folder, tmp_path / "some", **flags), Unsure())
    assert len(trimesh.load(tmp_path / "some/fused_cloud.ply").vertices) > 100
    for _ in range(2):  # a run with nothing left to predict fuses them too
        predict(options(folder, tmp_path / "none", **flags, max_range=0.001), Unsure())
        assert read_cloud(tmp_path / "none/fused_cloud.ply")[0].shape == (0, 3)


def test_a_place_on_the_rover_that_nothing_gives_is_a_warning_once(folder, tmp_path, capsys):
    said = (
        "warning: nothing says where the cameras are on the rover: 0.65 m ahead of its origin, 1.2 m above the ground"
    )
    mount = (0.65, 1.2, 20.0)
    for name, flags, count in (
        ("rover", {"cloud_frame": "rover"}, 1), ("camera", {}, 0),
        ("given", {"cloud_frame": "rover", "mount": mount}, 0),
        ("poses", {"poses": folder / "poses.txt", "pose_axes": "camera"}, 1),
    ):  # fmt: skip
        predict(options(folder, tmp_path / name, write=("depth", "cloud"), **flags), SGBM())
        assert capsys.readouterr().err.count(said) == count
        record = json.loads((tmp_path / name / "2/prediction.json").read_text())
        assert record["mount_assumed"] == (name != "given")
    images = tuple(folder / eye / "0.png" for eye in ("left", "right"))
    one = options(folder, tmp_path / "one", left=None, right=None, cloud_frame="rover", write=("depth",))
    predict(replace(one, images=images), SGBM())
    assert capsys.readouterr().err.count(said) == 1


def test_one_pair_does_not_go_into_a_folder_of_many(folder, tmp_path):
    predict(options(folder, tmp_path, write=("depth",)), SGBM())
    one = replace(
        options(folder, tmp_path), left=None, right=None, images=(folder / "left/0.png", folder / "right/0.png")
    )
    with pytest.raises(ValueError, match="holds predictions of many pairs; choose another"):
        predict(one, SGBM())


@pytest.fixture
def pages(monkeypatch):
    """What --view would show."""
    shown = []
    monkeypatch.setattr("m3depth.predict.check_viewer", lambda: None)
    monkeypatch.setattr("m3depth.predict.show", lambda shots, title: shown.append((shots, title)))
    return shown


def test_view_shows_the_pairs_and_a_finished_folder_without_predicting_again(folder, tmp_path, pages):
    flags = {"poses": folder / "poses.txt", "map_format": ("png",), "write": ("depth", "confidence")}
    predict(options(folder, tmp_path, **flags), Counted())
    assert not pages
    calls = Counted.calls
    predict(options(folder, tmp_path, view=True, **flags), Counted())
    assert Counted.calls == calls
    ((shots, title),) = pages
    assert [shot.name for shot in shots] == list("0123") and title == tmp_path.name
    assert [shot.pose[0, 3] for shot in shots] == [0, 1, 2, 3] and len({shot.world for shot in shots}) == 1
    view = shots[2].load()
    assert list(view.layers) == ["image", "depth", "confidence"] and "Counted" in view.note
    image = cv2.imread(str(folder / "left/2.png"))[..., ::-1]
    column, row = view.rig.camera.project(view.points[:1])[0].round().astype(int)
    assert np.array_equal(view.layers["image"].colours[0], image[row, column])


def test_view_shows_the_points_of_the_cloud(folder, tmp_path, pages):
    predict(options(folder, tmp_path, view=True, max_range=6.0), SGBM())
    (shots, _) = pages[0]
    cloud = trimesh.load(tmp_path / "1/cloud.ply")
    view = shots[1].load()
    assert np.allclose(view.points, cloud.vertices, atol=1e-5)
    assert len({shot.world for shot in shots}) == len(shots)  # pairs without poses have no common world
    assert np.allclose(shots[0].pose[:3, 3], (0.65, 0.135, 1.2))  # on the rover


def test_view_needs_depth(folder, tmp_path, capsys):
    arguments = [str(folder), "--left", "left/*.png", "--right", "right/*.png", "--focal", "100", "--baseline", "0.27"]
    assert main([*arguments, "--out", str(tmp_path / "out"), "--view", "--write", "normal"]) == 2
    assert "--view shows depth: leave it in --write" in capsys.readouterr().err
