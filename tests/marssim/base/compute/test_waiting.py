"""How the threads of OpenMP wait."""

import os
import subprocess
import sys

import pytest

from marssim.base.compute.waiting import SETTINGS, wait_passively


def test_threads_wait_passively(monkeypatch):
    for name in SETTINGS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    wait_passively()
    assert os.environ["OMP_WAIT_POLICY"] == "passive"


@pytest.mark.parametrize("name", SETTINGS)
def test_what_the_user_has_set_stays(name, monkeypatch):
    environment = {name: "1"}
    monkeypatch.setattr(os, "environ", environment)
    wait_passively()
    assert environment == {name: "1"}


@pytest.mark.parametrize("package", ["m3depth", "envs"])
def test_a_package_sets_it_before_torch_is_imported(package):
    program = f"import sys, os, {package}; print('torch' in sys.modules, os.environ['OMP_WAIT_POLICY'])"
    environment = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "passive"]
