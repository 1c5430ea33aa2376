"""The test of EGL in a real process, with a stand-in for PyBullet that works, draws wrongly, hangs or crashes."""

import os
import subprocess
import sys

import pytest

from marssim.engines import egl
from marssim.engines.egl import Egl, draws_on_a_card, probe

# draws two sheets as TinyRenderer and EGL would; what EGL does is put in for START and DRAWN
PYBULLET = """
import os, signal, sys, time
import numpy as np
DIRECT = GEOM_MESH = 0
plugged = []

def connect(mode):
    return len(plugged)

def loadPlugin(file, name, physicsClientId):
    plugged.append(file)
    print("GL_RENDERER={driver}")
    {start}
    return 4

def getCameraImage(width, height, view, projection, shadow, physicsClientId):
    depth, body = np.ones((height, width)), np.full((height, width), -1)
    body[:, 20:50], body[:, 50:80] = 0, 1
    depth[:, 20:80] = np.linspace(0.3, 0.7, 60)
    if plugged:
        {drawn}
    return width, height, None, depth, body

def other(*_, **__):
    return 0

createVisualShape = createMultiBody = computeViewMatrix = computeProjectionMatrixFOV = disconnect = other
"""


@pytest.fixture
def pretend(tmp_path, monkeypatch):
    """Return a function that replaces PyBullet by a stand-in: pretend(start, drawn, driver)."""

    def make(start: str = "pass", drawn: str = "pass", driver: str = "Acme 3000") -> None:
        (tmp_path / "pybullet.py").write_text(PYBULLET.format(start=start, drawn=drawn, driver=driver))
        (tmp_path / "eglRenderer.py").touch()

    monkeypatch.syspath_prepend(str(tmp_path))
    probe.cache_clear()
    yield make
    probe.cache_clear()


def test_egl_that_works_is_reported_with_its_driver(pretend):
    pretend()
    assert probe() == Egl(True, True, "Acme 3000")


def test_software_works_but_is_no_card(pretend):
    pretend(driver="llvmpipe (LLVM 15.0.6, 256 bits)")
    assert probe() == Egl(True, False, "llvmpipe (LLVM 15.0.6, 256 bits)")


@pytest.mark.parametrize(
    ("start", "drawn", "message"),
    [
        ("return -1", "pass", "did not start"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "pass", "ended with exit code -11"),
        ("os._exit(1)", "pass", "ended with exit code 1"),
        ("os._exit(0)", "pass", "without a report"),
        ("raise RuntimeError('no display')", "pass", "no display"),
        ("pass", "os.abort()", "ended with exit code -6"),
        ("pass", "body[:] = -1; depth[:] = 1", "% of the test picture"),
        ("pass", "depth += 0.1", "% of the test picture"),
        ("pass", "depth[:] = np.nan", "% of the test picture"),
        ("pass", "body[:, 60:] = 0", "% of the test picture"),
        ("pass", "body = np.roll(body, 9, axis=1)", "% of the test picture"),
    ],
)
def test_a_driver_that_fails_crashes_or_draws_something_else_does_not_work(pretend, start, drawn, message):
    pretend(start, drawn)
    state = probe()
    assert not state.works and not state.hardware and message in state.message and len(state.message.splitlines()) == 1


def test_a_driver_that_hangs_is_ended(pretend, monkeypatch, tmp_path):
    pretend(f"open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid())); time.sleep(600)")
    monkeypatch.setattr(egl, "ANSWER_WITHIN", 5.0)
    assert probe() == Egl(False, False, "no answer within 5 s")
    pid = tmp_path / "pid"
    if pid.exists() and pid.read_text():  # on a busy machine it may not even have come so far
        with pytest.raises(ProcessLookupError):
            os.kill(int(pid.read_text()), 0)


def test_egl_is_tried_once(pretend, monkeypatch):
    tried = []
    monkeypatch.setattr(egl, "_try", lambda answer: tried.append(answer) or Egl(True, True, "Acme"))
    assert probe() == probe() and len(tried) == 1


def test_without_a_process_or_a_folder_egl_does_not_work(pretend, monkeypatch):
    def refused(*_, **__):
        raise OSError("no more processes")

    with monkeypatch.context() as patch:
        patch.setattr(subprocess, "run", refused)
        assert not probe().works and "no more processes" in probe().message
    probe.cache_clear()
    monkeypatch.setattr(egl.tempfile, "TemporaryDirectory", refused)
    assert not probe().works


def test_without_pybullet_it_does_not_work(pretend, tmp_path):
    (tmp_path / "pybullet.py").write_text("raise ImportError('there is none')")
    state = probe()
    assert not state.works and "pybullet cannot be imported" in state.message


def test_without_a_graphics_card_egl_is_not_tried(pretend, monkeypatch, tmp_path):
    monkeypatch.setattr(egl, "DEVICES", tmp_path / "dev")
    monkeypatch.setattr(egl, "_try", lambda _: pytest.fail("it was tried"))
    assert not draws_on_a_card()
    (tmp_path / "dev" / "dri").mkdir(parents=True)
    (tmp_path / "dev" / "dri" / "renderD128").touch()
    for hardware in (True, False):
        probe.cache_clear()
        monkeypatch.setattr(egl, "_try", lambda _, hardware=hardware: Egl(True, hardware, "Acme"))
        assert draws_on_a_card() == hardware


def test_the_trial_prints_nothing_here():
    code = "from marssim.engines.egl import probe; probe()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "" and done.stderr == ""


def test_triton_is_loaded_before_the_driver_where_it_is_installed(tmp_path):
    """Otherwise a network of PyTorch's CUDA build crashes in a process in which Mesa has drawn."""
    (tmp_path / "triton.py").write_text("")
    code = "import sys\nfrom marssim.engines import egl\negl.load_triton_first()\nprint('triton' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == "True"
