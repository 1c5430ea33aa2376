import json
import shutil
from dataclasses import asdict

import pytest
from recorded_drives import drive_bytes

from envs.drives.records import read_record
from envs.evaluate import evaluate
from envs.evaluation.config import EvaluateConfig
from envs.join import JoinConfig, _absent, join, main
from marssim.base.files.json_file import DatasetError, as_json, read_json

pytestmark = pytest.mark.usefixtures("undrawn_figures")

VARYING = ("step_seconds", "perception_seconds", "config", "versions", "shard")


def without_times(value):
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in VARYING}
    return [without_times(v) for v in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def shards(small_suite, make_suite_config, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    for part in (1, 2):
        evaluate(make_suite_config(small_suite, folder / str(part), shard=f"{part}/2"))
    return folder / "1", folder / "2"


def test_no_shards_are_refused(tmp_path):
    with pytest.raises(ValueError, match="name the folders of one shard or more"):
        JoinConfig((), tmp_path / "all")


def test_joined_shards_are_the_evaluation_without_shards(shards, suite_run, tmp_path):
    joined = join(JoinConfig(shards, tmp_path / "all"))
    whole = json.loads((suite_run / "results.json").read_text())
    assert without_times(json.loads((tmp_path / "all" / "results.json").read_text())) == without_times(whole)
    assert joined["suite"]["shard"] is None
    assert [len(json.loads((s / "results.json").read_text())["episodes"]) for s in shards] == [4, 4]


def test_the_versions_are_those_of_the_shards_and_not_of_the_machine_that_joins(shards, tmp_path, monkeypatch):
    driven = json.loads((shards[0] / "results.json").read_text())["versions"]
    other = shutil.copytree(shards[1], tmp_path / "other")
    content = json.loads((other / "results.json").read_text())
    content["versions"]["processor"] = "of another laboratory"
    (other / "results.json").write_text(json.dumps(content))
    monkeypatch.setattr("envs.evaluation.resume.versions", lambda: {"python": "of the machine that joins"})
    assert join(JoinConfig(shards, tmp_path / "alike"))["versions"] == driven
    unlike = driven | {"processor": [driven["processor"], "of another laboratory"]}
    assert join(JoinConfig((shards[0], other), tmp_path / "unlike"))["versions"] == unlike
    assert read_json(tmp_path / "unlike" / "evaluate.json")["versions"] == unlike
    assert join(JoinConfig((tmp_path / "unlike", shards[0]), tmp_path / "again"))["versions"] == unlike


def test_versions_that_are_none_are_named(shards, tmp_path):
    other = shutil.copytree(shards[1], tmp_path / "other")
    content = json.loads((other / "results.json").read_text())
    (other / "results.json").write_text(json.dumps(content | {"versions": "1.0"}))
    with pytest.raises(DatasetError, match=r"other/results\.json: versions must hold versions by name, got '1\.0'"):
        join(JoinConfig((shards[0], other), tmp_path / "all"))


def test_drives_that_shards_recorded_come_along_with_their_pages(shards, tmp_path):
    copies, names = [], []
    for shard in shards:
        copies.append(shutil.copytree(shard, tmp_path / shard.name))
        names.append(min((shard / "episodes").glob("*.json")).stem)
        (copies[-1] / "drives").mkdir()
        (copies[-1] / "drives" / f"{names[-1]}.zip").write_bytes(drive_bytes())
    out = tmp_path / "all"
    join(JoinConfig(tuple(copies), out))
    assert sorted(file.name for file in (out / "drives").iterdir()) == sorted(
        f"{name}.{kind}" for name in names for kind in ("html", "zip")
    )
    page = (out / "results.html").read_text()
    assert all(f'href="drives/{name}.html"' in page for name in names)
    assert len(list((out / "episodes").glob("*.json"))) == 8


def test_shards_of_rigid_bodies_join_without_pybullet(shards, tmp_path, monkeypatch):
    copies = [shutil.copytree(shard, tmp_path / shard.name) for shard in shards]
    for folder in copies:
        for name, settings in (("results.json", "config"), ("evaluate.json", None)):
            content = json.loads((folder / name).read_text())
            (content[settings] if settings else content)["dynamics"] = "physics"
            (folder / name).write_text(json.dumps(content))
    monkeypatch.setattr("envs.world.vehicle.pybullet_is_installed", lambda: False)
    assert join(JoinConfig(tuple(copies), tmp_path / "all"))["driven_with"]["dynamics"] == "physics"


def test_shards_whose_suite_lay_in_another_folder_join(shards, small_suite, tmp_path):
    other = shutil.copytree(shards[1], tmp_path / "other")
    content = json.loads((other / "results.json").read_text())
    content["config"]["suite"] = "/elsewhere/small-v1.json"
    (other / "results.json").write_text(json.dumps(content))
    joined = join(JoinConfig((shards[0], other), tmp_path / "all"))
    assert joined["config"]["suite"] == str(small_suite) and len(joined["episodes"]) == 8


def test_a_suite_that_no_shard_can_find_is_named(shards, small_suite, tmp_path, capsys):
    copies = []
    for shard in shards:
        copies.append(shutil.copytree(shard, tmp_path / shard.name))
        content = json.loads((copies[-1] / "results.json").read_text())
        content["config"]["suite"] = "/elsewhere/small-v1.json"
        (copies[-1] / "results.json").write_text(json.dumps(content))
    flags = [*map(str, copies), "--out", str(tmp_path / "all")]
    assert main(flags) == 2
    assert "suite /elsewhere/small-v1.json: no such file" in capsys.readouterr().err
    assert main([*flags, "--suite", str(small_suite)]) == 0
    assert json.loads((tmp_path / "all" / "results.json").read_text())["config"]["suite"] == str(small_suite)


def test_missing_episodes_are_counted(shards, tmp_path, capsys):
    assert main([str(shards[0]), "--out", str(tmp_path / "all")]) == 2
    error = capsys.readouterr().err
    assert "4 episodes of 8 are in none of the shards, such as straight-ground_truth" in error
    assert error.endswith("; not given: shard 2/2\n")


def test_a_message_on_absent_shards_names_the_methods_that_lack_them():
    def config(shard, *perceptions):
        return {"driver": ["navigator"], "perception": perceptions, "shard": shard}

    assert _absent([config("1/2", "sgbm"), config("2/2", "sgbm"), config(None, "m3depth")]) == ""
    assert _absent([config("1/2", "sgbm"), config("2/2", "sgbm"), config("1/2", "m3depth")]) == (
        "; not given: shard 2/2 of navigator, m3depth"
    )
    assert _absent([config("1/3", "sgbm", "sad"), config("2/3", "m3depth")]) == (
        "; not given: shard 2/3, 3/3 of navigator, sgbm and navigator, sad; shard 1/3, 3/3 of navigator, m3depth"
    )
    assert _absent([config("1/3", "sgbm"), config(3, "sgbm")]) == ""
    assert _absent([config("1/140", "sgbm")]) == "; not given: shard 2/140, 3/140, 4/140, 5/140, 6/140 and 134 more"


def test_a_file_instead_of_a_folder_is_refused(shards, tmp_path, capsys):
    file = shards[0] / "results.json"
    assert main([str(file), "--out", str(tmp_path / "all")]) == 2
    assert capsys.readouterr().err == f"error: {file}: is a file; give the folder that envs.evaluate --shard wrote\n"


def test_a_folder_that_is_given_twice_is_refused(shards, tmp_path, capsys):
    assert main([str(shards[0]), str(shards[0]), "--out", str(tmp_path / "all")]) == 2
    assert capsys.readouterr().err == f"error: the folder {shards[0]} is given twice\n"
    assert not (tmp_path / "all").exists()  # nothing that a later join could take for its own


def changed(folder, name, **values):
    """Change values of the record of an episode, or of another JSON file of an evaluation."""
    file = folder / name
    file.write_text(json.dumps({**json.loads(file.read_text()), **values}))
    return file


def test_records_of_other_evaluations_in_the_folder_are_refused(shards, tmp_path, capsys):
    out = tmp_path / "all"
    for _ in range(2):  # the second join finds the records of the first
        assert main([*map(str, shards), "--out", str(out)]) == 0
    name = min((shards[0] / "episodes").glob("*.json")).name
    file = changed(out / "episodes", name, steps=99)
    assert main([*map(str, shards), "--out", str(out)]) == 2
    assert f"{file}: is another record of the episode than {shards[0] / 'episodes' / name} (steps " in (
        capsys.readouterr().err
    )
    file.rename(file.with_name("other.json"))
    assert main([*map(str, shards), "--out", str(out)]) == 2
    assert "other.json: is a record that none of the shards holds; choose another --out" in capsys.readouterr().err
    assert main([*map(str, shards), "--out", str(shards[0])]) == 2
    assert f"--out {shards[0]}: is one of the shards; choose another" in capsys.readouterr().err


def test_an_episode_that_two_shards_hold_must_be_the_same_but_for_times(shards, tmp_path, monkeypatch):
    monkeypatch.setattr("envs.join.write_results", lambda *_: ({}, []))
    other = shutil.copytree(shards[1], tmp_path / "other")
    first = min((shards[0] / "episodes").glob("*.json"))
    shutil.copy(first, other / "episodes")
    changed(other / "episodes", first.name, step_seconds=99.0)
    join(JoinConfig((shards[0], other), tmp_path / "all"))
    assert (tmp_path / "all" / "episodes" / first.name).read_bytes() == first.read_bytes()
    changed(other / "episodes", first.name, outcome="tilt")
    for order in ((shards[0], other), (other, shards[0])):
        with pytest.raises(DatasetError, match=r"is another record of the episode than .* \(outcome "):
            join(JoinConfig(order, tmp_path / "none"))
    assert not (tmp_path / "none").exists()


def test_a_record_that_knows_the_cause_is_taken_and_joins_again(shards, tmp_path, monkeypatch):
    monkeypatch.setattr("envs.join.write_results", lambda *_: ({}, []))
    first = min((shards[0] / "episodes").glob("*.json"))
    join(JoinConfig(shards, tmp_path / "all"))
    other = shutil.copytree(shards[0], tmp_path / "other")
    changed(other / "episodes", first.name, cause="detour")
    for order in ((other, *shards), (*shards, other)):  # into the folder of before
        join(JoinConfig(order, tmp_path / "all"))
        assert read_record(tmp_path / "all" / "episodes" / first.name).cause == "detour"
    third = shutil.copytree(other, tmp_path / "third")
    changed(third / "episodes", first.name, cause="odometry error")
    with pytest.raises(DatasetError, match=r"is another record of the episode than .* \(cause "):
        join(JoinConfig((other, third, shards[1]), tmp_path / "none"))


def test_a_shard_that_was_stopped_before_its_report_is_named(shards, tmp_path):
    other = shutil.copytree(shards[1], tmp_path / "other")
    (other / "results.json").unlink()
    with pytest.raises(DatasetError, match=r"other.results.json: no such file: the shard is not finished"):
        join(JoinConfig((shards[0], other), tmp_path / "all"))


def test_shards_of_two_programs_are_refused(shards, tmp_path, monkeypatch):
    monkeypatch.setattr("envs.join.write_results", lambda _, provenance, __: (dict(provenance), []))
    copies = [shutil.copytree(shard, tmp_path / shard.name) for shard in shards]
    changed(copies[0], "evaluate.json", runtime="openvino 1")
    for runtime, message in (("pytorch 2", "pytorch 2 is not openvino 1"), (["a"], "runtime must be a name or null")):
        changed(copies[1], "evaluate.json", runtime=runtime)
        with pytest.raises(DatasetError, match=message):
            join(JoinConfig(tuple(copies), tmp_path / "all"))
    changed(copies[1], "evaluate.json", runtime="openvino 1 cpu bf16")  # the other is of an earlier version
    assert join(JoinConfig(tuple(copies), tmp_path / "all"))["runtime"] == "openvino 1 cpu bf16"


def test_shards_of_m3depth_and_of_another_network_may_be_of_two_programs(shards, tmp_path, monkeypatch):
    monkeypatch.setattr("envs.join.write_results", lambda _, provenance, __: (dict(provenance), []))
    copies = [shutil.copytree(shard, tmp_path / shard.name) for shard in shards]
    changed(copies[0], "evaluate.json", runtime="openvino 1 cpu bf16")
    changed(copies[1], "evaluate.json", others_runtime="pytorch 2 cpu bf16")
    joined = join(JoinConfig(tuple(copies), tmp_path / "all"))
    assert joined["runtime"] == "openvino 1 cpu bf16 + pytorch 2 cpu bf16"
    assert read_json(tmp_path / "all" / "evaluate.json")["others_runtime"] == "pytorch 2 cpu bf16"
    changed(copies[0], "evaluate.json", others_runtime="pytorch 3 cpu bf16")
    message = "other networks ran in another program than in another shard .pytorch 2 cpu bf16 is not pytorch 3"
    with pytest.raises(DatasetError, match=message):
        join(JoinConfig(tuple(copies), tmp_path / "none"))


def test_shards_of_other_settings_are_refused(shards, tmp_path):
    other = shutil.copytree(shards[1], tmp_path / "other")
    mark = json.loads((other / "evaluate.json").read_text())
    (other / "evaluate.json").write_text(json.dumps({**mark, "seed": 8}))
    with pytest.raises(DatasetError, match=f"^{other}: has other settings than {shards[0]} .seed 5, not 8"):
        join(JoinConfig((shards[0], other), tmp_path / "all"))
    (other / "evaluate.json").write_text(json.dumps({**mark, "weights": {"straight": "a"}}))
    first = shutil.copytree(shards[0], tmp_path / "first")
    (first / "evaluate.json").write_text(json.dumps({**mark, "weights": {"straight": "b"}}))
    with pytest.raises(DatasetError, match=f"^{other}: straight has other weights or code than in another shard"):
        join(JoinConfig((first, other), tmp_path / "all"))


def test_a_folder_that_is_no_evaluation_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"evaluate.json: no such file"):
        join(JoinConfig((tmp_path,), tmp_path / "all"))


@pytest.mark.parametrize(
    "content",
    [
        {}, {"config": 3}, {"config": {"eyes": {}}}, {"config": {"seed": "few"}}, {"config": {"seed": -1}},
        {"config": {"driver": [{}]}},
    ],
)  # fmt: skip
def test_results_of_something_else_are_named(shards, tmp_path, capsys, content):
    other = shutil.copytree(shards[0], tmp_path / "other")
    before = json.loads((other / "results.json").read_text())
    config = content.get("config")
    if isinstance(config, dict) and "eyes" not in config:
        content = {**before, "config": {**before["config"], **config}}
    (other / "results.json").write_text(json.dumps(content))
    assert main([str(other), "--out", str(tmp_path / "all")]) == 2
    error = capsys.readouterr().err
    assert f"{other / 'results.json'}: config does not hold the settings of an eval" in error and error.count("\n") == 1
    assert not (tmp_path / "all").exists()


def test_true_depth_of_fewer_pixels_is_not_compared_with_eyes(tmp_path, capsys):
    shards = []
    for perception in ("sgbm", "ground_truth"):
        folder = tmp_path / perception
        config = EvaluateConfig(folder, perception=(perception,), videos=False)
        folder.mkdir()
        (folder / "evaluate.json").write_text(json.dumps(as_json(config.content())))
        (folder / "results.json").write_text(json.dumps({"config": as_json(asdict(config))}))
        shards.append(str(folder))
    assert main([*shards, "--out", str(tmp_path / "all")]) == 2
    error = capsys.readouterr().err
    assert f"{shards[1]}: its evaluation has the true depth with 128 x 128 px" in error and error.count("\n") == 1
    assert "--ground-truth-pixels 0" in error and not (tmp_path / "all").exists()


def test_digests_that_are_none_are_named(shards, tmp_path, capsys):
    other = shutil.copytree(shards[0], tmp_path / "other")
    mark = json.loads((other / "evaluate.json").read_text())
    (other / "evaluate.json").write_text(json.dumps({**mark, "weights": ["a"]}))
    assert main([str(other), "--out", str(tmp_path / "all")]) == 2
    assert f"{other / 'evaluate.json'}: weights must hold digests by name, got ['a']" in capsys.readouterr().err


def test_errors_on_the_test_set_are_those_of_all_shards(shards, tmp_path, capsys):
    copies = [shutil.copytree(shard, tmp_path / shard.name) for shard in shards]

    def note(folder, errors):
        content = json.loads((folder / "results.json").read_text())
        (folder / "results.json").write_text(json.dumps({**content, "test_set_abs_rel": errors}))

    note(copies[0], {"sgbm": 0.02})
    note(copies[1], {"sgbm": 0.02, "m3depth": 0.01})
    joined = join(JoinConfig(tuple(copies), tmp_path / "all"))
    assert joined["test_set_abs_rel"] == {"sgbm": 0.02, "m3depth": 0.01}
    for errors, message in (
        ({"sgbm": 0.03}, f"{copies[1]}: sgbm has another test_set_abs_rel than in another shard"),
        ([1], "test_set_abs_rel must hold numbers by name, got [1]"),
    ):
        note(copies[1], errors)
        assert main([*map(str, copies), "--out", str(tmp_path / "other")]) == 2
        assert message in capsys.readouterr().err and not (tmp_path / "other").exists()
