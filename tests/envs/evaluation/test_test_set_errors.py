import hashlib
import json

import pytest

from envs.evaluation.test_set_errors import errors_on_test_set
from envs.world.perception import perception_digest
from marssim.base.files.json_file import DatasetError


def results(path, weights="abc", pairs=4, **errors):
    """A results.json as m3depth.evaluate writes it, with what matters here; errors: Abs Rel by method."""
    methods = {
        method: {"depth": {"all": {"per_image": {"abs_rel": error}, "pooled": {"abs_rel": 9.0}}}}
        for method, error in errors.items()
    }
    path.write_text(json.dumps({"weights_sha256": weights, "pairs": pairs, "methods": methods}))
    return path


def test_each_perception_finds_its_own_error(tmp_path):
    file = results(tmp_path / "r.json", M3Depth=0.008, SGBM=0.015, SAD=0.02)
    digests = {"m3depth": "abc", "m3depth:other.safetensors": "def", "sgbm": None, "ground_truth": None}
    assert errors_on_test_set([file], digests) == {"m3depth": 0.008, "sgbm": 0.015}


def test_several_files_score_several_weights(tmp_path):
    files = [
        results(tmp_path / "a.json", "abc", M3Depth=0.1, SGBM=0.3),
        results(tmp_path / "b.json", "def", M3Depth=0.2),
    ]
    assert errors_on_test_set(files, {"m3depth": "abc", "m3depth:w": "def"}) == {"m3depth": 0.1, "m3depth:w": 0.2}
    assert errors_on_test_set([], {"m3depth": "abc"}) == {}


def test_pairs_of_several_folders_count_alike(tmp_path):
    files = [results(tmp_path / "a.json", pairs=10, SGBM=0.1), results(tmp_path / "b.json", pairs=30, SGBM=0.3)]
    assert errors_on_test_set(files, {"sgbm": None}) == {"sgbm": pytest.approx(0.25)}


def test_scores_of_other_weights_are_refused(tmp_path):
    file = results(tmp_path / "r.json", "abc", M3Depth=0.1)
    with pytest.raises(DatasetError, match=r"r\.json: scores none of m3depth"):
        errors_on_test_set([file], {"m3depth": "def"})


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        '{"methods": []}',
        '{"methods": {"SGBM": {}}, "weights_sha256": null}',
        "[",
        '{"methods": {"a": 5}}',
        '{"methods": {"a": null}}',
        '{"methods": {"a": "residual"}}',
    ],
)
def test_other_files_are_named(tmp_path, content):
    (tmp_path / "x.json").write_text(content)
    with pytest.raises(DatasetError, match=r"x\.json"):
        errors_on_test_set([tmp_path / "x.json"], {"sgbm": None})
    with pytest.raises(DatasetError, match="no such file"):
        errors_on_test_set([tmp_path / "nowhere.json"], {"sgbm": None})


def test_scores_without_true_depth_are_reported_as_such(tmp_path):
    (tmp_path / "x.json").write_text(json.dumps({"methods": {"SGBM": {"left_right": 99.0, "residual": 0.2}}}))
    with pytest.raises(DatasetError, match=r"x\.json: scores pairs without true depth, so it has no error of depth$"):
        errors_on_test_set([tmp_path / "x.json"], {"sgbm": None})


def test_the_digest_is_the_files(tmp_path):
    file = tmp_path / "w.safetensors"
    file.write_bytes(b"weights")
    assert perception_digest(f"m3depth:{file}") == hashlib.sha256(b"weights").hexdigest()
    assert perception_digest("sgbm") is None and perception_digest("ground_truth") is None


def test_one_file_scores_several_weights_and_classes(tmp_path):
    file = results(tmp_path / "r.json", "abc", M3Depth=0.1, mine=0.2, Blocks=0.4, SGBM=0.3)
    estimators = {
        "M3Depth": {"name": "m3depth", "sha256": "abc"},
        "mine": {"name": "m3depth:mine.safetensors", "sha256": "def"},
        "SGBM": {"name": "sgbm", "sha256": None},
        "Blocks": {"name": "my_stereo:Blocks", "sha256": "123"},
    }
    file.write_text(json.dumps({**json.loads(file.read_text()), "estimators": estimators}))
    digests = {"m3depth": "abc", "m3depth:moved.safetensors": "def", "sgbm": None, "my_stereo:Blocks": "123"}
    assert errors_on_test_set([file], digests) == dict(zip(digests, (0.1, 0.2, 0.3, 0.4), strict=True))
    changed = {"my_stereo:Blocks": "456", "m3depth": "abc"}
    assert errors_on_test_set([file], changed) == {"m3depth": 0.1}


def test_columns_of_one_file_are_distinguished_by_their_names(tmp_path):
    """Two classes of a module have its digest, and the filled depth of a network that of its weights."""
    file = results(tmp_path / "r.json", "abc", A=0.01, B=0.5, M3Depth=0.2, filled=0.3, SGBM=0.4, unfilled=0.6)
    estimators = {
        "A": {"name": "mine:A", "sha256": "123"},
        "B": {"name": "mine:B", "sha256": "123"},
        "M3Depth": {"name": "m3depth", "sha256": "abc"},
        "filled": {"name": "m3depth,fill", "sha256": "abc"},
        "SGBM": {"name": "sgbm", "sha256": None},
        "unfilled": {"name": "sgbm,unfilled", "sha256": None},
    }
    file.write_text(json.dumps({**json.loads(file.read_text()), "estimators": estimators}))
    digests = {"mine:A": "123", "m3depth": "abc", "sgbm": None}
    assert errors_on_test_set([file], digests) == {"mine:A": 0.01, "m3depth": 0.2, "sgbm": 0.4}


def test_scores_of_degraded_images_are_not_averaged_with_others(tmp_path):
    clean, degraded = results(tmp_path / "a.json", SGBM=0.1), results(tmp_path / "b.json", SGBM=0.3)
    degraded.write_text(json.dumps({**json.loads(degraded.read_text()), "degrade": "blur=1"}))
    assert errors_on_test_set([degraded, degraded], {"sgbm": None}) == {"sgbm": pytest.approx(0.3)}
    message = r"b\.json: was scored with --degrade blur=1, .*a\.json with undegraded images; give results of one kind$"
    with pytest.raises(DatasetError, match=message):
        errors_on_test_set([clean, degraded], {"sgbm": None})
