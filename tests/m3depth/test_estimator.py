"""Estimators by name, and the errors for names that mean nothing."""

import functools
import hashlib
import subprocess
import sys

import cv2
import numpy as np
import pytest
from small_rivals import TINY

from m3depth.checked_inference import checked_prediction
from m3depth.estimator import Estimator, EstimatorName, distinct_labels, load_estimator
from m3depth.kinds.networks import new_network
from m3depth.predict import main as predict_command
from m3depth.stereo.classical import SGBM, BlockMatching
from m3depth.weights import SHIPPED_WEIGHTS
from m3depth.wrapped_estimators import UnfilledEstimator


class NoEstimator:
    pass


class WithState:
    """Its decorator supplies the last argument."""

    @staticmethod
    def remembering(infer):
        @functools.wraps(infer)
        def with_state(self, left, right, rig):
            return infer(self, left, right, rig, {})

        return with_state

    @remembering
    def infer(self, left, right, rig, state):
        pass


def test_a_decorator_may_supply_arguments_of_infer():
    estimator = WithState()
    assert load_estimator(estimator) is estimator


class TwoImages:
    def infer(self, left, right):
        pass


def test_estimators_are_loaded_by_name():
    assert isinstance(load_estimator("sgbm"), SGBM)
    assert load_estimator("ncc") == BlockMatching("ncc")
    assert load_estimator("ssd-sgm") == BlockMatching("ssd", "sgm")
    assert isinstance(load_estimator("m3depth.stereo.classical:SGBM"), SGBM)


def test_an_object_comes_back_as_it_is():
    matcher = SGBM(block=3)
    assert load_estimator(matcher) is matcher
    assert isinstance(matcher, Estimator)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("raft", "estimator 'raft' is unknown; choose from m3depth, sgbm, m3depth:WEIGHTS, package.module:Class"),
        ("no_such_package:Net", "No module named 'no_such_package'"),
        ("./my_stereo.py:Net", r"'./my_stereo.py:Net': No module named './my_stereo.py'; name it as package.module,"),
        ("m3depth.stereo.classical:Net", "has no class 'Net'"),
        ("m3depth.stereo.classical:fill_background", "has no class"),
        ("marssim.base.camera:StereoRig", "cannot be made without arguments"),
        ("collections:OrderedDict", "has no method infer"),
        (NoEstimator(), "has no method infer"),
        (SGBM, "is the class m3depth.stereo.classical:SGBM: give an instance of it, or its name as text"),
        (TwoImages(), r"infer\(left, right\) must take left, right and rig \(too many positional arguments\)"),
        ("no_such.py:Net", "No module named 'no_such'; name it as no_such"),
    ],
)
def test_a_wrong_estimator_is_named(spec, message):
    with pytest.raises(ValueError, match=message) as caught:
        load_estimator(spec)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("device", ["auto", "cpu", "cuda"])
def test_the_network_goes_where_it_is_asked_to(monkeypatch, device):
    """A device without memory stands for a GPU."""
    arguments = []
    monkeypatch.setattr("m3depth.estimator.chosen_device", lambda name: arguments.append(name) or "meta")
    network = load_estimator("m3depth", device=device)
    assert arguments == [device] and {p.device.type for p in network.parameters()} == {"meta"}


@pytest.mark.parametrize("device", ["gpu", "cuda:0", "CUDA", "mps", None])
@pytest.mark.parametrize("runtime", ["auto", "pytorch", "openvino"])
def test_a_device_that_is_unknown_is_named(device, runtime, monkeypatch):
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: True)
    for method in ("m3depth", "sgbm"):
        with pytest.raises(ValueError, match=f"^--device {device}: is unknown; choose from auto, cpu, cuda$"):
            load_estimator(method, device=device, runtime=runtime)


def test_a_runtime_of_m3depth_does_not_matter_to_other_networks(tmp_path, monkeypatch):
    network = new_network(TINY["raft-stereo"])
    network.save_pretrained(tmp_path / "raft.safetensors")
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: False)
    assert load_estimator(f"m3depth:{tmp_path / 'raft.safetensors'}", runtime="openvino").takes_steps
    with pytest.raises(ImportError, match="openvino"):
        load_estimator("m3depth", runtime="openvino")


def test_missing_weights_are_named():
    with pytest.raises(FileNotFoundError, match=r"nowhere/w\.safetensors"):
        load_estimator("m3depth:nowhere/w.safetensors")


def test_tables_name_methods_by_their_labels():
    names = {
        "m3depth": "M3Depth",
        f"m3depth:{SHIPPED_WEIGHTS}": "M3Depth",
        "sgbm": "SGBM",
        "ssd-sgm": "SSD-SGM",
        "m3depth.stereo.classical:SGBM": "SGBM",
        "m3depth:runs/nine/weights.safetensors": "nine",
        "m3depth:runs/lr=1e-4/best.safetensors": "best",
        "Mine=m3depth:runs/nine/weights.safetensors": "Mine",
    }
    assert {text: EstimatorName.parse(text, labelled=True).label() for text in names} == names


def test_fill_after_a_name_is_read_where_the_caller_can_fill():
    name = EstimatorName.parse("Mine=my_stereo:Net,fill", labelled=True, fillable=True)
    assert name == EstimatorName("my_stereo:Net", "Mine", "fill") and name.form == "my_stereo:Net,fill"
    assert EstimatorName.parse("sgbm,fill", fillable=True).label() == "SGBM"
    assert EstimatorName.parse("sgbm", fillable=True).form == "sgbm"
    with pytest.raises(ValueError, match="estimator 'sgbm,fill' is unknown"):
        EstimatorName.parse("sgbm,fill")


def test_only_built_in_methods_can_be_left_unfilled():
    name = EstimatorName.parse("sad-sgm,unfilled", fillable=True)
    assert (name.name, name.form, name.label()) == ("sad-sgm", "sad-sgm,unfilled", "SAD-SGM, unfilled")
    assert EstimatorName.parse("A=sgbm,unfilled", labelled=True, fillable=True).label() == "A"
    with pytest.raises(ValueError, match=r"flag 'm3depth,unfilled': only sgbm, .*, mccnn can be left unfilled"):
        EstimatorName.parse("m3depth,unfilled", "flag", fillable=True)


def test_an_unfilled_method_has_the_maps_of_the_filled_one_where_it_matches(plane_samples):
    sample, method = plane_samples[0], load_estimator("sgbm")
    filled, unfilled = (
        estimator.infer(sample.left, sample.right, sample.rig) for estimator in (method, UnfilledEstimator(method))
    )
    matched = np.isfinite(method.match(sample.left, sample.right, sample.rig))
    assert 0 < matched.sum() < matched.size
    for name in ("depth", "disparity", "normal"):
        one, other = getattr(filled, name), getattr(unfilled, name)
        np.testing.assert_array_equal(other[matched], one[matched])
        assert np.isnan(other[~matched]).all()
    assert checked_prediction(method, unfilled, sample.left.shape[:2]) is not None


def test_weights_of_one_name_get_labels_that_differ():
    paths = ["runs/a/weights.safetensors", "old/a/weights.safetensors", "runs/b/weights.safetensors", "m3/SGBM.st"]
    names = [EstimatorName(f"m3depth:{path}") for path in paths]
    assert distinct_labels(names) == ["runs/a", "old/a", "b", "SGBM"]
    assert distinct_labels([*names, EstimatorName("sgbm")])[3:] == ["m3/SGBM", "SGBM"]
    assert len(set(distinct_labels([names[0], names[0]]))) == 1


@pytest.mark.parametrize("text", ["=sgbm", "Mine=raft", "Mine", "Mine=:Class", "m3depth.stereo:"])
def test_a_name_of_no_method_is_refused(text):
    with pytest.raises(ValueError, match=f"--estimator '{text}' is unknown; choose from m3depth, .*LABEL= before it"):
        EstimatorName.parse(text, "--estimator", labelled=True)


def test_a_digest_is_that_of_the_file_a_method_is_read_from(tmp_path, monkeypatch):
    def digest(file):
        return hashlib.sha256(file.read_bytes()).hexdigest()

    (tmp_path / "w.safetensors").write_bytes(b"weights")
    (tmp_path / "stereo_of_mine.py").write_text("class Mine: ...")
    monkeypatch.syspath_prepend(tmp_path)
    assert EstimatorName("m3depth").digest() == digest(SHIPPED_WEIGHTS)
    assert EstimatorName(f"m3depth:{tmp_path / 'w.safetensors'}").digest() == digest(tmp_path / "w.safetensors")
    assert EstimatorName("stereo_of_mine:Mine").digest() == digest(tmp_path / "stereo_of_mine.py")
    for name in ("sgbm", "nowhere:Net", "nowhere.stereo:Net", "./stereo_of_mine.py:Mine"):
        assert EstimatorName(name).digest() is None
    with pytest.raises(FileNotFoundError, match="no such weights file"):
        EstimatorName("m3depth:nowhere.safetensors").digest()


def test_a_digest_counts_the_files_that_a_class_names(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    net, other = tmp_path / "net.ckpt", tmp_path / "other.bin"
    net.write_bytes(b"1"), other.write_bytes(b"2")
    module = tmp_path / "stereo_with_files.py"
    module.write_text(
        "from pathlib import Path\nclass One:\n    files = 'net.ckpt'\n"
        "class Two:\n    files = [Path('net.ckpt'), 'other.bin']\n"
        "class None_:\n    files = ()\nclass Bad:\n    files = 3\n"
        "class Other:\n    def files(self): ...\nclass Folder:\n    files = 'ckpt'\n"
    )
    digests = [EstimatorName(f"stereo_with_files:{name}").digest() for name in ("One", "Two", "None_")]
    lines = [hashlib.sha256(file.read_bytes()).hexdigest() for file in (module, net, other)]
    assert digests[1] == hashlib.sha256("\n".join(lines).encode()).hexdigest()
    assert digests[0] != digests[1] and digests[2] == lines[0]
    assert EstimatorName("stereo_with_files:Other").digest() == lines[0]
    (tmp_path / "ckpt/part").mkdir(parents=True)
    (tmp_path / "ckpt/part/a.bin").write_bytes(b"1")
    assert EstimatorName("stereo_with_files:Folder").digest() == digests[0]
    net.write_bytes(b"3")
    assert EstimatorName("stereo_with_files:One").digest() != digests[0]
    with pytest.raises(ValueError, match="stereo_with_files:Bad: its attribute files must be a path or a list of"):
        EstimatorName("stereo_with_files:Bad").digest()
    net.unlink()
    with pytest.raises(FileNotFoundError, match=r"net\.ckpt"):
        EstimatorName("stereo_with_files:One").digest()


def test_import_and_baselines_load_no_torch_and_no_other_package():
    code = (
        "import sys, m3depth.estimator as e; [e.load_estimator(n) for n in ('sgbm', 'ncc-sgm')]; "
        "import m3depth.evaluate, m3depth.predict, m3depth.texture, m3depth.train, m3depth.ablate; "
        "sys.exit(' '.join({'torch', 'nav', 'envs', 'pybullet'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_predict_reports_in_one_line_what_a_users_class_lacks(tmp_path, monkeypatch, capsys):
    code = "import numpy as np\nfrom m3depth.stereo.prediction import Prediction\nclass Bad:\n"
    code += "    def infer(self, left, right, rig):\n        return Prediction(np.ones((3, 3)), None, None, None)\n"
    (tmp_path / "bad_stereo.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    wall = np.random.default_rng(0).integers(0, 255, (40, 70), dtype=np.uint8)
    for number in (0, 1):
        cv2.imwrite(str(tmp_path / f"{number}.png"), wall[:, 5 * number :][:, :60])
    arguments = [str(tmp_path / "0.png"), str(tmp_path / "1.png"), "--focal", "60", "--baseline", "0.2"]
    assert predict_command([*arguments, "--out", str(tmp_path / "out"), "--estimator", "bad_stereo:Bad"]) == 2
    error = capsys.readouterr().err
    assert error.endswith("Bad.infer returned depth of shape (3, 3): it must be (40, 60) here\n")
    assert error.count("error:") == 1 and "Traceback" not in error and not (tmp_path / "out").exists()
