"""Settings and examples for all tests."""

import os
import re
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import settings
from matplotlib.figure import Figure

from marssim.base.images.figure_pixels import figure_pixels

# With two threads, PyTorch's results may differ from run to run in their last bits. So set before torch is imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
cv2.setNumThreads(1)

# Times on shared machines mean nothing: no deadlines. Few examples, the same ones each time: the suite stays fast.
settings.register_profile("suite", deadline=None, max_examples=50, derandomize=True)
settings.load_profile("suite")

# What `make quick` runs: the chain from end to end, and of each room the tests that take a moment.
QUICK = (
    "chain/", "layout/",
    "marssim/base/test_camera.py", "marssim/base/dataset/", "marssim/base/files/", "marssim/base/results/",
    "marssim/base/command/test_listing.py", "marssim/scene/rocks/test_golombek.py", "marssim/scene/rocks/test_mesh.py",
    "marssim/scene/rocks/test_placement.py", "marssim/render/geometry/test_vectors.py", "marssim/render/test_sensor.py",
    "marssim/physics/test_linkage.py",
    "m3depth/network/test_wavelet.py", "m3depth/network/test_geometry.py", "m3depth/network/test_cost_volume.py",
    "m3depth/training/test_losses.py", "m3depth/evaluation/test_metrics.py", "m3depth/stereo/test_plane_normals.py",
    "m3depth/test_estimator.py", "m3depth/test_checked_inference.py", "hostile/test_planted.py",
    "nav/test_controller.py", "nav/ground/", "nav/path/test_planner.py", "nav/path/test_footprint.py",
    "envs/drives/test_metrics.py", "envs/world/test_odometry.py", "envs/observation/test_spaces.py",
)  # fmt: skip

# The files that take longest, in the order in which workers take them, so that a small one is the last. The first one
# needs none of the simulator's kernels, which the second one compiles: one worker compiles, and the other loads them.
LONGEST = (
    "m3depth/runtimes/test_openvino_network.py", "marssim/test_generate.py", "m3depth/test_train.py",
    "envs/test_mars_nav.py", "envs/test_evaluate.py", "m3depth/test_evaluate.py", "m3depth/training/test_torchrun.py",
    "examples/test_examples.py", "marssim/test_robustness.py", "envs/test_train_ppo.py", "m3depth/test_export.py",
    "m3depth/test_rectify.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that `make quick` runs, and put the longest files first."""
    root = Path(__file__).parent
    names = {item.path: item.path.relative_to(root).as_posix() for item in items}
    for item in items:
        if names[item.path].startswith(QUICK):
            item.add_marker(pytest.mark.quick)
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(names[item.path], len(LONGEST)))


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> Iterator[None]:
    """Let SIGINT interrupt, also where the tests run in the background of a script, which has them ignore it."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def pytorch_by_default() -> Iterator[None]:
    """Let PyTorch run the tests' networks: OpenVINO would convert each. Its own tests undo this."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: False)
        yield


@pytest.fixture
def start_session() -> Iterator[Callable[..., subprocess.Popen]]:
    """Return what starts a process in a session of its own, as subprocess.Popen does, until the test ends."""
    processes: list[subprocess.Popen] = []

    def start(*arguments: Any, **keywords: Any) -> subprocess.Popen:
        processes.append(subprocess.Popen(*arguments, start_new_session=True, **keywords))
        return processes[-1]

    yield start
    for process in processes:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture
def undrawn_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let blank pictures stand for figures, each of which takes half a second to draw: the test is not about them."""
    monkeypatch.setattr("m3depth.figures.drawing.figure_pixels", lambda figure: np.full((8, 8, 3), 255, np.uint8))


@pytest.fixture
def drawn_figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Every figure of the test, as it is when m3depth.figures.drawing.save writes it."""
    figures: list[Figure] = []

    def pixels(figure: Figure) -> np.ndarray:
        figures.append(figure)
        return figure_pixels(figure)

    monkeypatch.setattr("m3depth.figures.drawing.figure_pixels", pixels)
    return figures


@pytest.fixture(scope="session")
def guide_program() -> Callable[[str], str]:
    """The program of the guides on own estimators, drivers, networks and pairs whose first line is a file's name."""
    guides = Path(__file__).parents[1] / "docs" / "guides"
    pages = "".join((guides / f"{name}.md").read_text() for name in ("own-estimator", "own-driver", "rivals", "train"))
    return lambda name: re.search(rf"```python\n(# {re.escape(name)}\n.*?)```", pages, re.DOTALL)[1]


@pytest.fixture
def my_stereo(tmp_path, monkeypatch, guide_program) -> str:
    """Class path of the guide's estimator, which can be imported."""
    (tmp_path / "my_stereo.py").write_text(guide_program("my_stereo.py"))
    monkeypatch.syspath_prepend(str(tmp_path))
    return "my_stereo:Blocks"


@pytest.fixture(scope="session")
def chromium() -> Callable[..., Any]:
    """Return how to open headless Chromium with more arguments; skips where it is not installed."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("Chromium and its driver are not installed")

    def opened(*arguments: str) -> Any:
        options = webdriver.ChromeOptions()
        options.binary_location = program
        for argument in ("--headless=new", "--no-sandbox", "--no-first-run", *arguments):
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        return webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))

    return opened


@pytest.fixture
def browser_3d(chromium: Callable[..., Any]) -> Iterator[Any]:
    """Headless Chromium that draws in 3-D without a graphics card."""
    window = chromium(
        "--window-size=900,600", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"
    )
    yield window
    window.quit()
