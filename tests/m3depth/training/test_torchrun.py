"""Two processes under torchrun train as one does that takes their crops one after the other."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest
import torch
from small_network import SMALL

from m3depth.network.model import M3Depth
from m3depth.training.config import TrainConfig
from m3depth.training.loop import train
from m3depth.training.samples import JoinedPairs
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.results import lock
from marssim.base.results.lock import sole_writer

TINY = replace(SMALL, refine_steps=1, fine_width=0)

SETTINGS = (
    "--batch", "1", "--crop", "32", "64", "--device", "cpu", "--precision", "fp32", "--validate-samples", "1",
    "--lr", "1e-4", "--seed", "1",
)  # fmt: skip
ENDS = 540  # [s] for a machine that is very busy


EACH_ITS_OWN = """
import os, sys
from m3depth.train import main

os.chdir(sys.argv[1 + int(os.environ["RANK"])])  # as on machines without a common disk
sys.exit(main(sys.argv[3:]))
"""


def apart_folders(plane_set, tmp_path) -> None:
    """Resumed where only the first process sees the checkpoint, every process refuses."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "own.py").write_text(EACH_ITS_OWN)
    done = torchrun(
        str(tmp_path / "own.py"), str(tmp_path), str(tmp_path / "elsewhere"), "--data", str(plane_set), "--out", "two",
        "--init", str(tmp_path / "init.safetensors"), "--max-steps", "3", *SETTINGS,
    )  # fmt: skip
    assert done.returncode != 0
    message = "error: --out two: the processes resumed at steps 0 to 2; it must be a folder that all machines share"
    assert done.stderr.count(message) >= 1, done.stderr[-3000:]  # torchrun may end the other process before it prints
    assert not (tmp_path / "elsewhere" / "two").exists()


def torchrun(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run two processes and return their output."""
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", *arguments]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=ENDS, check=False)


def test_two_processes_are_one_batch_in_two_parts(plane_set, large_set, tmp_path) -> None:
    torch.manual_seed(0)
    M3Depth(TINY).save_pretrained(tmp_path / "init.safetensors")
    init = tmp_path / "init.safetensors"
    done = torchrun(
        "-m", "m3depth.train", "--data", str(plane_set), str(large_set), "--out", str(tmp_path / "two"),
        "--init", str(init), "--max-steps", "2", *SETTINGS,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.count("averaged weights of step 2") == 1  # one of the processes speaks and writes
    assert "Warning" not in done.stderr
    config = TrainConfig(
        data=(plane_set, large_set), out=tmp_path / "one", init=init, max_steps=2, batch=2, accumulate=2, crop=(32, 64),
        device="cpu", precision="fp32", validate_samples=1, lr=1e-4, seed=1,
    )  # fmt: skip
    train(config, JoinedPairs([StereoDataset(path, "train") for path in (plane_set, large_set)]), [])
    two, one = (torch.load(tmp_path / name / "checkpoint.pt", weights_only=True) for name in ("two", "one"))
    assert (two["identity"]["number of processes"], one["identity"]["number of processes"]) == (2, 1)
    before = M3Depth.from_pretrained(tmp_path / "init.safetensors").state_dict()
    moved = torch.cat([(one["model"][name] - before[name]).abs().flatten() for name in before])
    apart = torch.cat([(one["model"][name] - two["model"][name]).abs().flatten() for name in before])
    assert moved.mean() > 2e-5
    assert apart.mean() < 0.01 * moved.mean()  # Adam blows up what rounding makes of gradients that are nearly zero
    apart_folders(plane_set, tmp_path)
    steps = [json.loads(line) for line in (tmp_path / "one" / "log.jsonl").read_text().splitlines()]
    assert any("finer" in record for record in steps)  # a larger pair was among the crops
    records = [json.loads(line) for line in (tmp_path / "two" / "log.jsonl").read_text().splitlines()]
    assert [record["kind"] for record in records] == ["start", "train", "stop", "val_raw", "val"]
    assert (records[0]["processes"], steps[0]["processes"]) == (2, 1)


REFUSED = """
import sys
from pathlib import Path
from m3depth.training.process_group import entered_by_first, joined_group
from marssim.base.results.claim import ResultFolder

with joined_group("cpu") as (rank, world, device):
    for folder in sys.argv[1:]:
        try:
            with entered_by_first(rank, world, ResultFolder(Path(folder), "training run").claim()):
                print(f"process {rank} entered\\n", end="", flush=True)  # in one write: the other process prints too
        except ValueError as error:
            print(f"process {rank}: {error}\\n", end="", flush=True)
"""


@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_every_process_learns_that_another_command_holds_the_folder(tmp_path) -> None:
    """Only the first asks for the folder; the others neither wait for it nor go on without. All enter a free one."""
    (tmp_path / "ask.py").write_text(REFUSED)
    with sole_writer(tmp_path / "run"):
        done = torchrun(str(tmp_path / "ask.py"), str(tmp_path / "run"), str(tmp_path / "free"))
    assert done.returncode == 0, done.stderr[-3000:]
    for rank in range(2):
        message = rf"^process {rank}: {tmp_path / 'run'}: another command \(process {os.getpid()} .*let it end first$"
        assert re.search(message, done.stdout, re.MULTILINE), done.stdout
    entered = sorted(line for line in done.stdout.splitlines() if line.endswith("entered"))
    assert entered == ["process 0 entered", "process 1 entered"], done.stderr[-3000:]
