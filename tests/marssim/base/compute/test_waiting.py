"""How the threads of OpenMP wait."""

import os
import subprocess
import sys

import pytest

from marssim.base.compute.waiting import SETTINGS, wait_briefly


def test_threads_sleep_after_a_brief_wait(monkeypatch):
    for name in SETTINGS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    wait_briefly()
    assert os.environ["OMP_WAIT_POLICY"] == "passive" and os.environ["GOMP_SPINCOUNT"] == "1000"


@pytest.mark.parametrize("name", SETTINGS)
def test_what_the_user_has_set_stays(name, monkeypatch):
    environment = {name: "1"}
    monkeypatch.setattr(os, "environ", environment)
    wait_briefly()
    assert environment == {name: "1"}


@pytest.mark.parametrize(
    ("first", "threads", "setting", "warned"),
    [
        ("torch", 2, {}, True),
        ("torch", 1, {}, False),
        ("torch", 2, {"GOMP_SPINCOUNT": "300000"}, False),
        ("m3depth", 2, {}, False),
    ],
)
def test_a_script_that_imports_torch_too_early_is_warned_once(first, threads, setting, warned):
    program = (
        f"import {first}, m3depth, torch, numpy as np; from m3depth.network.config import M3DepthConfig;"
        f"from m3depth.network.model import M3Depth; from marssim import NATECAM; torch.set_num_threads({threads});"
        "network = M3Depth(M3DepthConfig(refine_steps=1)).eval(); image = np.zeros((64, 64), np.uint8);"
        "[network.infer(image, image, NATECAM.resized(64, 64)) for _ in range(2)]"
    )
    environment = {name: value for name, value in os.environ.items() if name not in SETTINGS} | setting
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr.count("RuntimeWarning: torch was imported before m3depth or envs") == warned


@pytest.mark.parametrize("package", ["m3depth", "envs"])
def test_a_package_sets_it_before_torch_is_imported(package):
    program = f"import sys, os, {package}; print('torch' in sys.modules, os.environ['OMP_WAIT_POLICY'])"
    environment = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "passive"]
