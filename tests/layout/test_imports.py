"""The floors of the house: what may import what, and what an import may load."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from marssim.base.command.listing import COMMANDS

ROOT = Path(__file__).parents[2]
PACKAGES = ("marssim", "m3depth", "nav", "envs")
FACES = {"camera", "dataset"}  # of marssim.base, at marssim's door
HEAVY = {
    "marssim.scene", "marssim.render", "marssim.physics", "marssim.engines", "pybullet", "embreex", "torch",
    "matplotlib.pyplot",
}  # fmt: skip
LATE = {  # what a command loads when its work needs it, and not to print its help or a mistake
    "torch", "pybullet", "embreex", "matplotlib.figure", "trimesh", "scipy.integrate", "scipy.spatial", "distributed",
    "rosbags",
}  # fmt: skip
MOST_FILES = 16


def contract(start: str) -> dict:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    return next(c for c in contracts if c["name"].startswith(start))


def rooms_of_marssim() -> set[str]:
    folder = ROOT / "marssim"
    files = {f.stem for f in folder.glob("*.py")} - {"__init__", "__main__"}
    return files | {f.name for f in folder.iterdir() if f.is_dir() and (f / "__init__.py").is_file()}


def test_the_contract_of_m3depth_and_nav_forbids_every_other_room_of_marssim():
    forbidden = {name.removeprefix("marssim.") for name in contract("m3depth and nav")["forbidden_modules"]}
    assert forbidden == rooms_of_marssim() - {"base"} - FACES


def test_the_contract_of_base_forbids_every_other_room_of_marssim():
    forbidden = {name.removeprefix("marssim.") for name in contract("marssim.base")["forbidden_modules"]}
    assert forbidden == rooms_of_marssim() - {"base"}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_has_more_files_than_one_can_take_in(package):
    folders = [ROOT / package, *(f.parent for f in (ROOT / package).rglob("__init__.py"))]
    crowded = {str(f.relative_to(ROOT)): n for f in folders if (n := len(list(f.glob("*.py")))) > MOST_FILES}
    assert not crowded


@pytest.mark.parametrize("package", PACKAGES)
def test_every_folder_with_code_is_a_package(package):
    assert [f for f in (ROOT / package).rglob("*.py") if not (f.parent / "__init__.py").is_file()] == []


@pytest.mark.parametrize(
    "program",
    [
        "import nav; nav.Navigator; nav.ElevationMap",
        "import envs, envs.drivers; envs.__version__",
        "import m3depth; [getattr(m3depth, name) for name in m3depth.__all__ if name != 'M3Depth']",
        "import m3depth.estimator, m3depth.evaluate, m3depth.predict, m3depth.rectify, m3depth.train",
        "import marssim",
        "import marssim.camera",
        "from marssim.dataset import StereoDataset",
        "import marssim.base.dataset.dataset, marssim.base.dataset.sample",
    ],
)
def test_an_import_loads_no_more_than_it_needs(program):
    code = f"{program}\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert not HEAVY & set(done.stdout.split())


def test_commands_load_what_draws_and_what_few_need_when_they_need_it():
    commands = {f"{package}.{name}" for package, names in COMMANDS.items() for name in names}
    commands -= {"marssim.mesh", "m3depth.texture"}  # which write a mesh or draw, whatever they are asked
    code = f"import {', '.join(sorted(commands))}, sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert not LATE & set(done.stdout.split())
