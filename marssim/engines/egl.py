"""A test of whether PyBullet's EGL renderer works here, run in a child process because a failure may kill it.

EGL draws without a display, on a graphics card or with Mesa's software driver. Where a library or a driver is missing,
PyBullet's plugin exits, crashes or hangs. So a child process draws a picture, and this process reads its report.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from marssim.base.files.json_file import json_text
from marssim.engines.bullet import import_pybullet

ANSWER_WITHIN = 60.0  # [s] limit for the child process; it takes two seconds, but the machine may be busy
PLUGIN = "_eglRendererPlugin"
SOFTWARE = re.compile(r"llvmpipe|softpipe|swrast|software", re.IGNORECASE)
DEVICES, CARDS = Path("/dev"), ("dri/renderD*", "nvidia[0-9]*", "dxg")  # on Linux; PyBullet has no EGL elsewhere
SIZE = 96  # [px] side of the test picture
ALIKE = 0.97  # least share of its pixels that must equal those of TinyRenderer, which samples half a pixel away


@dataclass(frozen=True)
class Egl:
    """The result of the test.

    Attributes:
        works: EGL draws what TinyRenderer draws.
        hardware: It draws on a graphics card.
        message: The name of the driver, or what went wrong, in one line.
    """

    works: bool
    hardware: bool
    message: str


@cache
def probe() -> Egl:
    """Return whether EGL works here. The test runs once per process; it never raises."""
    try:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            return _try(Path(folder) / "report.json")
    except OSError as error:
        return Egl(False, False, f"the test could not be started: {error}")


def draws_on_a_card() -> bool:
    """Return whether EGL works here on a graphics card. Without a card, nothing is tested.

    With Mesa's software driver a view takes 1.5 times as long as with TinyRenderer.
    """
    return any(any(DEVICES.glob(name)) for name in CARDS) and probe().hardware


def _try(answer: Path) -> Egl:
    """Run the test. answer: the file that the child process writes. Raises OSError if no process can be started."""
    command = [sys.executable, "-c", "from marssim.engines.egl import report; report()", str(answer)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    try:
        done = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, timeout=ANSWER_WITHIN,
            check=False, text=True, errors="replace",
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Egl(False, False, f"no answer within {ANSWER_WITHIN:g} s")
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or ["it printed nothing"]
        return Egl(False, False, f"the test ended with exit code {done.returncode}: {last[0]}")
    try:
        content = json.loads(answer.read_text(encoding="utf-8"))
        alike, failed = float(content["alike"]), str(content["failed"])
    except (OSError, ValueError, KeyError, TypeError):
        return Egl(False, False, "the test ended without a report")
    if failed or not alike >= ALIKE:
        return Egl(False, False, failed or f"only {alike:.0%} of the test picture were right")
    driver = re.search(r"^GL_RENDERER *= *(.+)$", done.stdout, re.MULTILINE)
    if driver is None:
        return Egl(True, False, "a driver without a name")
    return Egl(True, SOFTWARE.search(driver[1]) is None, driver[1].strip())


def load_triton_first() -> None:
    """Import Triton, if it is installed, before a graphics driver brings its own LLVM into this process.

    PyTorch's CUDA builds import Triton later, as when a network is built. Mesa's driver and Triton each bring LLVM;
    the process crashes when Mesa's is loaded first, and works the other way round.
    """
    if importlib.util.find_spec("triton") is not None:
        with contextlib.suppress(ImportError):
            importlib.import_module("triton")


def load_plugin(pb: ModuleType, client: int) -> bool:
    """Let EGL draw for a PyBullet client.

    Args:
        pb: The pybullet module.
        client: Id of the client.

    Returns:
        False if the plugin is missing or does not start. It may also crash the process.
    """
    spec = importlib.util.find_spec("eglRenderer")
    if spec is None or spec.origin is None:
        return False
    return bool(pb.loadPlugin(spec.origin, PLUGIN, physicsClientId=client) >= 0)


def report() -> None:
    """Draw one picture both ways and write how alike they are to the file argv[1]. The child process runs this."""
    pictures, failed = [], ""
    pb = import_pybullet()
    for egl in (False, True):
        client = pb.connect(pb.DIRECT)
        if egl and not load_plugin(pb, client):
            failed = "PyBullet's plugin did not start"
            break
        pictures.append(_picture(pb, client))
        pb.disconnect(client)
    alike = 0.0 if failed else _alike(*pictures)
    Path(sys.argv[1]).write_text(json_text({"alike": alike, "failed": failed}), encoding="utf-8")


def write_stl(path: Path, corners: np.ndarray) -> None:
    """Write triangles as a binary STL file, the one mesh format that the plugin reads fast. corners: (F, 3, 3)."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles = np.zeros(len(corners), dtype=triangle)
    triangles["corners"] = corners
    path.write_bytes(bytes(80) + len(corners).to_bytes(4, "little") + triangles.tobytes())


def _picture(pb: ModuleType, client: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw two crossing sheets before the sky; return each pixel's depth and body, (SIZE, SIZE) each."""
    with tempfile.TemporaryDirectory() as folder:
        for n, tilt in enumerate((0.6, -0.3)):
            x, y = np.array([-1.0, 1, 1, -1]), np.array([-1.0, -1, 1, 1])
            sheet = np.stack([x, y, tilt * x + 0.2 * y], axis=1)[[[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]]
            file = Path(folder) / f"{n}.stl"
            write_stl(file, sheet)
            shape = pb.createVisualShape(pb.GEOM_MESH, fileName=str(file), physicsClientId=client)
            pb.createMultiBody(0, -1, shape, physicsClientId=client)
    view = pb.computeViewMatrix([0.4, -0.3, 4.0], [0, 0, 0], [0, 1, 0])
    projection = pb.computeProjectionMatrixFOV(45.0, 1.0, 1.0, 10.0)
    image = pb.getCameraImage(SIZE, SIZE, view, projection, shadow=0, physicsClientId=client)
    depth, body = (np.asarray(image[n], dtype=float).reshape(SIZE, SIZE) for n in (3, 4))
    return depth, body


def _alike(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray]) -> float:
    """Return the share of pixels that show the same body at the same depth; 0 where a body or the sky hardly shows."""
    (depth, body), (other_depth, other_body) = first, second
    if min(np.mean(body == n) for n in (-1, 0, 1)) < 0.05:
        return 0.0
    return float(np.mean((body == other_body) & ((body < 0) | (np.abs(depth - other_depth) < 0.02))))
