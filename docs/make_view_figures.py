"""Makes the pictures of guides/view.md and guides/score.md: docs/images/view.jpg and docs/images/side_by_side.jpg.

    python docs/make_view_figures.py NLMV0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01.IMG

The product is the left image of Perseverance's navigation cameras, from the Planetary Data System; the right one lies
beside it. m3depth.rectify makes a rectified pair of the two, m3depth.predict predicts its depth, and headless Chromium
takes a picture of the page that --view opens. m3depth.evaluate draws the methods side by side. It needs Chromium, its
driver and the extra `dev`.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from selenium import webdriver
from selenium.common.exceptions import TimeoutException

import m3depth.predict
from m3depth.evaluate import main as evaluate
from m3depth.rectify import main as rectify
from marssim.base.view.page import Page
from marssim.base.view.scene import Shot

HERE = Path(__file__).parent / "images"
WINDOW = (1280, 800)  # [px] of the browser
OTHER = "normals"  # colours of the second picture of the page; the first has those of the image
LARGEST = 200_000  # [byte] of a picture
SECONDS = 500.0  # that a browser without a graphics card may take


@dataclass(frozen=True)
class Options:
    """Makes the pictures of the viewer and of the methods side by side."""

    image: Annotated[Path, tyro.conf.Positional]
    """The left product (.IMG)."""
    out: Path = HERE
    """Folder of the pictures."""


def run(command: Callable[[Sequence[str]], int], *arguments: object) -> None:
    """Run a command, and end the program if it fails."""
    if command([str(argument) for argument in arguments]):
        raise SystemExit(2)


def photograph(shots: Sequence[Shot], title: str) -> np.ndarray:
    """Return the page with the colours of the image and of OTHER, one above the other, (H, W, 3) uint8 BGR."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for argument in (
        "--headless=new", "--no-sandbox", f"--window-size={WINDOW[0]},{WINDOW[1]}", "--use-gl=angle",
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    ):  # fmt: skip
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        with Page(shots, title, port=0) as page:
            browser.get(page.address)
            settled(browser)
            for button in browser.find_elements("css selector", ".mantine-Notification-closeButton"):
                button.click()  # the browser has no graphics card, and says so
            first = settled(browser)
            browser.find_element("css selector", "input[value=image]").click()
            time.sleep(5)
            choices = browser.find_elements("css selector", "[role=option]")
            next(choice for choice in choices if choice.text == OTHER).click()
            return np.vstack([first, settled(browser)])
    finally:
        browser.quit()


def settled(browser: webdriver.Chrome) -> np.ndarray:
    """Return a picture of the page once it shows the cloud and no longer changes."""
    end, before = time.monotonic() + SECONDS, np.zeros((0, 0, 3))
    while time.monotonic() < end:
        time.sleep(2)
        try:
            data = browser.get_screenshot_as_png()
        except TimeoutException:  # it is still drawing
            continue
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        middle = picture[200:400, 300:700]  # white without the cloud
        if (middle < 250).mean() > 0.5 and np.array_equal(picture, before):
            return picture
        before = picture
    raise SystemExit("the browser does not show the cloud")


def save(picture: np.ndarray, path: Path) -> None:
    """Write a picture as JPEG of at most LARGEST bytes."""
    for quality in range(92, 40, -6):
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        if len(data) <= LARGEST:
            break
    path.write_bytes(data.tobytes())
    print(f"{path.name}: {picture.shape[1]} x {picture.shape[0]}, {len(data) // 1000} kB")


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pair = folder / "sol" / "navcam"
        run(rectify, options.image, "--focal", 560, "--size", 1024, 768, "--out", pair)
        # what --view would show
        m3depth.predict.show = lambda shots, title: save(photograph(shots, title), options.out / "view.jpg")
        small = folder / "small"  # as the browser draws without a graphics card
        run(rectify, options.image, "--focal", 280, "--size", 512, 384, "--out", small)
        run(m3depth.predict.main, small, "--out", folder / "prediction", "--view")
        run(
            evaluate, "--data", folder / "sol", "--left", "*/left.png", "--right", "*/right.png", "--calib",
            pair / "rig.json", "--baselines", "sgbm", "sgbm-hh", "--out", folder / "scores",
        )  # fmt: skip
        save(cv2.imread(str(folder / "scores" / "qualitative.png")), options.out / "side_by_side.jpg")


if __name__ == "__main__":
    main(tyro.cli(Options))
