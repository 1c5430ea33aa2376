"""Makes the pictures of pages in docs/guides/inspect-a-drive.md, in a headless Chromium.

    python -m envs.evaluate --suite marsnav-v1 --split dev --episodes 1 --condition compressed \
        --perception ground_truth sgbm --record all --no-videos --out out/page
    python docs/make_page_image.py out/page/drives/*sgbm*.html drive_page.jpg
    python -m envs.report out/page/drives/*sgbm*.zip out/page/drives/*ground_truth*.zip --out pair.html
    python docs/make_page_image.py pair.html drive_pair.jpg
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from time import sleep

import cv2
import numpy as np
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

IMAGES = Path(__file__).parent / "images"
WINDOW = "1500,1420"  # [px]
WIDTH, QUALITY = 1200, 80  # [px] width of the picture, and its quality as JPEG
LARGEST = 200_000  # [byte]


def main(page: Path, picture: Path) -> None:
    """Open a page at the moment that decided, and save what it shows as a JPEG."""
    options = webdriver.ChromeOptions()
    for flag in ("--headless=new", "--no-sandbox", "--hide-scrollbars", f"--window-size={WINDOW}"):
        options.add_argument(flag)
    options.binary_location = shutil.which("chromium") or ""
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        browser.get(page.resolve().as_uri())
        browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ENTER)
        sleep(1)  # pictures are decoded first
        shot = cv2.imdecode(np.frombuffer(browser.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)
    finally:
        browser.quit()
    small = cv2.resize(shot, (WIDTH, round(shot.shape[0] * WIDTH / shot.shape[1])), interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].tobytes()
    if len(data) > LARGEST:
        raise SystemExit(f"{picture} would take {len(data)} bytes, more than {LARGEST}")
    picture.write_bytes(data)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]), IMAGES / sys.argv[2])
