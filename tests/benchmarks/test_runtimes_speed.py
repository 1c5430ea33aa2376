"""What runs the network, alone and beside programs that keep cores busy."""

import os
import subprocess
import sys
from statistics import median
from time import process_time

import numpy as np
import pytest

from m3depth import load_estimator
from m3depth.runtimes.choice import openvino_is_installed
from marssim.base.camera import MAX_DEPTH, MIN_DEPTH
from marssim.base.compute.waiting import SETTINGS
from marssim.base.dataset.dataset import StereoDataset
from marssim.generate import main as generate

pytestmark = pytest.mark.benchmark

PROGRAM = """
import sys
from resource import RUSAGE_SELF, getrusage
from statistics import median
from time import perf_counter
import cv2
from m3depth import load_estimator
import numpy as np
from marssim.base.camera import PinholeCamera, StereoRig

def timed():
    start = perf_counter()
    infer(texture[:, :size], texture[:, shift : shift + size])
    return perf_counter() - start

method, size, repeats = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
shift = 20 * size // 512
texture = np.random.default_rng(0).integers(0, 256, (size, size + shift, 3), dtype=np.uint8)
if method == "sgbm":
    texture = texture[..., 0].copy()
    infer = cv2.StereoSGBM_create(0, 192 * size // 512, 5, 200, 800, mode=cv2.STEREO_SGBM_MODE_HH).compute
else:
    network = load_estimator("m3depth", device="cpu", runtime=method)
    rig = StereoRig(PinholeCamera.centred(size, size, 595.9 * size / 512), 0.27)
    infer = lambda left, right: network.infer(left, right, rig)
first = timed()
print(first, median(timed() for _ in range(repeats)), getrusage(RUSAGE_SELF).ru_maxrss / 1024)
"""


def measured(method, size, repeats, settings=()):
    """The seconds of a first pair in a process, the median of those after it, and the process's peak memory [MiB].

    sgbm is OpenCV's along eight paths, in one thread, with 192 disparities at 512 px and as many in proportion.
    """
    if method == "openvino" and not openvino_is_installed():
        pytest.skip("needs OpenVINO")
    environment = {name: value for name, value in os.environ.items() if name not in SETTINGS} | dict(settings)
    command = [sys.executable, "-c", PROGRAM, method, str(size), str(repeats)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return map(float, done.stdout.split())


@pytest.mark.parametrize("size", [512, 1024, 2048])
@pytest.mark.parametrize("method", ["pytorch", "openvino", "sgbm"])
def test_a_pair_of_each_size(capsys, method, size):
    first, later, memory = measured(method, size, 4)
    with capsys.disabled():
        print(f"\n{method}, {size} px: first {first:.2f} s, then {later:.2f} s, peak {memory:.0f} MiB", end="")


@pytest.mark.parametrize("loops", [0, 1, 2])
@pytest.mark.parametrize(
    ("runtime", "settings"),
    [("pytorch", {"GOMP_SPINCOUNT": "300000"}), ("pytorch", {}), ("openvino", {}), ("sgbm", {})],
    ids=["pytorch, threads wait as by default", "pytorch", "openvino", "sgbm"],
)
def test_a_pair_beside_busy_loops(capsys, runtime, settings, loops):
    """512 x 512 px; GOMP_SPINCOUNT's value is the default of GNU's OpenMP."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    try:
        _, seconds, _ = measured(runtime, 512, 8, settings)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    with capsys.disabled():
        print(f"\n{runtime} {settings or ''} beside {loops} busy loops: {seconds:.2f} s", end="")


@pytest.mark.parametrize(("size", "pairs"), [(512, 10), (1024, 2)])
def test_maps_and_processor_time_of_both_runtimes(tmp_path, capsys, monkeypatch, size, pairs):
    """The shipped weights on pairs of all places: how much the disparities differ, their errors, and the time."""
    if not openvino_is_installed():
        pytest.skip("needs OpenVINO")
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: True)
    rig = ["--rig.width", str(size), "--rig.height", str(size), "--rig.focal", str(595.9 * size / 512)]
    assert generate(["--out", str(tmp_path), "--pairs", str(pairs), "--scene", "mixed", "--seed", "3", *rig]) == 0
    networks = {name: load_estimator("m3depth", device="cpu", runtime=name) for name in ("pytorch", "openvino")}
    disparities: dict[str, list[np.ndarray]] = {name: [] for name in networks}
    seconds: dict[str, list[float]] = {name: [] for name in networks}
    truths = []
    for sample in StereoDataset(tmp_path):
        scored = (sample.depth >= MIN_DEPTH) & (sample.depth <= MAX_DEPTH)
        truths.append(sample.disparity[scored])
        for name, network in networks.items():
            for _ in range(2):  # the first time, OpenVINO compiles
                start = process_time()
                prediction = network.infer(sample.left, sample.right, sample.rig)
                spent = process_time() - start
            seconds[name].append(spent)
            disparities[name].append(np.nan_to_num(prediction.disparity[scored]))
    errors = {name: [np.abs(d - t).mean() for d, t in zip(maps, truths)] for name, maps in disparities.items()}
    apart = np.mean([np.abs(a - b).mean() for a, b in zip(*disparities.values())])
    most = np.abs(np.subtract(*errors.values())).max()
    with capsys.disabled():
        print(f"\n{size} px, {pairs} pairs: disparities differ by {apart:.4f} px, errors by at most {most:.4f} px")
        for name in networks:
            print(f"{name}: error {np.mean(errors[name]):.4f} px, {median(seconds[name]):.2f} s of processor time")
