import hashlib
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import NATECAM
from marssim.base.dataset import sample as sample_module
from marssim.base.dataset.dataset import StereoDataset, split_of, write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import IMAGES, is_complete, read_sample, sample_digest, write_sample
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.files.png import decode_png, encode_png
from marssim.base.pose import look_pose
from marssim.render.renderers.embree_renderer import EmbreeRenderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

NAMES = [f"{scene:05d}/{view:02d}" for scene in range(3) for view in range(2)]  # train, test, val


@pytest.fixture(scope="module")
def frame() -> StereoFrame:
    scene = build_scene(SceneConfig(size=8.0, horizon=16.0, rocks=RockConfig(k=0.1)), np.random.default_rng(1))
    renderer = EmbreeRenderer(scene)
    rng = np.random.default_rng(0)
    pose = look_pose(np.array([0.0, 0.0, 1.3]), 0.3, np.deg2rad(15))
    frame = render_stereo(renderer, Shader(scene), NATECAM.resized(96, 80), pose, Sensor.draw(SensorConfig(), rng), rng)
    renderer.close()
    return frame


@pytest.fixture(scope="module")
def written(frame, tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "set"
    for name in NAMES:
        write_sample(path / "scenes" / name, frame, {"scene": int(name[:5]), "view": int(name[-2:])})
    write_index(path, {"seed": 3}, NAMES)
    return path


@pytest.fixture
def dataset(written, tmp_path):
    """A copy of the dataset that a test may break."""
    return shutil.copytree(written, tmp_path / "set")


def test_a_rendered_frame_comes_back(frame, tmp_path):
    write_sample(tmp_path / "00000" / "00", frame, {"scene": 0, "sun_elevation_deg": 30.0})
    sample = read_sample(tmp_path / "00000" / "00")
    assert np.array_equal(sample.left, frame.left) and np.array_equal(sample.right, frame.right)
    assert sample.left[..., 0].mean() > sample.left[..., 2].mean()  # red comes first: Mars is not blue
    hit = frame.surface >= 0
    assert 0.1 < hit.mean() < 1 and (frame.surface > 0).any() and frame.occluded.any()
    assert np.allclose(sample.depth[hit], frame.depth[hit], rtol=7.5e-5) and np.isinf(sample.depth[~hit]).all()
    assert np.allclose(sample.disparity, frame.disparity, rtol=1e-4, atol=1e-3) and not sample.disparity[~hit].any()
    assert np.allclose(sample.normal, frame.normal, atol=1e-4)
    assert np.array_equal(sample.occluded, frame.occluded)
    assert np.array_equal(sample.rock, np.maximum(frame.surface, 0))
    assert np.array_equal(sample.valid, (sample.depth >= 0.5) & (sample.depth <= 15))
    assert sample.rig == frame.rig and np.allclose(sample.meta["pose"], frame.pose)
    assert sample.meta["scene"] == 0 and sample.meta["sun_elevation_deg"] == 30.0
    assert set(sample.meta["sha256"]) == set(IMAGES)
    for name in ("depth", "disparity", "normal"):
        assert getattr(sample, name).dtype == np.float32
    assert not list(tmp_path.rglob("*.partial"))


def test_writing_again_replaces_and_gives_the_same_hash(frame, tmp_path):
    folder = tmp_path / "00"
    write_sample(folder, frame, {"view": 0})
    first, images = sample_digest(folder), read_sample(folder).meta["sha256"]
    write_sample(folder, frame, {"view": 0})
    assert sample_digest(folder) == first
    write_sample(folder, frame, {"view": 1})
    assert sample_digest(folder) != first and read_sample(folder).meta["sha256"] == images
    assert read_sample(folder).meta["view"] == 1 and is_complete(folder)
    assert [p.name for p in tmp_path.iterdir()] == ["00"]


def test_a_whole_sample_can_be_kept(frame, tmp_path):
    """A worker that was taken for lost does not replace what its successor has written."""
    folder = tmp_path / "00"
    for number in (0, 1):
        write_sample(folder, frame, {"view": number}, replace=False)
    assert read_sample(folder).meta["view"] == 0
    (folder / "left.png").unlink()
    write_sample(folder, frame, {"view": 2}, replace=False)
    assert read_sample(folder).meta["view"] == 2
    assert [p.name for p in tmp_path.iterdir()] == ["00"]


def test_two_who_write_the_same_sample_do_not_disturb_each_other(frame, tmp_path, monkeypatch):
    """One process renames its folder into place just after the other has done so."""
    folder, rename = tmp_path / "00", Path.rename

    def overtaken(path: Path, target: Path) -> Path:
        monkeypatch.setattr(Path, "rename", rename)
        write_sample(folder, frame, {"view": 0})
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", overtaken)
    write_sample(folder, frame, {"view": 0})
    assert is_complete(folder) and [p.name for p in tmp_path.iterdir()] == ["00"]


def test_a_sample_that_cannot_be_written_leaves_nothing(frame, tmp_path, monkeypatch):
    write_bytes = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.name == "sample.json":
            raise OSError(28, "No space left on device")
        return write_bytes(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space"):
        write_sample(tmp_path / "00", frame, {})
    assert list(tmp_path.iterdir()) == []


def test_a_dataset_is_a_sequence(written):
    dataset = StereoDataset(written)
    assert len(dataset) == 6 and len(list(dataset)) == 6
    assert [(s.meta["scene"], s.meta["view"]) for s in dataset] == [(n // 2, n % 2) for n in range(6)]
    assert dataset[-1].meta["scene"] == 2
    assert [s.meta["view"] for s in dataset[1:4]] == [1, 0, 1] and dataset[6:] == []
    with pytest.raises(IndexError, match=r"the dataset holds 6 pairs, there is no index 6"):
        dataset[6]
    assert dataset.index["config"] == {"seed": 3}
    assert StereoDataset(str(written)).digest == dataset.digest


@pytest.mark.parametrize("twin", [{}, {"split": "test"}, {"name": "0/00"}])
def test_a_pair_that_the_index_lists_twice_is_refused(tmp_path, twin):
    pair = {"name": "00000/00", "split": "train", "sha256": "0"}
    index = {"schema": "marssim-stereo", "version": 3, "config": {}, "samples": [pair]}
    write_json(tmp_path / "dataset.json", index)
    assert len(StereoDataset(tmp_path)) == 1
    write_json(tmp_path / "dataset.json", {**index, "samples": [pair, {**pair, **twin}]})
    with pytest.raises(DatasetError, match=r"dataset\.json: lists scene 0, view 0 more than once"):
        StereoDataset(tmp_path)


def test_splits_share_no_scene_and_make_up_all(written):
    parts = {name: StereoDataset(written, name) for name in ("train", "val", "test")}
    assert sorted(name for part in parts.values() for name in part.names) == NAMES
    scenes = {name: {n[:5] for n in part.names} for name, part in parts.items()}
    assert scenes == {"train": {"00000"}, "test": {"00001"}, "val": {"00002"}}
    assert len({part.digest for part in parts.values()}) == 1  # of all splits
    with pytest.raises(ValueError, match=r"'dev'.*train, val, test"):
        StereoDataset(written, "dev")


@given(start=st.integers(0, 10_000))
def test_any_ten_scenes_are_split_seven_two_one(start):
    splits = [split_of(scene) for scene in range(start, start + 10)]
    assert [splits.count(name) for name in ("train", "val", "test")] == [7, 2, 1]


@pytest.mark.parametrize("name", IMAGES)
def test_a_broken_image_is_named(dataset, name):
    file = dataset / "scenes" / NAMES[1] / name
    whole = file.read_bytes()
    for content in (whole[: len(whole) // 2], b"", b"no image"):
        file.write_bytes(content)
        with pytest.raises(DatasetError, match=rf"{NAMES[1]}/{name}: not a readable image"):
            StereoDataset(dataset)[1]
    file.unlink()
    with pytest.raises(DatasetError, match=rf"{NAMES[1]}/{name}: no such file"):
        StereoDataset(dataset)[1]
    assert not is_complete(file.parent)
    assert StereoDataset(dataset)[0].meta["view"] == 0  # the others are unharmed


@pytest.mark.parametrize("name", IMAGES)
def test_an_image_of_another_shape_or_type_is_named(dataset, name):
    file = dataset / "scenes" / NAMES[0] / name
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    for wrong in (image[:-1], np.zeros((*image.shape[:2], 4), image.dtype), (image > 0).astype(np.uint8)):
        if wrong.shape == image.shape and wrong.dtype == image.dtype:
            continue
        cv2.imwrite(str(file), wrong)
        with pytest.raises(DatasetError, match=name):
            StereoDataset(dataset)[0]


@pytest.mark.parametrize(
    "content", ["", "{", "[1]", "{}", '{"rig": 3}', '{"rig": {"width": 96}}', '{"rig": ' + "[" * 10**5]
)
def test_a_broken_sample_json_is_named(dataset, content):
    (dataset / "scenes" / NAMES[0] / "sample.json").write_text(content)
    with pytest.raises(DatasetError, match=rf"{NAMES[0]}/sample.json"):
        StereoDataset(dataset)[0]


def test_a_rig_of_another_image_size_is_named(dataset):
    file = dataset / "scenes" / NAMES[0] / "sample.json"
    meta = json.loads(file.read_text())
    meta["rig"]["width"] = 512
    file.write_text(json.dumps(meta))
    with pytest.raises(DatasetError, match=r"512 x 80"):
        StereoDataset(dataset)[0]


def test_an_image_of_another_size_is_refused_before_it_is_decoded(dataset, monkeypatch):
    file = dataset / "scenes" / NAMES[0] / "surface.png"
    file.write_bytes(encode_png(np.zeros((300, 400), np.uint16)))
    decoded = []
    monkeypatch.setattr(sample_module, "decode_png", lambda data: decoded.append(data) or decode_png(data))
    with pytest.raises(DatasetError, match=r"surface\.png: must be \d+ x \d+ px as the rig says, is 400 x 300 px$"):
        StereoDataset(dataset)[0]
    assert file.read_bytes() not in decoded
    file.write_bytes(file.read_bytes()[:20])
    with pytest.raises(DatasetError, match=r"surface\.png: not a readable image$"):
        StereoDataset(dataset)[0]


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"schema": "other", "version": 1, "samples": []}'])
def test_a_broken_index_is_named(dataset, content):
    (dataset / "dataset.json").write_text(content)
    with pytest.raises(DatasetError, match=r"dataset\.json"):
        StereoDataset(dataset)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("version", 99),
        ("samples", None),
        ("samples", [{"name": "00000/00"}]),
        ("samples", [{"name": "../../outside", "split": "train", "sha256": ""}]),
        ("samples", ["00000/00"]),
    ],
)
def test_an_index_that_cannot_be_read_is_named(dataset, field, value):
    index = json.loads((dataset / "dataset.json").read_text())
    index[field] = value
    (dataset / "dataset.json").write_text(json.dumps(index))
    with pytest.raises(DatasetError, match=r"dataset\.json.*" + ("99" if field == "version" else "sample")):
        StereoDataset(dataset)


def test_an_index_holds_the_plain_hash_of_each_sample_json(written):
    for sample in StereoDataset(written).index["samples"]:
        file = written / "scenes" / sample["name"] / "sample.json"
        assert sample["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize("version", [1, 2, 3])
def test_all_versions_are_read(dataset, version):
    index = json.loads((dataset / "dataset.json").read_text())
    assert index["version"] == 3
    (dataset / "dataset.json").write_text(json.dumps({**index, "version": version}))
    assert StereoDataset(dataset)[0].meta["view"] == 0


def test_a_dataset_of_version_2_is_read_with_the_disparity_of_the_ideal_rig():
    """The folder was written by version 0.1.0, with a right image that was turned by half a degree."""
    old = StereoDataset(Path(__file__).parent / "version_2")
    assert old.index["version"] == 2 and "right_rotation" not in old[0].meta
    assert old[0].meta["sensor"]["rotation_deg"] == 0.5
    assert np.array_equal(old[0].disparity, old[0].rig.depth_to_disparity(old[0].depth))
    assert np.isfinite(old[0].depth).mean() > 0.5 and old[0].occluded.any() and old[0].left.std() > 5


def test_the_disparity_read_is_that_of_the_turned_camera(frame, dataset):
    file = dataset / "scenes" / NAMES[0] / "sample.json"
    meta = json.loads(file.read_text())
    assert np.allclose(meta["right_rotation"], frame.right_rotation, atol=0)
    turn = cv2.Rodrigues(np.array([0.0, -2 / frame.rig.camera.fx, 0.0]))[0]  # two pixels at the principal point
    file.write_text(json.dumps({**meta, "right_rotation": turn.tolist()}))
    turned = StereoDataset(dataset)[0]
    ideal = turned.rig.depth_to_disparity(turned.depth)
    hit = np.isfinite(turned.depth)
    assert np.median((ideal - turned.disparity)[hit]) == pytest.approx(2, abs=0.3)
    assert not turned.disparity[~hit].any()


@pytest.mark.parametrize("value", [3, [[1, 0], [0, 1]], [[1, 0, 0], [0, 1, 0], [0, 0, 2]], "x"])
def test_a_rotation_that_is_none_is_named(dataset, value):
    file = dataset / "scenes" / NAMES[0] / "sample.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "right_rotation": value}))
    with pytest.raises(DatasetError, match=rf"{NAMES[0]}/sample\.json: right_rotation is not a 3 x 3 rotation"):
        StereoDataset(dataset)[0]


def test_an_unfinished_dataset_says_what_completes_it(dataset):
    (dataset / "dataset.json").unlink()
    shutil.rmtree(dataset / "scenes" / NAMES[2])
    write_json(dataset / "generate.json", {"seed": 3, "command": "--pairs 6 --seed 3 --scene gale"})
    command = f"python -m marssim.generate --out {dataset} --pairs 6 --seed 3 --scene gale completes it"
    with pytest.raises(DatasetError, match=rf"^{dataset}: not finished, it has 5 pairs; {command}$"):
        StereoDataset(dataset)
    write_json(dataset / "generate.json", {"command": "--pairs 6; touch ~/mine $(touch mine) --scene 'my place.json'"})
    command = "--pairs '6;' touch '~/mine' '$(touch' 'mine)' --scene 'my place.json' completes it"
    with pytest.raises(DatasetError, match=rf"--out {dataset} {re.escape(command)}$"):
        StereoDataset(dataset)
    for command in (None, "--pairs 6 --scene 'gale", "--pairs 6\x1b[2J"):
        write_json(dataset / "generate.json", {"seed": 3, "command": command})
        with pytest.raises(DatasetError, match="it has 5 pairs; the call that began it completes it"):
            StereoDataset(dataset)


def test_a_path_without_a_dataset_is_named(tmp_path):
    (tmp_path / "README.md").touch()
    with pytest.raises(DatasetError, match=r"README\.md: is a file; give the dataset's folder"):
        StereoDataset(tmp_path / "README.md")
    with pytest.raises(DatasetError, match=r"nowhere: no such folder"):
        StereoDataset(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match=r"holds no dataset of marssim, as dataset\.json is missing; give"):
        StereoDataset(tmp_path)


def test_an_empty_split_is_named(dataset):
    index = json.loads((dataset / "dataset.json").read_text())
    index["samples"] = [s for s in index["samples"] if s["split"] != "val"]
    (dataset / "dataset.json").write_text(json.dumps(index))
    val = StereoDataset(dataset, split="val")
    assert len(val) == 0 and list(val) == [] and val[:] == []
    with pytest.raises(IndexError, match=rf"{dataset}: split val holds no pairs"):
        val[0]


def test_the_index_needs_every_sample(written, tmp_path):
    with pytest.raises(DatasetError, match=r"00009/00/sample\.json"):
        write_index(written, {}, [*NAMES, "00009/00"])
    assert len(StereoDataset(written)) == 6  # the index that was there stands


def test_the_digest_follows_every_file_of_a_sample(frame, dataset):
    file, before = dataset / "scenes" / NAMES[0] / "sample.json", StereoDataset(dataset).digest
    file.write_text(file.read_text().replace('"view": 0', '"view": 7'))
    write_index(dataset, {"seed": 3}, NAMES)
    before, renamed = StereoDataset(dataset).digest, before
    assert before != renamed
    changed = frame.left.copy()
    changed[0, 0] ^= 1
    write_sample(dataset / "scenes" / NAMES[0], StereoFrame(**{**vars(frame), "left": changed}), {})
    write_index(dataset, {"seed": 3}, NAMES)
    assert StereoDataset(dataset).digest != before


def test_json_is_replaced_in_one_step(tmp_path):
    file = tmp_path / "a.json"
    write_json(file, {"b": [1, 2.5, None]})
    write_json(file, {"b": 2})
    assert read_json(file) == {"b": 2} and [p.name for p in tmp_path.iterdir()] == ["a.json"]
    with pytest.raises(TypeError):
        write_json(file, {"b": object()})
    assert read_json(file) == {"b": 2}


@pytest.mark.parametrize("name", ["sample.json", *IMAGES])
def test_a_sample_with_an_empty_file_is_not_complete(tmp_path, name):
    for each in ("sample.json", *IMAGES):
        (tmp_path / each).write_bytes(b"x")
    assert is_complete(tmp_path)
    (tmp_path / name).write_bytes(b"")  # as after a power loss
    assert not is_complete(tmp_path)
