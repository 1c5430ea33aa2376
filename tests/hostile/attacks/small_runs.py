"""The commands that continue after a kill, as small as they run, and what their results must have in common."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from small_network import SMALL

TIMES = {
    "seconds",
    "minutes",
    "processor_minutes",
    "step_seconds",
    "perception_seconds",
    "loader_share",
    "memory_mib",
}  # keys of costs
LOG = "log.jsonl"  # of a training; that of envs.train_ppo depends on the clock
TEXTS = {".md": "\n", ".html": "</html>\n"}  # have times among their words; how they end
LEFT_OVER = ("*.part", "*.partial", ".lock", "unfinished.npz")  # what no run that is done may leave


@dataclass(frozen=True)
class SmallRun:
    """A command that takes a few seconds."""

    entry: str
    """Its module, or module:function."""
    args: str
    """Its command line without --out. {data}, {weights} and {network} stand for paths."""
    drawn: tuple[str, ...] = ()
    """Glob patterns of files that differ from run to run, since they draw or hold times."""

    def line(self, out: Path, inputs: dict[str, Path]) -> list[str]:
        """Return the command line."""
        return ["--out", str(out), *(word.format(**inputs) for word in self.args.split())]


PAIRS = (
    "--pairs 3 --views-per-scene 2 --renderer embree --seed 9 --rocks.k 0.02 --rig.width 32 --rig.height 32 "
    "--rig.focal 60 --size 12 --horizon 14"
)
GENERATE = f"{PAIRS} --look.gravel 0 0"  # bare ground, which takes a fraction of the time
RUNS = {
    "marssim.generate": SmallRun("marssim.generate", GENERATE),
    "m3depth.train": SmallRun(
        "m3depth.train",
        "--data {data} --network {network} --batch 1 --crop 32 32 --max-steps 6 --device cpu --validate-every 3 "
        "--validate-samples 1 --checkpoint-minutes 0.001",
        ("curves.png",),
    ),
    "envs.train_ppo": SmallRun(
        "small_commands:train_ppo",
        "--workers 1 --goal-distance 3 --max-steps 24 --max-minutes 600",
        ("policy.zip",),
    ),
    "m3depth.evaluate": SmallRun(
        "small_commands:evaluate",
        "--data {data} --split all --weights {weights} --limit 3 --runtime pytorch",
        ("*.png",),
    ),
    "envs.evaluate": SmallRun(
        "envs.evaluate",
        "--driver straight --perception ground_truth --dynamics kinematic --goal-distance 4 --k 0.01 --no-videos "
        "--episodes 2",
    ),
    "m3depth.predict": SmallRun("m3depth.predict", "{data} --weights {weights} --runtime pytorch --write depth cloud"),
    "marssim.export": SmallRun("marssim.export", "{data} --format kitti"),
}
KILLED = tuple(RUNS)[:-1]  # those whose work takes long enough to be hit
SHORT = ("m3depth.predict", "marssim.export")  # those that take a second or two


def make_inputs(folder: Path, server: Any) -> dict[str, Path]:
    """Make the dataset, network and weights that the commands read."""
    inputs = {name: folder / file for name, file in (("data", "set"), ("network", "net.json"))}
    inputs["weights"] = folder / "weights.safetensors"
    inputs["network"].write_text(json.dumps(SMALL.to_dict()))
    args = [*PAIRS.split(), "--scene", "gale", "--pairs", "12", "--rig.width", "64", "--rig.height", "64"]
    server.run("marssim.generate", ["--out", str(inputs["data"]), *args]).check()
    torch.manual_seed(0)
    from m3depth.network.model import M3Depth

    M3Depth(SMALL).save_pretrained(inputs["weights"])
    return inputs


def left_over(out: Path) -> list[Path]:
    """Return files of a run that is done which should be gone."""
    return [path for pattern in LEFT_OVER for path in out.rglob(pattern)]


def results(run: SmallRun, out: Path) -> dict[str, Any]:
    """Return the content of each file of results, without times, by its path in the folder."""
    drawn = {path for pattern in run.drawn for path in out.rglob(pattern)}
    contents: dict[str, Any] = {}
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        name = str(path.relative_to(out))
        if "tfevents" in name:  # a file for each start
            continue
        if path in drawn:
            contents[name] = _opens(path)
        elif path.suffix in TEXTS:
            contents[name] = path.read_text(encoding="utf-8").endswith(TEXTS[path.suffix])
        elif path.name == LOG:
            contents[name] = [
                without_times(record, str(out))
                for record in map(json.loads, path.read_text().splitlines())
                if record.get("kind") in ("train", "val", "val_raw")
            ]
        elif path.suffix == ".json":
            contents[name] = without_times(json.loads(path.read_text()), str(out))
        elif path.suffix == ".pt":
            contents[name] = without_times(torch.load(path, weights_only=True), str(out))
        else:
            contents[name] = path.read_bytes()
    return contents


def without_times(value: Any, out: str) -> Any:
    """Return nested values without times and without the name of the folder, tensors as lists."""
    if isinstance(value, dict):
        return {str(k): without_times(v, out) for k, v in value.items() if k not in TIMES}
    if isinstance(value, list | tuple):
        return [without_times(item, out) for item in value]
    if isinstance(value, torch.Tensor):
        return value.tolist()
    return value.replace(out, "OUT") if isinstance(value, str) else value


def _opens(path: Path) -> str:
    """Return the kind of a file that must be whole."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
            return str(json.loads(archive.read("data"))["num_timesteps"])
    return "whole" if path.read_bytes()[-8:-4] == b"IEND" else "broken"


def differing(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    """Yield what differs between two folders' results."""
    for name in sorted(before.keys() | after.keys()):
        if name not in after or name not in before:
            yield f"{name}: {'missing' if name in before else 'left over'}"
        elif before[name] != after[name]:
            yield f"{name}: {_where(before[name], after[name])}"


def _where(before: Any, after: Any) -> str:
    if isinstance(before, dict) and isinstance(after, dict):
        keys = [k for k in sorted(before.keys() | after.keys()) if before.get(k) != after.get(k)]
        return f"{keys[0]}.{_where(before.get(keys[0]), after.get(keys[0]))}"
    return f"{str(before)[:60]} became {str(after)[:60]}"
