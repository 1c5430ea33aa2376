import base64
import io
import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from dataclasses import replace

import gymnasium
import pytest
import torch

pytest.importorskip("stable_baselines3")

from envs.drivers.by_name import make_driver
from envs.train_ppo import PPOConfig, main, train
from marssim.base.files.json_file import DatasetError
from marssim.base.results.lock import sole_writer


def killed(_):
    raise KeyboardInterrupt


def test_it_trains_goes_on_and_what_it_saves_drives(tmp_path, make_env, small_place, monkeypatch):
    config = {"out": tmp_path, "workers": 1, "goal_distance": 3.0, "scene": str(small_place)}
    path = train(PPOConfig(**config, max_steps=8), rollout=8)
    first = zipfile.ZipFile(path).read("policy.pth")
    with (tmp_path / "log.jsonl").open("a") as log:
        # of a rollout after which no policy was saved, and all that a full disk took
        log.write('{"choices": 12, "arrived": 0.5, "episodes": 1}\n{"choices": 1')
    about = json.loads((tmp_path / "train_ppo.json").read_text())
    now = about["versions"]
    assert now["gymnasium"] == gymnasium.__version__ and now["stable-baselines3"] and now["torch"]
    about["versions"] = {**now, "gymnasium": "1.0"}
    (tmp_path / "train_ppo.json").write_text(json.dumps(about))
    assert train(PPOConfig(**config, max_steps=16), rollout=8) == path
    noted = json.loads((tmp_path / "train_ppo.json").read_text())["versions"]
    assert noted == {**now, "gymnasium": ["1.0", now["gymnasium"]]}
    assert zipfile.ZipFile(path).read("policy.pth") != first
    whole = path.read_bytes()
    monkeypatch.setattr("envs.train_ppo.mark_corridors", killed)  # while it saves
    with pytest.raises(KeyboardInterrupt):
        train(PPOConfig(**config, max_steps=24), rollout=8)
    assert path.read_bytes() == whole
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [row["choices"] for row in rows] == sorted(row["choices"] for row in rows) and rows[-1]["choices"] == 24
    assert all(row["choices"] != 12 for row in rows)
    assert all(0 <= row["arrived"] <= 1 and row["episodes"] >= 1 for row in rows)
    other = r"--k 0\.1 0\.2, not 0\.0 0\.1; --seed 0, not 1"
    with pytest.raises(DatasetError, match=rf"train_ppo\.json: .* other settings \({other}\); choose"):
        train(PPOConfig(**config, k=(0.0, 0.1), seed=1, max_steps=24), rollout=8)
    (tmp_path / "train_ppo.json").unlink()
    with pytest.raises(DatasetError, match=r"no such file, so .* records how the policy was made"):
        train(PPOConfig(**config, max_steps=24), rollout=8)
    assert path.read_bytes() == whole
    env = make_env(mast=True, map_observation=True)
    observation, _ = env.reset(seed=0)
    driver = make_driver(str(path))
    driver.reset(env, 0)
    assert driver.needs_map and driver.corridors and driver.act(env, observation) in env.action_space


def test_the_versions_of_a_run_do_not_depend_on_what_was_imported_before(tmp_path):
    code = "from envs.train_ppo import _versions; print('torch_threads' in _versions(None))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def test_a_policy_counts_no_choices_that_it_has_not_learnt_from(tmp_path, small_place, monkeypatch):
    from stable_baselines3 import PPO

    updates, update = [], PPO.train

    def killed_in_the_second(self):
        updates.append(self.num_timesteps)
        if len(updates) == 2:
            raise KeyboardInterrupt
        update(self)

    monkeypatch.setattr(PPO, "train", killed_in_the_second)
    config = {"out": tmp_path, "workers": 1, "goal_distance": 3.0, "scene": str(small_place)}
    with pytest.raises(KeyboardInterrupt):
        train(PPOConfig(**config, max_steps=12), rollout=4)
    with zipfile.ZipFile(tmp_path / "policy.zip") as archive:
        optimizer = torch.load(io.BytesIO(archive.read("policy.optimizer.pth")), weights_only=True)
        assert json.loads(archive.read("data"))["num_timesteps"] == 4 and updates == [4, 8]
    assert all(state["step"] > 0 for state in optimizer["state"].values()) and optimizer["state"]
    train(PPOConfig(**config, max_steps=12), rollout=4)
    assert updates == [4, 8, 8, 12]  # what was lost is learnt again


def test_time_that_is_up_within_a_rollout_ends_it(tmp_path, small_place, monkeypatch, capsys):
    """Each choice takes half a minute here, so that six minutes end in the middle of the second rollout of eight."""
    import stable_baselines3.common.vec_env as vec_env

    choices, step = [], vec_env.DummyVecEnv.step_wait
    monkeypatch.setattr(vec_env.DummyVecEnv, "step_wait", lambda self: choices.append(1) or step(self))
    monkeypatch.setattr("envs.train_ppo.monotonic", lambda: 30.0 * len(choices))
    config = PPOConfig(tmp_path, workers=1, goal_distance=3.0, scene=str(small_place), max_minutes=6, max_steps=24)
    path = train(config, rollout=8)
    with zipfile.ZipFile(path) as archive:
        assert json.loads(archive.read("data"))["num_timesteps"] == 8  # of the second rollout, nothing was learnt
    assert len(choices) == 12 and json.loads((tmp_path / "train_ppo.json").read_text())["seconds"] == 360.0
    capsys.readouterr()
    train(config, rollout=8)
    assert "already at --max-minutes 6; raise it to go on" in capsys.readouterr().out and len(choices) == 12


def test_nothing_in_a_policy_that_it_goes_on_from_is_run(tmp_path, small_place):
    import cloudpickle

    config = PPOConfig(tmp_path, workers=1, goal_distance=3.0, scene=str(small_place), max_steps=4)
    path, harmed = train(config, rollout=4), tmp_path / "harmed"

    class Harm:
        def __reduce__(self):
            return (open, (str(harmed), "w"))

    with zipfile.ZipFile(path) as whole:
        entries = {name: whole.read(name) for name in whole.namelist()}
    data = json.loads(entries["data"])
    for name, value in data.items():
        if isinstance(value, dict) and ":serialized:" in value:
            data[name] = {**value, ":serialized:": base64.b64encode(cloudpickle.dumps(Harm())).decode()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in {**entries, "data": json.dumps(data)}.items():
            archive.writestr(name, content)
    train(replace(config, max_steps=8), rollout=4)
    assert not harmed.exists()
    with zipfile.ZipFile(path) as after:
        assert json.loads(after.read("data"))["num_timesteps"] == 8


def test_it_goes_on_with_what_is_left_of_its_budgets_and_on_other_courses(tmp_path, small_place, monkeypatch, capsys):
    import stable_baselines3.common.vec_env as vec_env

    import envs.train_ppo

    seeds, rates = [], []
    seed, save = vec_env.DummyVecEnv.seed, envs.train_ppo._save
    monkeypatch.setattr(vec_env.DummyVecEnv, "seed", lambda self, value: seeds.append(value) or seed(self, value))

    def noted(model, path):
        rates.append(model.policy.optimizer.param_groups[0]["lr"])
        save(model, path)

    monkeypatch.setattr("envs.train_ppo._save", noted)
    config = {"out": tmp_path, "workers": 1, "goal_distance": 3.0, "scene": str(small_place), "seed": 5}
    config["max_minutes"] = 20
    path = train(PPOConfig(**config, max_steps=4), rollout=4)
    file = tmp_path / "train_ppo.json"
    about = json.loads(file.read_text())
    assert 0 < about["seconds"] < 300 and rates[-1] > 0.75e-3
    file.write_text(json.dumps({**about, "seconds": 900.0}))
    train(PPOConfig(**config, max_steps=8), rollout=4)
    assert 900 < json.loads(file.read_text())["seconds"] < 1200 and 0 < rates[-1] <= 0.25e-3
    assert seeds[0] == seeds[2] == 5 and seeds[1] != seeds[3]  # the second and the last one are those of the courses
    whole, printed = path.read_bytes(), capsys.readouterr().out
    assert "already" not in printed
    train(PPOConfig(**config, max_steps=8), rollout=4)
    assert capsys.readouterr().out == f"{tmp_path}: already at --max-steps 8; raise it to go on\n"
    train(PPOConfig(**{**config, "max_minutes": 15}, max_steps=16), rollout=4)
    assert capsys.readouterr().out == f"{tmp_path}: already at --max-minutes 15; raise it to go on\n"
    assert path.read_bytes() == whole


def test_a_signal_to_all_of_its_processes_ends_it_in_order(tmp_path, small_place, start_session):
    program = (
        "import sys; from pathlib import Path; from marssim.base.command.run import exit_code\n"
        "from envs.train_ppo import PPOConfig, train\n"
        "config = PPOConfig(Path(sys.argv[1]), workers=2, goal_distance=3.0, scene=sys.argv[2])\n"
        "sys.exit(exit_code(lambda: train(config, rollout=8)))"
    )
    command = [sys.executable, "-c", program, str(tmp_path), str(small_place)]
    process = start_session(command, stdout=-1, stderr=-1, text=True)
    for _ in range(3000):
        if (tmp_path / "log.jsonl").is_file() or process.poll() is not None:
            break
        time.sleep(0.1)
    assert (tmp_path / "log.jsonl").is_file()
    os.killpg(process.pid, signal.SIGTERM)
    _, printed = process.communicate(timeout=60)
    assert printed.strip().splitlines()[-1] == "error: interrupted; the same command goes on from here"
    assert process.returncode == 130 and "Traceback" not in printed
    with pytest.raises(ProcessLookupError):
        for _ in range(100):  # until the last of them is gone
            os.killpg(process.pid, 0)
            time.sleep(0.1)


@pytest.mark.parametrize("seconds", [None, "x", -1, float("nan"), [1]])
def test_a_time_that_is_none_is_named(tmp_path, capsys, seconds):
    config = PPOConfig(tmp_path, workers=1)
    (tmp_path / "train_ppo.json").write_text(json.dumps({**config.courses(), "seconds": seconds}))
    with zipfile.ZipFile(tmp_path / "policy.zip", "w") as archive:
        with archive.open("policy.pth", "w") as file:
            torch.save({"action_net.weight": torch.zeros(13, 64)}, file)
        archive.writestr("corridors", "")
    assert main(["--out", str(tmp_path), "--workers", "1"]) == 2
    error = capsys.readouterr().err
    assert f"{tmp_path / 'train_ppo.json'}: seconds must be a number of 0 or more, got " in error


def test_two_at_once_are_refused(tmp_path, capsys):
    with sole_writer(tmp_path):
        assert main(["--out", str(tmp_path), "--workers", "1"]) == 2
    assert "another command" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_a_file_that_is_no_policy_is_not_gone_on_from(tmp_path, capsys):
    (tmp_path / "policy.zip").write_text("mine")
    assert main(["--out", str(tmp_path), "--workers", "1"]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'policy.zip'}: holds no policy of")
    assert (tmp_path / "policy.zip").read_text() == "mine"


@pytest.mark.parametrize(("flag", "value"), [("--max-minutes", "0"), ("--goal-distance", "2"), ("--seed", "-1")])
def test_a_wrong_number_is_named_before_anything_is_started(tmp_path, capsys, flag, value):
    assert main(["--out", str(tmp_path / "out"), flag, value]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {flag} must ") and error.count("\n") == 1 and not (tmp_path / "out").exists()


def test_a_policy_of_another_kind_is_not_gone_on_from(tmp_path, capsys):
    with zipfile.ZipFile(tmp_path / "policy.zip", "w") as archive, archive.open("policy.pth", "w") as file:
        torch.save({"action_net.weight": torch.zeros(2, 64), "log_std": torch.zeros(2)}, file)
    whole = (tmp_path / "policy.zip").read_bytes()
    assert main(["--out", str(tmp_path), "--workers", "1"]) == 2
    assert "is not a policy of envs.train_ppo" in capsys.readouterr().err
    assert (tmp_path / "policy.zip").read_bytes() == whole


def test_more_rocks_than_a_scene_holds_are_refused_before_the_training(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "out"), "--goal-distance", "60"]) == 2
    line = "error: --k 0.2 with a --goal-distance of 60 m: the scene may have "
    error = capsys.readouterr().err
    assert error.startswith(line) and error.count("\n") == 1 and not (tmp_path / "out").exists()


@pytest.mark.parametrize("error", [EOFError, ConnectionResetError])
def test_a_worker_that_ends_is_reported_in_one_line(tmp_path, small_place, monkeypatch, capsys, error):
    """The pipe to a worker that was killed raises either, as the environments are made or later."""
    import stable_baselines3.common.vec_env as vec_env

    class Broken(vec_env.DummyVecEnv):
        def __init__(self, makers, start_method):
            super().__init__(makers)

        def step_wait(self):
            raise error

    monkeypatch.setattr(vec_env, "SubprocVecEnv", Broken)
    flags = ["--out", str(tmp_path / "out"), "--goal-distance", "3", "--scene", str(small_place), "--workers", "2"]
    assert main(flags) == 2
    line = "error: a worker process ended: its error is above, or it was killed, perhaps for lack of memory; "
    assert capsys.readouterr().err.startswith(line)
    assert not (tmp_path / "out/policy.zip").exists()


def test_a_time_that_ends_before_anything_is_learnt_leaves_no_policy(tmp_path, small_place, monkeypatch):
    ticks = iter(range(0, 10**6, 30))
    monkeypatch.setattr("envs.train_ppo.monotonic", lambda: float(next(ticks)))
    config = PPOConfig(tmp_path, workers=1, goal_distance=3.0, scene=str(small_place), max_minutes=2)
    with pytest.raises(
        ValueError, match=r"^--max-minutes 2: the time ended before the first 8 choices, so nothing was"
    ):
        train(config, rollout=8)
    assert not (tmp_path / "policy.zip").exists()


@pytest.mark.parametrize("k", [["0.2", "0.1"], ["-0.1", "0.1"], ["0.1", "0.5"]])
def test_an_abundance_that_cannot_be_is_named(tmp_path, capsys, k):
    assert main(["--out", str(tmp_path / "out"), "--k", *k]) == 2
    assert "--k" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_the_log_of_another_command_is_left_alone(tmp_path, capsys):
    """m3depth.train calls its own the same."""
    (tmp_path / "log.jsonl").write_text("{}\n")
    assert main(["--out", str(tmp_path), "--max-steps", "1"]) == 2
    assert "train_ppo.json: no such file, so another command wrote the files in this folder" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["log.jsonl"]


def test_trainings_of_neighbouring_seeds_share_no_courses(tmp_path, small_place, monkeypatch):
    import stable_baselines3.common.vec_env as vec_env

    seeds = []
    plain = vec_env.DummyVecEnv.seed
    monkeypatch.setattr(vec_env.DummyVecEnv, "seed", lambda self, value: seeds.append(value) or plain(self, value))
    last = []
    for seed in (0, 1):
        config = PPOConfig(tmp_path / str(seed), workers=1, goal_distance=3.0, scene=str(small_place), seed=seed)
        train(replace(config, max_steps=4), rollout=4)
        last.append(seeds[-1])
    assert abs(last[0] - last[1]) > 1000 and all(0 <= value < 2**31 for value in last)


def test_a_seed_that_numpy_does_not_take_is_refused(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "out"), "--seed", "4294967296"]) == 2
    assert "--seed must lie in [0, 4294967295], got 4294967296" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
