"""OpenVINO, which reports its use to its makers where it is imported otherwise."""

import os
import subprocess
import sys
from importlib.util import find_spec

import pytest

pytestmark = pytest.mark.skipif(find_spec("openvino") is None, reason="OpenVINO is not installed")

PROGRAM = """
import sys

def note(event, arguments):
    if event in ("socket.getaddrinfo", "socket.connect", "os.fork"):
        with open("events.txt", "a") as file:
            file.write(f"{event} {arguments}\\n")

sys.addaudithook(note)
from dataclasses import replace

import torch
from small_network import SMALL

from m3depth.network.model import M3Depth
from m3depth.runtimes.graphs import converted, unpacked

network = M3Depth(replace(SMALL, refine_steps=0, lookup_levels=0, convex_upsampling=False, fine_width=0)).eval()
print(len(unpacked(converted(network, False, torch.float32)).inputs))
"""


def test_nothing_is_reported_by_an_import_or_a_conversion(tmp_path):
    asked = {name: value for name, value in os.environ.items() if name not in ("CI", "TF_BUILD", "JENKINS_URL")}
    environment = {**asked, "HOME": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "3\n"), done.stderr
    assert [file.name for file in tmp_path.iterdir()] == []
