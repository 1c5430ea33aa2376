"""What runs the network, alone and beside programs that keep cores busy."""

import os
import subprocess
import sys

import pytest

from m3depth.runtimes.choice import openvino_is_installed
from marssim.base.compute.waiting import SETTINGS

pytestmark = pytest.mark.benchmark

PROGRAM = """
import sys
from statistics import median
from time import perf_counter
from m3depth import load_estimator
import numpy as np
from marssim.base.camera import NATECAM

def timed():
    start = perf_counter()
    network.infer(texture[:, :512], texture[:, 20:532], NATECAM)
    return perf_counter() - start

texture = np.random.default_rng(0).integers(0, 256, (512, 532, 3), dtype=np.uint8)
network = load_estimator("m3depth", device="cpu", runtime=sys.argv[1])
timed()
print(median(timed() for _ in range(8)))
"""


@pytest.mark.parametrize("loops", [0, 1, 2])
@pytest.mark.parametrize(
    ("runtime", "settings"),
    [("pytorch", {"GOMP_SPINCOUNT": "300000"}), ("pytorch", {}), ("openvino", {})],
    ids=["pytorch, threads wait as by default", "pytorch", "openvino"],
)
def test_a_pair_beside_busy_loops(capsys, runtime, settings, loops):
    """512 x 512 px; GOMP_SPINCOUNT's value is the default of GNU's OpenMP."""
    if runtime == "openvino" and not openvino_is_installed():
        pytest.skip("needs OpenVINO")
    environment = {name: value for name, value in os.environ.items() if name not in SETTINGS} | settings
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, runtime], env=environment, capture_output=True, text=True, check=True
        )
    finally:
        for process in busy:
            process.kill()
            process.wait()
    with capsys.disabled():
        print(f"\n{runtime} {settings or ''} beside {loops} busy loops: {float(done.stdout):.2f} s", end="")
