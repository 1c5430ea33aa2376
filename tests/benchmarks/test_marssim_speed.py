import json
import subprocess
import sys
from collections import defaultdict
from functools import wraps
from time import perf_counter

import cv2
import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.base.dataset.sample import write_sample
from marssim.render import stereo
from marssim.render.renderers.by_name import make_renderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.surfaces.shading import Shader
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene
from marssim.scene.viewpoint import ViewConfig, draw_pose

pytestmark = pytest.mark.benchmark


@pytest.mark.parametrize("place", ["utopia", "jezero"])
def test_scene(clock, place):
    assert clock(f"scene {place}", lambda: build_scene(preset(place), np.random.default_rng(1)), 3) > 0


VIEWS = 8  # of a scene, as many as `marssim.generate` makes of one


class Stopwatch:
    """Time spent in functions, the innermost one that is watched counting: shadows asked for by occlusion are its."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._patch, self._inside = monkeypatch, 0

    def watch(self, holder: object, name: str, stage: str) -> None:
        function = getattr(holder, name)

        @wraps(function)
        def timed(*args, **kwargs):
            self._inside += 1
            start = perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self._inside -= 1
                if self._inside == 0:
                    self.spent[stage] += perf_counter() - start

        self._patch.setattr(holder, name, timed)


@pytest.mark.parametrize(
    ("place", "renderer", "pixels"),
    [(place, renderer, 512) for renderer in ("scan", "embree", "pybullet") for place in ("utopia", "jezero")]
    + [(place, "scan", pixels) for pixels in (1024, 2048) for place in ("utopia", "jezero")],
)
def test_pair_with_ground_truth_and_files(capsys, monkeypatch, tmp_path, place, renderer, pixels):
    """The views of a scene, its own cost shared out among them: medians of three scenes, one core."""
    cv2.setNumThreads(1)
    rig, rows, views = NATECAM.resized(pixels, pixels), [], max(VIEWS * 512**2 // pixels**2, 1)
    for seed in range(4):  # the first one warms up
        watch = Stopwatch(monkeypatch)
        start = perf_counter()
        scene = build_scene(preset(place), np.random.default_rng(seed))
        built = perf_counter()
        maker, shader = make_renderer(renderer, scene), Shader(scene)
        ready = perf_counter()
        for holder, name, stage in (
            (maker, "render", "geometry of both eyes"), (maker, "shadow_distance", "shadows"),
            (maker, "sun_share", "shadows"), (maker, "lit", "shadows"), (maker, "trace", "rays at edges"),
            (maker, "trace_ground", "rays at edges"), (shader, "surface", "shading"),
            (stereo, "occlusion", "occlusion"), (Sensor, "expose", "detector"),
        ):  # fmt: skip
            watch.watch(holder, name, stage)
        rng, sizes = np.random.default_rng(seed), []
        sensor = Sensor.draw(SensorConfig(), rng)
        for view in range(views):
            folder = tmp_path / f"{seed}-{view}"
            frame = stereo.render_stereo(maker, shader, rig, draw_pose(scene, ViewConfig(), rng), sensor, rng)
            begin = perf_counter()
            write_sample(folder, frame, {})
            watch.spent["files"] += perf_counter() - begin
            sizes.append(sum(f.stat().st_size for f in folder.iterdir()))
        end = perf_counter()
        maker.close()
        monkeypatch.undo()
        row = {"scene": built - start, "renderer": ready - built, **watch.spent}
        rows.append({**row, "rest": end - start - sum(row.values()), "whole pair": end - start})
    with capsys.disabled():
        print(f"\npair of {place}, {renderer}, {pixels} x {pixels}, files written, {np.mean(sizes) / 1e6:.2f} MB")
        for stage in rows[-1]:
            print(f"    {stage:<54} {np.median([row.get(stage, 0) for row in rows[1:]]) / views * 1e3:9.1f} ms")


GENERATE = """
import runpy
from pathlib import Path
try:
    runpy.run_module("marssim.generate", run_name="__main__")
except SystemExit as end:
    assert not end.code, end.code
# of this program alone: the peak that getrusage reports outlives exec, and includes that of the process that began it
print("MB", int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024)
"""


@pytest.mark.parametrize("pixels", [512, 1024, 2048])
@pytest.mark.parametrize("place", ["utopia", "jezero"])
def test_memory_of_a_worker(capsys, tmp_path, place, pixels):
    """Peak of a process that makes two views of each of two scenes."""
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps(NATECAM.resized(pixels, pixels).to_dict()))
    flags = ["--out", tmp_path / "data", "--scene", place, "--pairs", 4, "--views-per-scene", 2, "--rig-file", rig]
    command = [sys.executable, "-c", GENERATE, *map(str, flags), "--renderer", "scan"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    with capsys.disabled():
        print(f"\nmemory of a worker, {place}, {pixels} x {pixels}: {run.stdout.split()[-1]} MB", end="")
