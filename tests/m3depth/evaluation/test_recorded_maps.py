"""Files of other programs, read to the disparity and depth that they mean."""

import cv2
import numpy as np
import pytest

from m3depth.datasets.config import DataConfig
from m3depth.datasets.maps import read_map
from m3depth.datasets.open import open_pairs
from m3depth.evaluation.recorded_maps import RecordedError, RecordedPredictions
from m3depth.evaluation.report import AS_RECORDED, markdown_report, text_table
from m3depth.evaluation.scoring import evaluate
from m3depth.stereo.classical import SGBM
from m3depth.stereo.degradation import Degradation
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.files.pfm import encode_pfm

H, W = 12, 20
RIG = StereoRig(PinholeCamera.centred(W, H, 100.0), 0.27)
DISPARITY = np.linspace(1, 40, H * W).reshape(H, W).astype(np.float32)
PAIR, NUMBER = "00003/05", 7
CUT_PNG, CUT_TIFF = (
    cv2.imencode(ending, values)[1].tobytes()[:-100]
    for ending, values in ((".png", (DISPARITY * 256).astype(np.uint16)), (".tiff", DISPARITY))
)


def put(path, values):
    """Write a map by its ending."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".pfm":
        path.write_bytes(encode_pfm(values))
    else:
        assert cv2.imwrite(str(path), values)
    return path


@pytest.mark.parametrize(
    "name",
    [
        "00003/05",
        "00003_05",
        "000007_10",
        "000007",
        "00003_05/disparity",
        "00003/05/disparity",
        "000007/left_disparity",
    ],
)
@pytest.mark.parametrize("ending", ["npy", "pfm", "tiff", "tif", "png"])
def test_maps_are_found_by_every_name_and_ending(tmp_path, name, ending):
    stored = np.round(DISPARITY * 256).astype(np.uint16) if ending == "png" else DISPARITY
    put(tmp_path / f"{name}.{ending}", stored)
    recorded = RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG)
    assert recorded.disparity == pytest.approx(DISPARITY, abs=1 / 256)
    assert recorded.depth == pytest.approx(RIG.fb / recorded.disparity)
    assert recorded.normal is None and (recorded.confidence == 1).all()
    assert recorded.disparity.dtype == recorded.depth.dtype == np.float32


def test_depth_in_metres_and_millimetres(tmp_path):
    depth = RIG.disparity_to_depth(DISPARITY)
    put(tmp_path / "00003_05.png", np.round(depth * 1000).astype(np.uint16))
    recorded = RecordedPredictions(tmp_path, "depth").read(PAIR, NUMBER, RIG)
    assert recorded.depth == pytest.approx(depth, abs=6e-4)
    assert recorded.disparity == pytest.approx(RIG.fb / recorded.depth)
    put(tmp_path / "00003_05.npy", depth / 15)
    assert RecordedPredictions(tmp_path, "depth", 1 / 15).read(PAIR, NUMBER, RIG).depth == pytest.approx(
        depth, rel=1e-5
    )


def test_negative_disparities_have_a_negative_scale(tmp_path):
    """RAFT-Stereo's demo writes (H, W) npy of -d beside an 8-bit picture of the same name."""
    put(tmp_path / "00003_05.npy", -DISPARITY)
    put(tmp_path / "00003_05.png", np.zeros((H, W, 3), np.uint8))
    assert RecordedPredictions(tmp_path, scale=-1).read(PAIR, NUMBER, RIG).disparity == pytest.approx(DISPARITY)
    assert np.isnan(RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG).depth).all()


@pytest.mark.parametrize("shape", [(1, H, W), (H, W, 1), (1, 1, H, W)])
def test_axes_of_length_one_are_dropped(tmp_path, shape):
    put(tmp_path / "00003_05.npy", DISPARITY.reshape(shape).astype(np.float64))
    assert RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG).disparity == pytest.approx(DISPARITY)


def test_unknown_values_are_nan_and_zero_disparity_is_infinitely_far(tmp_path):
    values = DISPARITY.copy()
    values[0, :4] = [np.nan, np.inf, -3, 0]
    put(tmp_path / "00003_05.npy", values)
    recorded = RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG)
    assert np.isnan(recorded.disparity[0, :3]).all() and np.isnan(recorded.depth[0, :3]).all()
    assert recorded.disparity[0, 3] == 0 and np.isinf(recorded.depth[0, 3])
    put(tmp_path / "a" / "00003_05.png", np.zeros((H, W), np.uint16))
    assert np.isnan(RecordedPredictions(tmp_path / "a").read(PAIR, NUMBER, RIG).depth).all()


def test_normals_and_confidence_are_read_beside_a_map(tmp_path):
    normal = np.broadcast_to(np.float32([0, 0, -1]), (H, W, 3))
    sure = np.full((H, W), 0.4, np.float32)
    for maps, names in (
        ("flat/00003_05.npy", ("flat/00003_05_normal.npy", "flat/00003_05_confidence.npy")),
        ("folder/00003_05/disparity.npy", ("folder/00003_05/normal.npy", "folder/00003_05/confidence.npy")),
    ):
        for name, values in zip((maps, *names), (DISPARITY, normal, sure)):
            put(tmp_path / name, values)
        recorded = RecordedPredictions(tmp_path / maps.split("/")[0]).read(PAIR, NUMBER, RIG)
        assert np.array_equal(recorded.normal, normal) and np.array_equal(recorded.confidence, sure)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("RAFT=out/raft,scale=-1", ("RAFT", "out/raft", "disparity", -1.0)),
        ("Mine=depths,depth,scale=1000", ("Mine", "depths", "depth", 1000.0)),
        ("A=b", ("A", "b", "disparity", None)),
        ("A=b,fill", ("A", "b", "disparity", None)),
    ],
)
def test_the_form_of_the_flag_is_read(text, expected):
    name, recorded = RecordedPredictions.parse(text)
    assert (name, str(recorded.folder), recorded.kind, recorded.scale) == expected
    assert recorded.fill == text.endswith(",fill")


@pytest.mark.parametrize(
    "text", ["out", "=out", "A=", "A=out,metres", "A=out,scale=0", "A=out,scale=x", "A=out,scale=nan"]
)
def test_another_form_is_refused(text):
    with pytest.raises(ValueError, match=r"expected NAME=DIR|none of depth|scale must be"):
        RecordedPredictions.parse(text)


def test_unknown_pixels_are_filled_from_the_background_on_request(tmp_path):
    values = DISPARITY.copy()
    values[3, 4:7] = np.nan
    put(tmp_path / "00003_05.npy", values)
    recorded = RecordedPredictions(tmp_path, fill=True).read(PAIR, NUMBER, RIG)
    assert (recorded.disparity[3, 4:7] == values[3, 3]).all() and (recorded.confidence == 0).sum() == 3
    assert recorded.depth == pytest.approx(RIG.fb / recorded.disparity)
    put(tmp_path / "00003_05_confidence.npy", np.full(values.shape, 0.8, np.float32))
    recorded = RecordedPredictions(tmp_path, fill=True).read(PAIR, NUMBER, RIG)
    assert (recorded.confidence[3, 4:7] == 0).all() and (recorded.confidence == np.float32(0.8)).sum() == H * W - 3


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("00003_05.png", np.zeros((H, W), np.uint8), "is an 8-bit picture"),
        ("00003_05.npy", DISPARITY[:5], r"is of shape \(5, 20\), the pair's images are of shape \(12, 20\)"),
        ("00003_05.npy", np.array([{"a": 1}], object), "holds no map that can be read"),
        ("00003_05.npy", b"\x93NUMPY", "holds no map that can be read"),
        ("00003_05.npy", b"PK\x03\x04 an archive", "holds no map that can be read"),
        ("00003_05.npy", b"\x93NUMPY\x01\x00\x10\x00{'shape': (2,3   ", "holds no map that can be read"),
        ("00003_05.pfm", b"Pf\n20 12\n-1\nshort", "holds no map that can be read"),
        ("00003_05.png", CUT_PNG, "holds no map that can be read"),
        ("00003_05.tiff", CUT_TIFF, "holds no map that can be read"),
        ("00003_05.tiff", b"", "holds no map that can be read"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path, capfd, name, content, message):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        put(path, content)
    with pytest.raises(RecordedError, match=message) as caught:
        RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG)
    assert str(caught.value).startswith(str(path))
    assert capfd.readouterr().err == ""  # by us alone


def test_missing_files_are_named_before_anything_is_scored(tmp_path, plane_samples):
    for i in (0, 1, 3):
        put(tmp_path / f"{i:06d}.npy", plane_samples[i].disparity)
    with pytest.raises(FileNotFoundError, match=r"no disparity of pair 000002; looked for 000002"):
        evaluate(plane_samples, {"read": RecordedPredictions(tmp_path)})
    with pytest.raises(FileNotFoundError, match="nowhere: no such folder"):
        RecordedPredictions(tmp_path / "nowhere").of_pairs([])


def test_pairs_whose_names_are_numbers_are_found_by_name(tmp_path):
    """KITTI's test split does not begin at 0: its third pair is 000021, not the third file."""
    for number in range(30):
        put(tmp_path / f"{number:06d}_10.npy", DISPARITY + number)
    maps = RecordedPredictions(tmp_path)
    pairs = [(f"{number:06d}", place) for place, number in enumerate((1, 11, 21))]
    maps = maps.of_pairs(pairs)
    for pair, place in pairs:
        assert maps.read(pair, place, RIG).disparity == pytest.approx(DISPARITY + int(pair))
    with pytest.raises(FileNotFoundError, match=r"no disparity of pair 000031; looked for 000031, 000031_10, with"):
        maps.of_pairs([*pairs, ("000031", 3)])


def test_a_folder_has_names_or_places_and_never_both(tmp_path):
    for name in ("00000_00", "00002_00", "000001"):
        put(tmp_path / f"{name}.npy", DISPARITY)
    with pytest.raises(FileNotFoundError, match=r"no disparity of pair 00001/00; looked for 00001/00, 00001_00, "):
        RecordedPredictions(tmp_path).of_pairs([(f"{scene:05d}/00", scene) for scene in range(3)])


def test_a_file_of_another_pairs_number_is_not_taken_for_its_place(tmp_path):
    """As in left/*.png, whose test split begins in the middle: file 000000 is of the pair left/000000."""
    for number in range(10):
        put(tmp_path / f"{number:06d}.npy", DISPARITY + number)
    pairs = [(f"left/{number:06d}", place) for place, number in enumerate((4, 7))]
    maps = RecordedPredictions(tmp_path).of_pairs(pairs)
    for pair, place in pairs:
        assert maps.read(pair, place, RIG).disparity == pytest.approx(DISPARITY + int(pair[-6:]))
    with pytest.raises(
        FileNotFoundError, match=r"no disparity of pair left/000012; looked for 000012, 000012_10, with"
    ):
        maps.of_pairs([*pairs, ("left/000012", 2)])


def test_names_of_all_pairs_decide_though_only_some_are_scored(tmp_path):
    """With --limit 1, file 000000 is still that of train/000000 or of test/000000, which nothing tells."""
    put(tmp_path / "000000_10.npy", DISPARITY)
    names = ["train/000000", "train/000001", "test/000000"]
    with pytest.raises(
        FileNotFoundError, match=r"no disparity of pair train/000000; looked for train/000000, train_000"
    ):
        RecordedPredictions(tmp_path).of_pairs([(names[0], 0)], names)


def test_names_without_their_folders_are_found_where_no_two_pairs_have_the_same(tmp_path):
    for number, name in enumerate(("a", "b")):
        put(tmp_path / f"{name}.npy", DISPARITY + number)
    pairs = [("s/a", 0), ("t/b", 1)]
    maps = RecordedPredictions(tmp_path).of_pairs(pairs)
    assert [float(maps.read(*pair, RIG).disparity[0, 0] - DISPARITY[0, 0]) for pair in pairs] == [0, 1]
    with pytest.raises(FileNotFoundError, match=r"no disparity of pair s/a; looked for s/a, s_a, s_a_10, 000000_10, "):
        RecordedPredictions(tmp_path).of_pairs([("s/a", 0), ("t/a", 1)])


def test_the_scale_of_a_pfm_is_ignored(tmp_path):
    data = encode_pfm(DISPARITY)
    assert data.startswith(b"Pf\n20 12\n-1\n")
    (tmp_path / "00003_05.pfm").write_bytes(data.replace(b"\n-1\n", b"\n-0.003922\n", 1))
    assert np.array_equal(RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG).disparity, DISPARITY)
    assert np.array_equal(read_map(tmp_path / "00003_05.pfm", "disparity"), DISPARITY)


def test_the_truth_as_a_file_scores_perfectly(tmp_path, plane_samples):
    for i, sample in enumerate(plane_samples):
        put(tmp_path / f"{i:06d}_10.pfm", sample.disparity)
        put(tmp_path / f"{i:06d}_10_normal.npy", sample.normal)
    recorded = evaluate(plane_samples, {"read": RecordedPredictions(tmp_path)}).results["read"]
    assert recorded["depth"]["all"]["pooled"]["abs_rel"] == pytest.approx(0, abs=1e-6)
    assert recorded["normal"]["all"]["pooled"]["mean"] == pytest.approx(0, abs=1e-3)
    assert recorded["seconds"] is None and recorded["memory_mib"] is None and recorded["sparsification"] == {}


@pytest.mark.parametrize("fill", [False, True])
def test_sky_is_sky_in_disparity_and_in_depth(tmp_path, fill):
    disparity = DISPARITY.copy()
    disparity[:3], disparity[5, 4:9] = 0, np.nan
    put(tmp_path / "disparity/00003_05.npy", disparity)
    with np.errstate(divide="ignore"):
        put(tmp_path / "depth/00003_05.npy", np.where(disparity == 0, np.inf, RIG.fb / disparity))
    of_disparity, of_depth = (
        RecordedPredictions(tmp_path / kind, kind, fill=fill).read(PAIR, NUMBER, RIG) for kind in ("disparity", "depth")
    )
    assert np.isposinf(of_depth.depth[:3]).all() and (of_depth.disparity[:3] == 0).all()
    assert np.isnan(of_depth.depth).any() != fill
    np.testing.assert_allclose(of_depth.depth, of_disparity.depth, rtol=1e-5)
    np.testing.assert_allclose(of_depth.disparity, of_disparity.disparity, rtol=1e-5)


def test_an_infinite_depth_is_unknown_in_a_pfm_file(tmp_path):
    put(tmp_path / "00003_05.pfm", np.full((H, W), np.inf, np.float32))
    assert np.isnan(RecordedPredictions(tmp_path, "depth").read(PAIR, NUMBER, RIG).depth).all()


def middlebury(root, doffs, height=24, width=40):
    """Write one scene whose cameras have different principal points; return its true disparity of the images [px]."""
    truth = np.linspace(3, 11, width, dtype=np.float32)[None].repeat(height, 0)
    for name, seed in (("im0.png", 0), ("im1.png", 1)):
        put(root / "scene" / name, np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8))
    put(root / "scene/disp0.pfm", truth)
    (root / "scene/calib.txt").write_text(
        f"cam0=[50 0 19.5; 0 50 11.5; 0 0 1]\ncam1=[50 0 {19.5 + doffs}; 0 50 11.5; 0 0 1]\ndoffs={doffs}\n"
        f"baseline=270\nwidth={width}\nheight={height}\n"
    )
    return truth


@pytest.mark.parametrize(("doffs", "resize"), [(3, 1.0), (-2, 1.0), (3, 0.5)])
def test_disparities_of_the_images_score_perfectly_where_the_principal_points_differ(tmp_path, doffs, resize):
    middlebury(tmp_path / "data", doffs)
    pairs = open_pairs(tmp_path / "data", "all", DataConfig(resize=resize))
    put(tmp_path / "maps/scene.npy", pairs[0].disparity - doffs * resize)
    errors = evaluate(pairs, {"read": RecordedPredictions(tmp_path / "maps")}).pairs[0]["read"]
    assert errors["epe"] < 1e-5 and errors["abs_rel"] < 1e-5


def test_disparities_of_m3depth_predict_contain_the_difference_of_the_principal_points(tmp_path):
    middlebury(tmp_path / "data", 3)
    pairs = open_pairs(tmp_path / "data", "all")
    put(tmp_path / "maps/scene/disparity.npy", pairs[0].disparity)
    (tmp_path / "maps/scene/prediction.json").write_text("{}")
    assert evaluate(pairs, {"read": RecordedPredictions(tmp_path / "maps")}).pairs[0]["read"]["epe"] < 1e-5


def test_sky_stays_sky_and_what_the_principal_points_put_beyond_infinity_becomes_it(tmp_path):
    values = DISPARITY.copy()
    values[0, :4] = [0, 1.5, np.nan, 5]
    put(tmp_path / "00003_05.npy", values)
    nearer, farther = (RecordedPredictions(tmp_path).read(PAIR, NUMBER, RIG, shift) for shift in (2.0, -2.0))
    np.testing.assert_array_equal(nearer.disparity[0, :4], np.float32([0, 3.5, np.nan, 7]))
    np.testing.assert_array_equal(farther.disparity[0, :4], np.float32([0, 0, np.nan, 3]))
    assert np.isposinf(nearer.depth[0, 0]) and np.isposinf(farther.depth[0, :2]).all()


@pytest.mark.parametrize(("change", "is_marked"), [({"blur": 1.0}, True), ({"align_rows": True}, True), ({}, False)])
def test_tables_mark_recorded_maps_beside_methods_whose_images_are_changed(tmp_path, plane_samples, change, is_marked):
    samples = plane_samples[:1]
    put(tmp_path / "000000.npy", samples[0].disparity)
    degradation = Degradation(blur=change["blur"]) if "blur" in change else None
    methods = {"read": RecordedPredictions(tmp_path), "run": SGBM()}
    done = evaluate(samples, methods, degradation=degradation, align_rows="align_rows" in change)
    about = {
        "data": "planes", "split": "test", "pairs": 1, "weights": "shipped", "seed": 0,
        "degrade": "blur=1" if degradation else None, "align_rows": "align_rows" in change,
        "depth_range_m": (0.5, 15.0), "max_disparity_px": 192, "runtime": None, "versions": {},
    }  # fmt: skip
    report = markdown_report(about, done.results, done.true_depth_normals)
    assert ("| read, as recorded |" in report) == (AS_RECORDED in report) == is_marked
    assert ("read, as recorded" in text_table(done.results)) == is_marked and "run, as recorded" not in report


def test_the_files_of_pairs_are_all_that_are_read(tmp_path):
    names = ("00001_05.npy", "00001_05_normal.npy", "00002/disparity.npy", "00002/confidence.npy")
    expected = [put(tmp_path / name, DISPARITY) for name in names]
    expected.append(tmp_path / "00002/prediction.json")
    expected[-1].write_text("{}")
    put(tmp_path / "00003.npy", DISPARITY)  # of no pair that is asked for
    maps = RecordedPredictions(tmp_path)
    assert sorted(maps.files([("00001/05", 0), ("00002", 1)])) == sorted(expected)
    with pytest.raises(FileNotFoundError, match="no disparity of pair 00004; looked for"):
        maps.files([("00004", 3)])
