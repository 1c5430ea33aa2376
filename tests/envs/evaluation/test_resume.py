"""What must not be mixed in one folder of an evaluation."""

import hashlib
import importlib
import os
import re
import sys
from dataclasses import replace
from importlib.metadata import version
from types import SimpleNamespace

import pytest
from small_rivals import TINY

import envs.evaluation.driving
from envs.evaluate import evaluate, main
from envs.evaluation.config import EvaluateConfig
from envs.evaluation.resume import NOTES, WEIGHTS, check_paths, noted_digests, noted_runtime, noted_versions
from m3depth.kinds.networks import new_network
from m3depth.runtimes.choice import recorded_runtime
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.results.claim import ResultFolder

pytestmark = pytest.mark.usefixtures("undrawn_figures")

SETTINGS = {"seed": 3, "scene": "gale", "goal_distance": 20.0}


def sha256(content):
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def file(tmp_path):
    return tmp_path / "evaluate.json"


def digests_noted_in(file, names):
    """What envs.evaluate gets for these perceptions and drivers, in a folder with the file of settings."""
    folder = ResultFolder(file.parent / "out", "evaluation", file.name, SETTINGS, notes=(WEIGHTS,))
    with folder.claim():
        return noted_digests(folder, names)


def test_other_settings_are_refused_with_both_values(tmp_path):
    config = EvaluateConfig(
        tmp_path / "out", ("straight",), ("ground_truth",), episodes=1, k=(0.01,), goal_distance=4.0,
        dynamics="kinematic", videos=False,
    )  # fmt: skip
    evaluate(config)
    file = tmp_path / "out" / "evaluate.json"
    before = file.read_bytes()
    evaluate(replace(config, goal_distance=4))
    with pytest.raises(
        DatasetError, match=r"evaluate\.json: .*\(--goal-distance 4.0, not 5.0; --drift none, not 0.1\)"
    ):
        evaluate(replace(config, goal_distance=5.0, drift=0.1))
    assert file.read_bytes() == before


def test_drives_that_a_report_leaves_out_are_noted(tmp_path, capsys):
    command = ["--out", str(tmp_path), "--perception", "ground_truth", "--dynamics", "kinematic", "--no-videos"]
    command += ["--k", ".01", "--goal-distance", "4"]
    assert main([*command, "--driver", "straight", "--episodes", "2"]) == 0
    assert "note: " not in capsys.readouterr().err
    assert main([*command, "--driver", "random", "--episodes", "1"]) == 0
    assert f"note: {tmp_path / 'episodes'} also holds 2 drives of drivers, perceptions or" in capsys.readouterr().err
    assert main([*command, "--driver", "random", "straight", "--episodes", "1"]) == 0
    assert "also holds 1 drive of" in capsys.readouterr().err


def test_versions_and_machines_are_those_of_all_drives_and_of_no_other_run(file, monkeypatch):
    folder = ResultFolder(file.parent / "out", "evaluation", file.name, SETTINGS, notes=NOTES)
    runs = (("one", True, "one"), ("two", False, "one"), ("two", True, ["one", "two"]), ("one", True, ["one", "two"]))
    for machine, driving, expected in runs:
        monkeypatch.setattr("envs.evaluation.resume.versions", lambda machine=machine: {"processor": machine})
        with folder.claim():
            assert noted_versions(folder, driving) == {"processor": expected}
    assert read_json(folder.mark_path)["versions"] == {"processor": ["one", "two"]}
    with folder.claim():
        folder.note(versions="1.0")
        with pytest.raises(DatasetError, match=r"evaluate\.json: versions must hold versions by name, got '1\.0'"):
            noted_versions(folder, True)


def test_retrained_weights_do_not_inherit_the_drives_of_the_old_ones(file, tmp_path):
    weights = tmp_path / "w.safetensors"
    weights.write_bytes(b"first")
    name = f"m3depth:{weights}"
    assert digests_noted_in(file, (name,)) == {name: sha256(b"first")}
    assert digests_noted_in(file, (name,)) == {name: sha256(b"first")}
    weights.write_bytes(b"second")
    with pytest.raises(DatasetError, match=r"w\.safetensors has other weights than"):
        digests_noted_in(file, (name,))
    assert digests_noted_in(file, ("sgbm",)) == {}
    assert read_json(tmp_path / "out" / file.name)["weights"] == {
        name: sha256(b"first")
    }  # those that drove are still known


@pytest.mark.parametrize("changed", [0, 1])
def test_any_of_several_weights_that_changed_is_refused(file, tmp_path, changed):
    weights = [tmp_path / name for name in ("a.safetensors", "b.safetensors")]
    for each in weights:
        each.write_bytes(b"first")
    names = [f"m3depth:{each}" for each in weights]
    digests_noted_in(file, names)
    weights[changed].write_bytes(b"second")
    with pytest.raises(DatasetError, match=rf"{weights[changed].name} has other weights than"):
        digests_noted_in(file, names)


def test_a_policy_that_was_trained_on_does_not_either(file, tmp_path):
    policy = tmp_path / "policy.zip"
    policy.write_bytes(b"first")
    assert digests_noted_in(file, ("straight", str(policy))) == {str(policy): sha256(b"first")}
    policy.write_bytes(b"second")
    with pytest.raises(DatasetError, match=r"policy\.zip has other weights than"):
        digests_noted_in(file, (str(policy),))


def test_digests_that_are_none_are_named(file, tmp_path):
    folder = ResultFolder(tmp_path / "out", "evaluation", file.name, SETTINGS, notes=(WEIGHTS,))
    with folder.claim():
        folder.note(**{WEIGHTS: ["a"]})
    with pytest.raises(DatasetError, match=r"evaluate\.json: weights must hold digests by name, got \['a'\]"):
        digests_noted_in(file, ("straight",))


def test_a_class_whose_checkpoint_has_changed_does_not_continue(file, tmp_path, monkeypatch):
    checkpoint = tmp_path / "net.ckpt"
    checkpoint.write_bytes(b"1")
    (tmp_path / "net_of_mine.py").write_text(f"class Net:\n    files = {str(checkpoint)!r}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    noted = digests_noted_in(file, ("net_of_mine:Net",))
    assert digests_noted_in(file, ("net_of_mine:Net",)) == noted
    checkpoint.write_bytes(b"2")
    with pytest.raises(DatasetError, match="net_of_mine:Net has other code or files than when it drove these"):
        digests_noted_in(file, ("net_of_mine:Net",))


def test_an_edited_class_is_not_reported_by_the_drives_of_what_it_was(tmp_path, monkeypatch):
    code = tmp_path / "own_driver.py"
    code.write_text("from envs.drivers.builtin import StraightDriver as Own\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    config = EvaluateConfig(
        tmp_path / "out", ("own_driver:Own",), ("ground_truth",), episodes=1, k=(0.01,), goal_distance=4.0,
        dynamics="kinematic", videos=False,
    )  # fmt: skip
    assert evaluate(config)["weights"] == {"own_driver:Own": sha256(code.read_bytes())}
    evaluate(config)
    code.write_text("from envs.drivers.builtin import RandomDriver as Own\n")
    with pytest.raises(ValueError, match=r"own_driver\.py has changed since Python imported it"):
        evaluate(config)
    importlib.reload(sys.modules["own_driver"])
    with pytest.raises(DatasetError, match="own_driver:Own has other code or files than"):
        evaluate(config)


def test_drives_of_m3depth_in_one_runtime_are_not_mixed_with_those_in_another(file, tmp_path, monkeypatch):
    folder = ResultFolder(tmp_path / "out", "evaluation", file.name, SETTINGS, notes=NOTES)

    def noted(perception):
        with folder.claim():
            return noted_runtime(folder, (perception,), "auto")

    pytorch = recorded_runtime(["m3depth"])
    assert pytorch.startswith(f"pytorch {version('torch')} ")
    assert noted("sgbm") is None
    assert noted("m3depth") == noted("m3depth:w.safetensors") == noted("ground_truth") == pytorch
    program, device, precision = pytorch.rsplit(" ", 2)
    for other in ("openvino 1.0 cpu fp32", f"{program} gpu {precision}", f"{program} {device} fp8"):
        monkeypatch.setattr("envs.evaluation.resume.recorded_runtime", lambda *_, other=other: other)
        with pytest.raises(
            DatasetError, match=re.escape(f"m3depth drove these episodes in {pytorch}, not in {other}; choose")
        ):
            noted("m3depth")
        assert read_json(folder.mark_path)["runtime"] == pytorch


def test_a_worker_with_another_runtime_drives_nothing(tmp_path, monkeypatch):
    """As on a cluster of which one machine lacks OpenVINO."""
    monkeypatch.setattr("envs.evaluate.recorded_runtime", lambda *_: "openvino 1.0 cpu bf16")
    config = EvaluateConfig(out=tmp_path / "out", driver=("straight",), perception=("sgbm",), episodes=1)
    message = r"the worker on .* would run sgbm in None, and this evaluation runs it in openvino 1\.0 cpu bf16; make"
    with pytest.raises(DatasetError, match=message):
        evaluate(config)
    assert not list((tmp_path / "out/episodes").iterdir())


def test_a_record_without_device_and_precision_goes_on_as_it_is(tmp_path, monkeypatch):
    folder = ResultFolder(tmp_path / "out", "evaluation", "evaluate.json", SETTINGS, notes=NOTES)
    runtimes = iter(["openvino 1.0 cpu bf16", "openvino 1.1 cpu bf16", "openvino 1.0 cpu bf16"])
    monkeypatch.setattr("envs.evaluation.resume.recorded_runtime", lambda *_: next(runtimes))
    with folder.claim(runtime="openvino 1.0"):
        assert noted_runtime(folder, ("m3depth",), "auto") == "openvino 1.0"
        with pytest.raises(DatasetError, match=r"in openvino 1\.0, not in openvino 1\.1 cpu bf16"):
            noted_runtime(folder, ("m3depth",), "auto")
        folder.note(runtime=3)
        with pytest.raises(DatasetError, match=r"evaluate\.json: runtime must be text, got 3"):
            noted_runtime(folder, ("m3depth",), "auto")


@pytest.fixture
def fusion(tmp_path) -> str:
    """The name of a network with M3Depth's depth, which PyTorch runs in any case."""
    new_network(TINY["fusion"]).save_pretrained(tmp_path / "fusion.safetensors")
    return f"m3depth:{tmp_path / 'fusion.safetensors'}"


def test_drives_of_another_network_in_one_runtime_are_not_mixed_with_those_in_another(tmp_path, fusion, monkeypatch):
    folder = ResultFolder(tmp_path / "out", "evaluation", "evaluate.json", SETTINGS, notes=NOTES)

    def noted():
        with folder.claim():
            return noted_runtime(folder, (fusion, "sgbm"), "openvino")

    pytorch = recorded_runtime([fusion])
    assert noted() == noted() == pytorch and pytorch.startswith(f"pytorch {version('torch')} ")
    mark = read_json(folder.mark_path)
    program, device, precision = pytorch.rsplit(" ", 2)
    for other in (f"pytorch 1.0 {device} {precision}", f"{program} gpu {precision}", f"{program} {device} fp8"):
        monkeypatch.setattr("envs.evaluation.resume.recorded_runtime", lambda *_, other=other: other)
        with pytest.raises(
            DatasetError,
            match=re.escape(f"other networks drove these episodes in {pytorch}, not in {other}; choose another --out"),
        ):
            noted()
        assert read_json(folder.mark_path) == mark


def test_m3depth_and_another_network_drive_in_two_programs_in_any_order(tmp_path, fusion, monkeypatch):
    programs = {"m3depth": "openvino 1.0 cpu fp32", fusion: "pytorch 2.0 cpu fp32"}
    monkeypatch.setattr("envs.evaluation.resume.recorded_runtime", lambda names, _: programs[names[0]])
    for number, order in enumerate((["m3depth", fusion], [fusion, "m3depth"])):
        folder = ResultFolder(tmp_path / str(number), "evaluation", "evaluate.json", SETTINGS, notes=NOTES)
        with folder.claim():
            alone = [noted_runtime(folder, (name,), "auto") for name in order]
            both = noted_runtime(folder, ("m3depth", fusion), "auto")
        assert alone == [programs[order[0]], both] and both == "openvino 1.0 cpu fp32 + pytorch 2.0 cpu fp32"


def test_a_folder_without_a_record_of_another_network_goes_on(tmp_path, fusion):
    """An earlier release recorded M3Depth's runtime alone."""
    folder = ResultFolder(tmp_path / "out", "evaluation", "evaluate.json", SETTINGS, notes=NOTES)
    pytorch = recorded_runtime([fusion])
    for runtime in (None, "openvino 1.0"):
        with folder.claim():
            folder.note(runtime=runtime, others_runtime=None)
            assert noted_runtime(folder, (fusion,), "auto") == (f"{runtime} + {pytorch}" if runtime else pytorch)
            assert read_json(folder.mark_path)["others_runtime"] == pytorch
    with folder.claim():
        folder.note(others_runtime=3)
        with pytest.raises(DatasetError, match=r"evaluate\.json: others_runtime must be text, got 3"):
            noted_runtime(folder, (fusion,), "auto")


@pytest.mark.parametrize("when", ["before", "during"])
def test_a_file_that_changes_during_an_evaluation_ends_it(tmp_path, monkeypatch, when):
    """Workers that start later would drive with another file than the evaluation notes."""
    file = tmp_path / f"mine_{when}.py"
    file.write_text("from envs.drivers.builtin import StraightDriver as Mine\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    config = EvaluateConfig(
        tmp_path / "out", (f"mine_{when}:Mine",), ("ground_truth",), episodes=1, k=(0.01,), goal_distance=3.0,
        dynamics="kinematic", videos=False, workers=1,
    )  # fmt: skip
    plain = envs.evaluation.driving.drive

    def driven(*args):
        record = plain(*args)
        file.write_text("# another\n" + file.read_text())
        return record

    if when == "during":
        monkeypatch.setattr("envs.evaluation.driving.drive", driven)
    else:
        begun = noted_digests
        monkeypatch.setattr(
            "envs.evaluation.resume.noted_digests", lambda *args: (begun(*args), file.write_text("# x"))[0]
        )
    with pytest.raises(DatasetError, match=r"mine_.*.py: on .*, this is not the file that the drives began with; put"):
        evaluate(config)
    assert not list((tmp_path / "out" / "episodes").iterdir())


@pytest.mark.parametrize(
    ("driver", "perception", "scene", "suite"),
    [
        ("{}file.zip", "sgbm", "gale", None), ("straight", "m3depth:{}file.safetensors", "gale", None),
        ("straight", "m3depth", "{}file.json", None), ("straight", "m3depth", "gale", "{}file.json"),
    ],
)  # fmt: skip
def test_a_worker_in_another_folder_refuses_relative_paths(tmp_path, monkeypatch, driver, perception, scene, suite):
    command, worker = tmp_path / "command", tmp_path / "worker"

    def check(before):
        config = SimpleNamespace(scene=scene.format(before), suite=suite and suite.format(before))
        check_paths(config, (driver.format(before), perception.format(before)), command)

    for folder in (command, worker):
        folder.mkdir()
        monkeypatch.chdir(folder)
        check(f"{command}/")
        if folder == command:
            check("")
    with pytest.raises(DatasetError, match=rf"^file\.\w+: the worker .* runs in {worker}, and .* file of {command}"):
        check("")


def test_a_worker_in_another_folder_refuses_relative_files_of_a_class(tmp_path, monkeypatch):
    (tmp_path / "reading_here.py").write_text("class Method:\n    files = ['net.pt']\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    names = ("straight", "reading_here:Method")
    config = SimpleNamespace(scene="gale", suite=None)
    monkeypatch.chdir(tmp_path)
    check_paths(config, names, tmp_path)
    with pytest.raises(DatasetError, match=r"^net\.pt: the worker on"):
        check_paths(config, names, tmp_path / "elsewhere")


def test_workers_in_another_folder_drive_with_absolute_paths(tmp_path, monkeypatch):
    """OUT may be relative: the command itself writes there."""
    distributed = pytest.importorskip("distributed")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "place.json").write_text('{"preset": "utopia", "rocks": {"k": 0.01}}')
    flags = ["--out", "out", "--driver", "straight", "--perception", "ground_truth", "--dynamics", "kinematic"]
    flags += ["--episodes", "1", "--goal-distance", "3", "--no-videos", "--scene"]
    monkeypatch.chdir(tmp_path)
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.run(os.chdir, str(tmp_path / "elsewhere"))
        flags = ["--scheduler", cluster.scheduler_address, *flags]
        assert main([*flags, "place.json"]) == 2 and not list((tmp_path / "out" / "episodes").iterdir())
        assert main([*flags, str(tmp_path / "place.json")]) == 0
    assert len(list((tmp_path / "out" / "episodes").iterdir())) == 1


def test_a_place_that_changes_during_an_evaluation_ends_it(tmp_path, monkeypatch):
    place, drives = tmp_path / "place.json", []
    place.write_text('{"preset": "utopia", "rocks": {"k": 0.01}}')
    config = EvaluateConfig(
        tmp_path / "out", ("straight",), ("ground_truth",), scene=str(place), episodes=2, goal_distance=3.0,
        dynamics="kinematic", videos=False, workers=1,
    )  # fmt: skip
    plain = envs.evaluation.driving.drive

    def driven(*args):
        drives.append(plain(*args))
        if len(drives) == 2:
            place.write_text('{"preset": "utopia", "rocks": {"k": 0.02}}')
        return drives[-1]

    monkeypatch.setattr("envs.evaluation.driving.drive", driven)
    with pytest.raises(DatasetError, match=r"place\.json: on .*, this is not the file that the drives began with; put"):
        evaluate(config)
    assert len(list((tmp_path / "out" / "episodes").iterdir())) == 1
