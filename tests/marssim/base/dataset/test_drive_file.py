import io
import json
import os
import zipfile

import numpy as np
import pytest
from recorded_drives import RIG, content, drive_bytes, drive_of, look_pictures, step

from marssim.base.dataset.drive_file import (
    INDEX,
    NEAREST,
    SKY,
    depth_codes,
    depth_of,
    drive_schema,
    encode_drive,
    error_codes,
    height_codes,
    height_of,
    read_drive,
)
from marssim.base.files.json_file import DatasetError
from marssim.base.files.png import encode_png


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "drive.zip"
    path.write_bytes(drive_bytes())
    return path


def rewritten(path, change, name=INDEX):
    """The archive with one member changed: change(bytes) returns the new one, or None to leave it out."""
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    members[name] = change(members.get(name, b""))
    with zipfile.ZipFile(path, "w") as archive:
        for member, data in members.items():
            if data is not None:
                archive.writestr(member, data)


def packed(path, packing):
    """The archive with its members packed another way."""
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    with zipfile.ZipFile(path, "w", packing) as archive:
        for member, data in members.items():
            archive.writestr(member, data)


def twice(path):
    """The archive with one more file of the index's name."""
    with pytest.warns(UserWarning, match="Duplicate name"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr(INDEX, b"{}")


def edited(path, *keys, value):
    """The index with the value at some keys replaced."""

    def change(data):
        index = json.loads(data)
        place = index
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value
        return json.dumps(index).encode()

    rewritten(path, change)


def test_depth_survives_as_codes_within_a_quarter_of_a_percent_with_sky_and_unknown():
    depth = np.array([np.nan, np.inf, NEAREST, 0.5, 3.0, 12.0, 79.0, 500.0])
    codes = depth_codes(depth)
    assert codes.dtype == np.uint16 and codes[0] == 0 and codes[1] == SKY
    np.testing.assert_allclose(depth_of(codes), depth, rtol=2.1e-3)


def test_errors_are_percents_about_128_and_zero_where_nothing_is_scored():
    depth = np.array([3.0, 3.15, 2.7, 30.0, np.nan, np.inf, 3.0])
    codes = error_codes(depth, np.full(7, 3.0), np.arange(7) < 6)
    np.testing.assert_array_equal(codes, [128, 133, 117, 255, 0, 255, 0])


def test_a_drive_comes_back_as_it_was_written(tmp_path):
    depth = np.geomspace(0.6, 60, 64).reshape(8, 8)
    depth[0, 0], depth[0, 1] = np.nan, np.inf
    steps = [step(looked=True), step(x=0.4), step(x=0.8, outcome="goal")]
    drive = drive_of(tmp_path / "a.zip", steps, look_pictures(0, depth))
    assert drive.steps == steps and drive.rig == RIG
    np.testing.assert_allclose(drive.depth(0), depth, rtol=2.1e-3)
    assert (drive.confidence(0) == 1).all() and drive.depth(1) is None and drive.confidence(1) is None
    assert drive.picture("left", 0).startswith(b"\xff\xd8") and drive.picture("left", 1) is None
    assert encode_drive(content(steps), look_pictures(0, depth)) == (tmp_path / "a.zip").read_bytes()


def test_what_is_not_finite_is_written_as_null(tmp_path):
    with pytest.raises(DatasetError, match=r"a\.zip: steps\[0\]\.clearance must be of type number, got None"):
        drive_of(tmp_path / "a.zip", [step(clearance=float("inf"))])


def test_the_schema_describes_every_value():
    def parts(schema):
        yield schema
        for part in [*schema.get("properties", {}).values(), *filter(None, [schema.get("items")])]:
            yield from parts(part)

    for part in parts(drive_schema()):
        assert set(part.get("required", ())) <= set(part.get("properties", {}))
        for name, value in part.get("properties", {}).items():
            assert value.get("description"), name


@pytest.mark.parametrize(("keys", "value", "fault"), [
    (("format",), "other", "drive.json is not that of a recorded drive"),
    (("version",), 2, "is of version 2, not 1"),
    (("rover", "max_speed"), "fast", "rover.max_speed must be of type number, got 'fast'"),
    (("rover", "pan_limit"), -1, "rover.pan_limit must be at least 0, got -1"),
    (("steps",), [], "steps must have 1 or more items, got 0"),
    (("steps", 1, "tilt_deg"), "steep", "steps[1].tilt_deg must be of type number, got 'steep'"),
    (("steps", 1, "pose"), [[1, 0, 0, 0]] * 2, "steps[1].pose must have 3 items, got 2"),
    (("steps", 0, "contact"), "<b>", "steps[0].contact must be one of none, chassis, obstacle, got '<b>'"),
    (("steps", 0, "chosen"), 7, "steps[0].chosen must be one of the 2 candidates, got 7"),
    (("steps", 0, "chosen"), 1, "steps[0].chosen must be a candidate with a cost, got 1, which has none"),
    (("steps", 0, "candidates", "free"), [1.0], "steps[0].candidates.free must have 2 items, as cost has, got 1"),
    (("steps", 0, "candidates", "parts", "way"), [], "steps[0].candidates.way must have 2 items"),
    (("rig", "width"), 0, "stereo rig: width must be at least 1 pixel"),
    (("rig", "width"), 5000, "rig has more than 4096 px along a side"),
])  # fmt: skip
def test_a_wrong_value_is_named_in_one_line(file, keys, value, fault):
    edited(file, *keys, value=value)
    with pytest.raises(DatasetError) as error:
        read_drive(file)
    assert str(error.value).startswith(f"{file}: {fault}") and "\n" not in str(error.value)


@pytest.mark.parametrize(("damage", "fault"), [
    (lambda path: path.unlink(), "no such file"),
    (lambda path: path.write_bytes(b""), "is not a whole zip archive"),
    (lambda path: path.write_bytes(path.read_bytes()[:-40]), "is not a whole zip archive"),
    (lambda path: path.write_bytes(path.read_bytes().replace(b"\xff\xd8\xff", b"\xff\xd8\x00", 1)), "is not a whole"),
    (lambda path: rewritten(path, lambda data: None), "holds no drive.json, so it is no recorded drive"),
    (lambda path: rewritten(path, lambda data: b"[1, 2"), "drive.json: is not JSON"),
    (lambda path: rewritten(path, lambda data: b"<svg>", "left/0000.jpg"), "left/0000.jpg is no JPEG file"),
    (lambda path: packed(path, zipfile.ZIP_LZMA), "is not a whole zip archive"),
    (lambda path: twice(path), "holds two files of one name"),
    (lambda path: rewritten(path, lambda data: b"GIF", "depth/0000.png"), "depth/0000.png is no PNG file"),
])  # fmt: skip
def test_a_file_that_is_broken_or_holds_something_else_is_refused_in_one_line(file, damage, fault):
    damage(file)
    with pytest.raises(DatasetError) as error:
        read_drive(file)
    assert str(error.value).startswith(f"{file}: {fault}") and "\n" not in str(error.value)


def test_a_picture_of_another_size_is_refused_before_it_is_unpacked(file):
    for wrong in (np.zeros((9, 8), np.uint16), np.zeros((8, 8), np.uint8)):
        rewritten(file, lambda data, wrong=wrong: encode_png(wrong), "depth/0000.png")
        with pytest.raises(DatasetError, match=r"depth/0000\.png must be a PNG of 8 x 8 px, 16 bits"):
            read_drive(file).depth(0)


def test_an_archive_that_unpacks_to_too_much_is_refused(file, monkeypatch):
    monkeypatch.setattr("marssim.base.dataset.drive_file.MOST_BYTES", 1 << 20)
    rewritten(file, lambda data: bytes(1 << 20), "left/0001.jpg")
    with pytest.raises(DatasetError, match="unpacks to more than 1 MiB"):
        read_drive(file)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_in_its_place_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "drive.zip")
    with pytest.raises(DatasetError, match=r"drive\.zip: is a pipe or a device, not a file$"):
        read_drive(tmp_path / "drive.zip")


def test_a_pickle_in_its_place_is_not_run(tmp_path):
    import pickle

    class Payload:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "run"),)

    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(INDEX, pickle.dumps(Payload()))
    (tmp_path / "a.zip").write_bytes(buffer.getvalue())
    with pytest.raises(DatasetError, match=r"drive\.json: is not JSON"):
        read_drive(tmp_path / "a.zip")
    assert not (tmp_path / "run").exists()


def test_heights_come_back_within_a_centimetre_and_unknown_ones_stay_unknown():
    heights = np.array([[-12.345, 0.0, 0.3], [np.nan, 650.0, 900.0]])
    back = height_of(height_codes(heights))
    np.testing.assert_allclose(back[0], heights[0], atol=0.0101)
    assert np.isnan(back[1, 0]) and back[1, 1] == pytest.approx(650) and back[1, 2] < 656  # beyond, the highest code


def test_the_largest_errors_are_not_taken_for_pixels_without_one():
    truth, scored = np.full(4, 10.0), np.array([True, True, True, False])
    assert error_codes(np.array([0.5, 2.0, 900.0, 2.0]), truth, scored).tolist() == [1, 1, 255, 0]
