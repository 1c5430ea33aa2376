"""Each program in examples runs, small."""

import contextlib
import importlib
import io
import json
import os
import runpy
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import pytest

from marssim.generate import main as generate

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
RIG = ["--rig.width", "96", "--rig.height", "96", "--rig.focal", "112"]
GROUND = ["--size", "12", "--renderer", "scan", "--seed", "1"]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    out = tmp_path_factory.mktemp("examples") / "data"
    assert generate(["--out", str(out), "--pairs", "2", "--views-per-scene", "1", *RIG, *GROUND]) == 0
    return out


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    out = tmp_path_factory.mktemp("examples") / "drive"
    views = ["--trajectory", "--pairs", "2", "--views-per-scene", "2"]
    assert generate(["--out", str(out), *views, *RIG, *GROUND]) == 0
    return out


def run(program: str, *args: object) -> str:
    """Run an example as a program, in this process, which has its libraries already, and return what it prints."""
    printed = io.StringIO()
    with patch.object(sys, "argv", [program, *map(str, args)]), contextlib.redirect_stdout(printed):
        runpy.run_path(str(EXAMPLES / program), run_name="__main__")
    return printed.getvalue()


def test_every_program_is_in_the_list_and_has_a_test():
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    tested = Path(__file__).read_text(encoding="utf-8")
    programs = [file.name for file in EXAMPLES.iterdir() if file.suffix in (".py", ".ipynb")]
    assert len(programs) >= 7
    assert [name for name in programs if f"]({name})" not in listed or f'"{name}"' not in tested] == []


def test_every_program_is_listed_with_the_line_that_runs_it_without_flags():
    lines = (EXAMPLES / "README.md").read_text(encoding="utf-8").splitlines()
    for file in EXAMPLES.glob("*.py"):
        assert [line for line in lines if f"]({file.name})" in line and f"| `python examples/{file.name}` |" in line]


@pytest.mark.parametrize(
    "program", ["own_estimator.py", "pandora_round_trip.py", "read_dataset_pytorch.py", "replay_navigator.py"]
)
def test_a_program_without_its_dataset_names_the_command_that_makes_it(program, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / program)], capture_output=True, text=True, env=environment, cwd=tmp_path
    )
    message, _, command = done.stderr.partition("; make it with: ")
    assert done.returncode == 1 and message.endswith(": no such folder")
    assert command.startswith("python -m marssim.generate --out data/")
    assert f"    {command}" in (EXAMPLES / "README.md").read_text(encoding="utf-8")


def test_a_dataset_is_read_by_pytorch(data):
    assert "1 pairs of train" in run("read_dataset_pytorch.py", "--data", data)


def test_a_frame_is_rendered(tmp_path):
    assert "depth from" in run("render_one_frame.py", "--out", tmp_path / "frame", "--scene", "utopia")
    assert {file.name for file in (tmp_path / "frame").iterdir()} == {"left.png", "right.png", "depth.npy"}


def test_an_estimator_of_ones_own_is_scored(data):
    lines = run("own_estimator.py", "--data", data, "--pairs", 1).splitlines()
    assert [line.split()[0] for line in lines] == ["method", "Blocks", "SGBM", "M3Depth"]


def test_a_driver_of_ones_own_drives_beside_the_navigator():
    lines = run("own_driver.py", "--goal-distance", 4, "--k", 0.01).splitlines()
    assert [line.split()[0] for line in lines] == ["Wary", "NavigatorDriver"]


def test_an_episode_is_driven():
    assert run("one_episode.py", "--goal-distance", 4).splitlines()[-1].startswith("goal after")


def test_recorded_images_are_replayed(drive):
    assert len(run("replay_navigator.py", "--data", drive, "--ahead", 5).splitlines()) == 2


@pytest.mark.usefixtures("undrawn_figures")
def test_the_round_trip_by_pandora_scores_what_came_back(data, tmp_path, monkeypatch):
    """The program starts commands of this project; they run in this process, too."""

    def called(command: list[str], whole=subprocess.run, **settings: object) -> object:
        if command[0] != sys.executable:
            return whole(command, **settings)  # git, which these commands ask
        _, option, module, *flags = command
        assert option == "-m" and settings == {"check": True}
        assert importlib.import_module(module).main(flags) == 0
        return None

    monkeypatch.setattr(subprocess, "run", called)
    assert "Pandora" in run("pandora_round_trip.py", "--data", data, "--out", tmp_path / "trip")
    config = json.loads(next((tmp_path / "trip" / "maps").glob("*/config.json")).read_text())
    assert config["input"]["left"]["disp"] == [-192, 0]


@pytest.mark.usefixtures("undrawn_figures")
def test_the_cells_of_the_notebook_run_one_after_the_other(tmp_path):
    """As a program, with tiny settings in place of those of its first cell."""
    notebook = json.loads((EXAMPLES / "chain.ipynb").read_text(encoding="utf-8"))
    first, *cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    tiny = {
        "work": f"Path({str(tmp_path)!r})", "place": "preset('utopia', size=12, horizon=16)",
        "rig": "NATECAM.resized(96, 96)", "steps": "1", "perception": "'ground_truth'", "goal_distance": "4.0",
    }  # fmt: skip
    imports = [line for line in first.splitlines() if "import" in line]
    settings = [f"{name} = {value}" for name, value in tiny.items()]
    assert [line.split()[0] for line in first.splitlines() if " = " in line] == list(tiny)
    program = tmp_path / "chain.py"
    program.write_text("\n".join([*imports, *settings, *cells]))
    assert "goal: " in run(str(program))


def test_the_notebook_holds_its_outputs_and_is_small():
    text = (EXAMPLES / "chain.ipynb").read_text(encoding="utf-8")
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert len(text) < 300_000
    assert sum(any("image/jpeg" in output.get("data", {}) for output in cell["outputs"]) for cell in cells) >= 4
    assert not any(output["output_type"] == "error" for cell in cells for output in cell["outputs"])
