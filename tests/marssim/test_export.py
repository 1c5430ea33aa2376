"""Each layout is read back by a reader that knows only that format's public rules, and compared with the dataset."""

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from marssim import export as command
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import StereoSample, read_sample
from marssim.base.results import lock
from marssim.export import ExportConfig, export
from marssim.layouts.kitti import kitti_code
from marssim.layouts.layout import Item
from marssim.layouts.middlebury import middlebury_calibration
from marssim.layouts.registry import LAYOUTS

FORMATS = tuple(LAYOUTS)
THINGS = "FlyingThings3D"


def run(capfd, *args: object) -> tuple[int, str]:
    """Return the exit code and the standard error of the command."""
    return command.main([str(a) for a in args]), capfd.readouterr().err.strip()


def contents(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def exports(closed_form_set, tmp_path_factory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("exports")
    for name in FORMATS:
        assert export(ExportConfig(closed_form_set, name, base / name)) == 8
    return {name: base / name for name in FORMATS}


# --- readers, after each format's public description ----------------------------------------------------------------


def read_pfm(path: Path) -> np.ndarray:
    """PFM as RAFT-Stereo and OpenStereo take it: one white space after each header field, rows from the bottom up."""
    with path.open("rb") as file:
        assert file.readline().rstrip() == b"Pf"
        size = re.match(rb"^(\d+)\s(\d+)\s$", file.readline())
        assert size is not None
        scale = float(file.readline().rstrip())
        values = np.fromfile(file, "<f4" if scale < 0 else ">f4")
    width, height = (int(n) for n in size.groups())
    return values.reshape(height, width)[::-1]


def read_rgb(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None and image.dtype == np.uint8 and image.shape[2] == 3
    return image[..., ::-1]


def read_grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None and image.ndim == 2
    return image


Pair = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # left, right, disparity, valid


def read_kitti(root: Path, part: str = "disp_occ_0") -> Iterator[Pair]:
    """Sorted lists of image_2, image_3 and the disparity are matched by place; disparity = uint16 / 256, 0 invalid."""
    lists = [sorted((root / "training" / name).glob("*_10.png")) for name in ("image_2", "image_3", part)]
    for left, right, truth in zip(*lists, strict=True):
        assert left.name == right.name == truth.name and re.fullmatch(r"\d{6}_10\.png", left.name)
        code = read_grey(truth)
        assert code.dtype == np.uint16
        yield read_rgb(left), read_rgb(right), code / 256.0, code > 0


def read_sceneflow(root: Path, split: str, kind: str = "frames_cleanpass") -> Iterator[Pair]:
    """FlyingThings3D by RAFT-Stereo's rule: paths by replacing words in the whole path; every pixel under 512 px."""
    for left in sorted(str(p) for p in (root / "FlyingThings3D" / kind / split).glob("*/*/left/*.png")):
        disparity = read_pfm(Path(left.replace(kind, "disparity").replace(".png", ".pfm")))
        yield read_rgb(Path(left)), read_rgb(Path(left.replace("left", "right"))), disparity, abs(disparity) < 512


def read_middlebury_2014(root: Path) -> Iterator[list[Pair]]:
    """Each scene with the plain, the differently exposed and the differently lit right image; unknown is inf."""
    for scene in sorted((root / "2014").iterdir()):
        disparity = read_pfm(scene / "disp0.pfm")
        left = read_rgb(scene / "im0.png")
        yield [(left, read_rgb(scene / f"im1{kind}.png"), disparity, disparity < 1e3) for kind in ("", "E", "L")]


def read_middeval3(root: Path) -> Iterator[Pair]:
    """The scenes of official_train.txt; valid are pixels that both eyes see (mask 255)."""
    for name in (root / "MiddEval3" / "official_train.txt").read_text().splitlines():
        folder = root / "MiddEval3" / "trainingF" / name
        seen = read_grey(folder / "mask0nocc.png") == 255
        yield read_rgb(folder / "im0.png"), read_rgb(folder / "im1.png"), read_pfm(folder / "disp0GT.pfm"), seen


def read_eth3d(root: Path) -> Iterator[Pair]:
    """Images and truth in two trees, matched by sorted order; valid below 512 px."""
    lists = [
        sorted(root.glob(f"two_view_training{path}")) for path in ("/*/im0.png", "/*/im1.png", "_gt/*/disp0GT.pfm")
    ]
    for left, right, truth in zip(*lists, strict=True):
        assert left.parent.name == truth.parent.name
        disparity = read_pfm(truth)
        yield read_rgb(left), read_rgb(right), disparity, disparity < 512


def read_openstereo(root: Path, split: str) -> Iterator[Pair]:
    """Lines "left right disparity", single spaces, below the root; no NaN; losses use 0 < disparity < 192."""
    for line in (root / f"{split}.txt").read_text().splitlines():
        left, right, truth = line.strip().split(" ")
        disparity = read_pfm(root / truth)
        assert not np.isnan(disparity).any()
        yield read_rgb(root / left), read_rgb(root / right), disparity, (disparity > 0) & (disparity < 192)


def read_calib(path: Path) -> dict[str, np.ndarray]:
    """Middlebury's calib.txt: name=value, matrices in Matlab's notation."""
    out = {}
    for line in path.read_text().splitlines():
        name, value = line.split("=")
        rows = value.strip("[]").split(";")
        out[name] = np.array([[float(v) for v in row.split()] for row in rows]).squeeze()
    return out


# --- what they find ---------------------------------------------------------------------------------------------------


def same(pair: Pair, sample: StereoSample, valid: np.ndarray, quantum: float = 0.0) -> None:
    left, right, disparity, marked = pair
    assert np.array_equal(left, sample.left) and np.array_equal(right, sample.right)
    assert np.array_equal(marked, valid) and 0.2 < marked.mean() < 1
    assert np.abs(disparity[marked] - sample.disparity[marked]).max() <= quantum / 2


def samples(path: Path, split: str) -> list[StereoSample]:
    out = list(StereoDataset(path, split))
    assert out and all(s.occluded.mean() > 0.02 and np.isinf(s.depth).mean() > 0.05 for s in out), "tests too little"
    return out


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_kitti(closed_form_set, exports, split):
    root = exports["kitti"] / split
    expected = samples(closed_form_set, split)
    for part, hidden in (("disp_occ_0", False), ("disp_noc_0", True)):
        pairs = list(read_kitti(root, part))
        assert len(pairs) == len(expected)
        for pair, sample in zip(pairs, expected):
            same(pair, sample, np.isfinite(sample.depth) & ~(hidden & sample.occluded), 1 / 256)


def test_kitti_calibration(closed_form_set, exports):
    """P_rect_02 and P_rect_03 give focal lengths, principal point, baseline, and with them depth."""
    sample = samples(closed_form_set, "train")[0]
    lines = (exports["kitti"] / "train/training/calib_cam_to_cam/000000.txt").read_text().splitlines()
    fields = {key: np.array(value.split(), float) for key, value in (line.split(":", 1) for line in lines)}
    left, right = fields["P_rect_02"].reshape(3, 4), fields["P_rect_03"].reshape(3, 4)
    camera = sample.rig.camera
    assert np.allclose(left[:, :3], camera.K, rtol=1e-9) and np.allclose(right[:, :3], camera.K, rtol=1e-9)
    baseline = (left[0, 3] - right[0, 3]) / left[0, 0]
    assert baseline == pytest.approx(sample.rig.baseline, rel=1e-9)
    assert (fields["S_rect_02"] == [camera.width, camera.height]).all() and (
        fields["S_03"] == fields["S_rect_02"]
    ).all()
    for eye in ("02", "03"):  # the eyes that are not rectified are the rectified ones
        pose = np.column_stack([fields[f"R_{eye}"].reshape(3, 3), fields[f"T_{eye}"]])
        assert np.allclose(fields[f"K_{eye}"].reshape(3, 3) @ pose, fields[f"P_rect_{eye}"].reshape(3, 4))
        assert (fields[f"D_{eye}"] == 0).all()
    _, _, disparity, valid = next(read_kitti(exports["kitti"] / "train"))
    depth = left[0, 0] * baseline / disparity[valid]
    assert np.abs(depth / sample.depth[valid] - 1).max() < 0.5 / 256 / disparity[valid].min() * 1.01
    point = np.array([0.3, -0.2, 4.0, 1.0])
    u_left, u_right = (matrix[0] @ point / (matrix[2] @ point) for matrix in (left, right))
    assert u_left - u_right == pytest.approx(sample.rig.fb / 4.0)


@given(hnp.arrays(np.float64, 30, elements=st.floats(0, 400)), hnp.arrays(bool, 30))
def test_kitti_codes(disparity, known):
    code = kitti_code(disparity, known)
    fits = known & (disparity * 256 <= 65535)
    assert np.array_equal(code > 0, fits)  # a known pixel never turns invalid by rounding, none wraps around
    assert (np.abs(code / 256 - disparity)[fits] <= np.where(disparity[fits] < 1 / 512, 1 / 256, 1 / 512)).all()


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_sceneflow(closed_form_set, exports, split):
    root = exports["sceneflow"]
    expected = samples(closed_form_set, split)
    for kind in ("frames_cleanpass", "frames_finalpass"):
        pairs = list(read_sceneflow(root, split.upper(), kind))
        assert len(pairs) == len(expected)
        for (left, right, disparity, valid), sample in zip(pairs, expected):
            assert np.array_equal(left, sample.left) and np.array_equal(right, sample.right)
            assert valid.all() and np.array_equal(disparity, sample.disparity)  # the sky is at infinity: 0
    occlusions = sorted((root / "FlyingThings3D/disparity_occlusions" / split.upper()).glob("*/*/left/*.png"))
    assert all(np.array_equal(read_grey(p) > 0, s.occluded) for p, s in zip(occlusions, expected, strict=True))


def test_sceneflow_images_take_space_once(exports):
    clean = next((exports["sceneflow"] / "FlyingThings3D/frames_cleanpass").rglob("*.png"))
    assert clean.samefile(str(clean).replace("cleanpass", "finalpass"))


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_middlebury(closed_form_set, exports, split):
    root = exports["middlebury"] / split
    expected = samples(closed_form_set, split)
    for pairs, sample in zip(read_middlebury_2014(root), expected, strict=True):
        for pair in pairs:
            same(pair, sample, np.isfinite(sample.depth))
    for pair, sample in zip(read_middeval3(root), expected, strict=True):
        same(pair, sample, np.isfinite(sample.depth) & ~sample.occluded)
    for scene, sample in zip(sorted((root / "2014").iterdir()), expected, strict=True):
        mask = read_grey(scene / "mask0nocc.png")
        assert np.array_equal(mask == 0, np.isinf(sample.depth)) and np.array_equal(mask == 128, sample.occluded)


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_eth3d(closed_form_set, exports, split):
    root, expected = exports["eth3d"] / split, samples(closed_form_set, split)
    for pair, sample in zip(read_eth3d(root), expected, strict=True):
        same(pair, sample, np.isfinite(sample.depth))


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_openstereo(closed_form_set, exports, split):
    expected = samples(closed_form_set, split)
    for pair, sample in zip(read_openstereo(exports["openstereo"], split), expected, strict=True):
        same(pair, sample, np.isfinite(sample.depth))


@pytest.mark.parametrize(
    ("name", "path", "truth"),
    [
        ("middlebury", "train/2014/00000_00/calib.txt", "train/2014/00000_00/disp0.pfm"),
        ("middlebury", "train/MiddEval3/trainingF/00000_00/calib.txt", "train/2014/00000_00/disp0.pfm"),
        ("eth3d", "train/two_view_training/00000_00/calib.txt", "train/two_view_training_gt/00000_00/disp0GT.pfm"),
        ("sceneflow", f"{THINGS}/calib/TRAIN/A/00000/0000.txt", f"{THINGS}/disparity/TRAIN/A/00000/left/0000.pfm"),
        ("openstereo", "calib/00000_00.txt", "disparity/left/00000_00.pfm"),
    ],
)  # fmt: skip
def test_middlebury_calibration_gives_depth(closed_form_set, exports, name, path, truth):
    sample = read_sample(closed_form_set / "scenes" / "00000" / "00")
    calib, disparity = read_calib(exports[name] / path), read_pfm(exports[name] / truth)
    assert np.allclose(calib["cam0"], sample.rig.camera.K) and np.array_equal(calib["cam0"], calib["cam1"])
    assert (calib["width"], calib["height"]) == (sample.rig.camera.width, sample.rig.camera.height)
    known = np.isfinite(sample.depth)
    depth = 1e-3 * calib["baseline"] * calib["cam0"][0, 0] / (disparity[known] + calib["doffs"])
    assert np.allclose(depth, sample.depth[known], rtol=1e-6)
    assert calib["vmin"] <= disparity[known].min() and disparity[known].max() <= calib["vmax"] < calib["ndisp"]


def test_middlebury_calibration_says_how_far_rows_are_apart(closed_form_set):
    sample = samples(closed_form_set, "train")[0]
    assert "dyavg=0\ndymax=0\n" in middlebury_calibration(sample, sample.valid)
    turned = cv2.Rodrigues(np.deg2rad([0.02, 0.0, 0.0]))[0]  # about the x axis: all rows move by about as much
    text = middlebury_calibration(replace(sample, meta={"right_rotation": turned.tolist()}), sample.valid)
    rows = sample.rig.camera.fy * np.deg2rad(0.02)
    values = dict(line.split("=") for line in text.splitlines())
    assert float(values["dyavg"]) == pytest.approx(rows, rel=0.2)
    assert rows < float(values["dymax"]) < 2 * rows


@pytest.mark.parametrize("name", FORMATS)
def test_every_sample_is_named_and_explained(exports, name):
    index = json.loads((exports[name] / "samples.json").read_text())
    assert {k: len(v) for k, v in index.items()} == {"train": 4, "test": 2, "val": 2}
    assert index["test"] == ["00001/00", "00001/01"]
    about = (exports[name] / "README.md").read_text()
    assert LAYOUTS[name].about in about and "Disparity is x_left - x_right" in about and "`samples.json` lists" in about
    assert "disparity of 0 or less" in about


# --- going on, and mistakes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMATS)
def test_an_interrupted_export_is_completed(closed_form_set, exports, tmp_path, name, monkeypatch):
    config = ExportConfig(closed_form_set, name, tmp_path / "out", workers=1)
    whole, calls = command.write_atomically, []

    def failing(path: Path, data: bytes) -> None:
        calls.append(path)
        if len(calls) > 20:
            raise OSError(28, "No space left on device", str(path))
        whole(path, data)

    with monkeypatch.context() as patch, pytest.raises(OSError):
        patch.setattr(command, "write_atomically", failing)
        export(config)
    there = contents(config.out)
    assert 5 < len(there) < len(contents(exports[name])) and "samples.json" not in there
    leftover = next(p for p in config.out.rglob("*") if p.is_file()).parent / ".half.png.77.part"
    leftover.write_bytes(b"half")
    (config.out / next(n for n in there if n.endswith((".png", ".pfm")))).write_bytes(b"")  # a crash of the machine
    export(config)
    assert contents(config.out) == contents(exports[name])


KILLED = """
import os, signal, sys
from marssim import export
whole, calls = export.write_atomically, []
def deadly(path, data):
    calls.append(path)
    if len(calls) == 25:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.with_name(f".{path.name}.{os.getpid()}.part").write_bytes(data[:10])
        os.kill(os.getpid(), signal.SIGKILL)
    whole(path, data)
export.write_atomically = deadly
sys.exit(export.main(sys.argv[1:]))
"""


def test_a_killed_export_is_completed_by_the_same_command(closed_form_set, exports, tmp_path, capfd):
    args = [str(a) for a in (closed_form_set, "--format", "middlebury", "--out", tmp_path / "out")]
    ended = subprocess.run([sys.executable, "-c", KILLED, *args, "--workers", "1"], capture_output=True, text=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    assert list((tmp_path / "out").rglob("*.part")) and not (tmp_path / "out" / "samples.json").exists()
    assert run(capfd, *args)[0] == 0
    assert contents(tmp_path / "out") == contents(exports["middlebury"])


def test_a_full_disk_is_one_line_and_the_export_goes_on_later(closed_form_set, exports, tmp_path, capfd):
    pytest.importorskip("resource")  # not on Windows
    program = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (10000, 10000))\n"
        "from marssim import export; sys.exit(export.main(sys.argv[1:]))"
    )  # images are smaller, disparities of 48 x 64 floats larger
    args = [str(a) for a in (closed_form_set, "--format", "openstereo", "--out", tmp_path / "out")]
    ended = subprocess.run([sys.executable, "-c", program, *args], capture_output=True, text=True)
    lines = [line for line in ended.stderr.splitlines() if line.startswith("error:")]
    assert ended.returncode == 2 and "Traceback" not in ended.stderr
    assert len(lines) == 1 and ".pfm: file too large" in lines[0]
    assert not list((tmp_path / "out").rglob("*.part")) and not (tmp_path / "out" / "train.txt").exists()
    assert run(capfd, *args)[0] == 0
    assert contents(tmp_path / "out") == contents(exports["openstereo"])


def test_existing_files_are_not_written_again(exports, closed_form_set, tmp_path):
    out = shutil.copytree(exports["kitti"], tmp_path / "out")
    image = out / "train/training/image_2/000000_10.png"
    before = image.stat().st_mtime_ns
    export(ExportConfig(closed_form_set, "kitti", out))
    assert image.stat().st_mtime_ns == before


def test_the_files_do_not_depend_on_the_workers(exports, closed_form_set, tmp_path):
    config = ExportConfig(closed_form_set, "middlebury", tmp_path / "out", workers=5)
    export(config)
    assert contents(config.out) == contents(exports["middlebury"])


def test_without_hard_links_files_are_copied(exports, closed_form_set, tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(command.os, "link", refuse)
    export(ExportConfig(closed_form_set, "middlebury", tmp_path / "out"))
    assert contents(tmp_path / "out") == contents(exports["middlebury"])


def test_an_export_of_one_split(closed_form_set, tmp_path, capfd):
    code, _ = run(capfd, closed_form_set, "--format", "openstereo", "--out", tmp_path / "o", "--split", "val")
    assert code == 0
    assert not (tmp_path / "o" / "train.txt").exists() and len(list((tmp_path / "o" / "left").iterdir())) == 2


@pytest.mark.parametrize(
    ("name", "path"), [("openstereo", "{}.txt"), ("middlebury", "{}/MiddEval3/official_train.txt")]
)
def test_a_split_without_pairs_has_an_empty_list(closed_form_set, tmp_path, name, path):
    """Trainers open the lists of all splits."""
    data = shutil.copytree(closed_form_set, tmp_path / "set")
    index = json.loads((data / "dataset.json").read_text())
    index["samples"] = [s for s in index["samples"] if s["split"] == "train"]
    (data / "dataset.json").write_text(json.dumps(index))
    export(ExportConfig(data, name, tmp_path / "out", split=("train", "val")))
    sizes = {split: (tmp_path / "out" / path.format(split)).stat().st_size for split in ("train", "val")}
    assert sizes["val"] == 0 < sizes["train"] and not (tmp_path / "out" / path.format("test")).exists()
    assert json.loads((tmp_path / "out" / "samples.json").read_text())["val"] == []


def test_another_export_in_the_folder(exports, closed_form_set, tmp_path, capfd):
    out = shutil.copytree(exports["kitti"], tmp_path / "out")
    before = contents(out)
    for args, message in (
        (("--format", "eth3d"), "format kitti"),
        (("--format", "kitti", "--split", "val"), "split train val test"),
    ):
        code, err = run(capfd, closed_form_set, "--out", out, *args)
        assert code == 2 and "export.json" in err and message in err and len(err.splitlines()) == 1
    other = shutil.copytree(closed_form_set, tmp_path / "set")
    index = json.loads((other / "dataset.json").read_text())
    index["samples"][0]["sha256"] = "0" * 64
    (other / "dataset.json").write_text(json.dumps(index))
    code, err = run(capfd, other, "--format", "kitti", "--out", out)
    assert code == 2 and "other data" in err and len(err.splitlines()) == 1
    assert contents(out) == before


def test_a_folder_of_other_files_is_left_alone(closed_form_set, tmp_path, capfd):
    (tmp_path / "thesis.tex").write_text("years of work")
    for out in (tmp_path, tmp_path / "thesis.tex", closed_form_set):
        before = contents(tmp_path), contents(closed_form_set)
        code, err = run(capfd, closed_form_set, "--format", "kitti", "--out", out)
        assert code == 2 and str(out) in err and "--out" in err and len(err.splitlines()) == 1
        assert (contents(tmp_path), contents(closed_form_set)) == before


def test_a_file_in_place_of_a_folder_is_reported_with_the_flag(closed_form_set, tmp_path, capfd):
    (tmp_path / "thesis.tex").write_text("years of work")
    out = tmp_path / "thesis.tex" / "kitti"
    assert run(capfd, closed_form_set, "--format", "kitti", "--out", out) == (2, f"error: --out {out}: not a directory")


@pytest.mark.parametrize("place", ["scenes/00000", "scenes/00000/00", "kitti", "scenes/../new/deep", "link/new"])
def test_an_export_into_the_dataset_is_refused(closed_form_set, tmp_path, place, capfd):
    data = shutil.copytree(closed_form_set, tmp_path / "set")
    (tmp_path / "link").symlink_to(data / "scenes")
    out = tmp_path / place if place.startswith("link") else data / place
    before = sorted(tmp_path.rglob("*"))
    code, err = run(capfd, data, "--format", "kitti", "--out", out)
    assert code == 2 and err.startswith(f"error: --out {out}: lies in the dataset") and len(err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_an_export_around_the_dataset_is_refused(exports, closed_form_set, tmp_path, capfd):
    """A folder that holds the same export, to which the dataset was moved since: what lies in it is not all its own."""
    out = shutil.copytree(exports["kitti"], tmp_path / "out")
    data = shutil.copytree(closed_form_set, out / "set")
    half = data / "scenes" / ".dataset.json.7.part"  # of a command that writes to the dataset now
    half.touch()
    before = contents(out)
    code, err = run(capfd, data, "--format", "kitti", "--out", out)
    assert code == 2 and err.startswith(f"error: --out {out}: contains the dataset") and len(err.splitlines()) == 1
    assert contents(out) == before


@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_a_second_command_in_the_folder_is_refused(exports, closed_form_set, tmp_path, capfd):
    out = shutil.copytree(exports["kitti"], tmp_path / "out")
    with lock.sole_writer(out):
        code, err = run(capfd, closed_form_set, "--format", "kitti", "--out", out)
    assert code == 2 and len(err.splitlines()) == 1 and f"{out}: another command (process " in err
    assert contents(out) == contents(exports["kitti"])


@pytest.mark.parametrize(
    ("args", "named"),
    [
        (("--format", "caltech", "--out", "o"), "--format"),
        (("--format", "kitti", "--out", "o", "--workers", "0"), "--workers"),
        (("--format", "kitti", "--out", "o", "--split", "train", "train"), "--split"),
        (("--format", "kitti", "--out", "o", "--split", "all"), "all"),
        (("--format", "sceneflow", "--out", "cleft/o"), "left"),
        (("--format", "kitti"), "--out"),
    ],
)
def test_bad_values_name_their_flag(closed_form_set, tmp_path, monkeypatch, args, named, capfd):
    monkeypatch.chdir(tmp_path)
    code, err = run(capfd, closed_form_set, *args)
    assert code == 2 and named in err and err.startswith("error: ") and len(err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_no_dataset_and_an_empty_split(closed_form_set, tmp_path, capfd):
    code, err = run(capfd, tmp_path / "nowhere", "--format", "kitti", "--out", tmp_path / "o")
    assert code == 2 and "nowhere" in err and len(err.splitlines()) == 1
    other = shutil.copytree(closed_form_set, tmp_path / "set")
    index = json.loads((other / "dataset.json").read_text())
    index["samples"] = [s for s in index["samples"] if s["split"] == "train"]
    (other / "dataset.json").write_text(json.dumps(index))
    code, err = run(capfd, other, "--format", "kitti", "--out", tmp_path / "o", "--split", "test", "val")
    assert code == 2 and "test val" in err and len(err.splitlines()) == 1 and not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("name", "message"), [("left.png", "readable"), ("depth.png", "readable"), ("sample.json", "is not JSON")]
)
def test_a_broken_sample_is_named_and_nothing_of_it_is_written(closed_form_set, tmp_path, name, message, capfd):
    other = shutil.copytree(closed_form_set, tmp_path / "set")
    file = other / "scenes" / "00000" / "00" / name
    file.write_bytes(b"{" + file.read_bytes()[:40])
    code, err = run(capfd, other, "--format", "eth3d", "--out", tmp_path / "o", "--split", "train")
    assert code == 2 and str(file) in err and message in err and len(err.splitlines()) == 1
    assert not list((tmp_path / "o").rglob("00000_00/im0.png"))
    shutil.copytree(closed_form_set, other, dirs_exist_ok=True)
    assert run(capfd, other, "--format", "eth3d", "--out", tmp_path / "o", "--split", "train")[0] == 0


def test_an_image_of_other_content_is_not_exported(closed_form_set, tmp_path, capfd):
    other = shutil.copytree(closed_form_set, tmp_path / "set")
    file = other / "scenes" / "00000" / "00" / "right.png"
    shutil.copy(file.with_name("left.png"), file)
    code, err = run(capfd, other, "--format", "kitti", "--out", tmp_path / "o")
    assert code == 2 and str(file) in err and "records" in err and len(err.splitlines()) == 1


def test_each_sample_may_have_its_own_rig(closed_form_set, tmp_path):
    """Calibration is written per sample, whatever the others have."""
    other = shutil.copytree(closed_form_set, tmp_path / "set")
    file = other / "scenes" / "00000" / "01" / "sample.json"
    meta = json.loads(file.read_text())
    meta["rig"]["baseline"] = 0.5
    file.write_text(json.dumps(meta))
    export(replace(ExportConfig(other, "eth3d", tmp_path / "o"), split=("train",)))
    calib = [read_calib(p)["baseline"] for p in sorted((tmp_path / "o/train/two_view_training").glob("*/calib.txt"))]
    assert calib == [270, 500, 270, 270]


def test_far_ground_without_a_positive_disparity_counts_as_unknown(closed_form_set, tmp_path):
    """The right image lies 6 px too far right, so that ground beyond 3 m has none."""
    folder = shutil.copytree(closed_form_set / "scenes" / "00000" / "00", tmp_path / "00")
    meta = json.loads((folder / "sample.json").read_text())
    turn = cv2.Rodrigues(np.array([0.0, -np.arctan(6 / meta["rig"]["fx"]), 0.0]))[0]
    (folder / "sample.json").write_text(json.dumps({**meta, "right_rotation": turn.tolist()}))
    item = Item(folder, "00000/00", "train", 0)
    far = np.isfinite(item.sample.depth) & (item.sample.disparity <= 0)
    assert far.any() and item.labelled.any() and not (item.labelled & far).any()
    assert (kitti_code(item.sample.disparity, item.labelled)[far] == 0).all()
