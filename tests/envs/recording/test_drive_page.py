import json
import os
import re
import time
import zlib
from base64 import b64decode
from dataclasses import replace

import cv2
import numpy as np
import pytest
from recorded_drives import candidates, content, drive_of, pose_rows, step

from envs.recording.code_colours import UNKNOWN, code_colours
from envs.recording.drive_page import FAR, NEAR, _depth_bytes, asset, drive_page, page_script, write_drive_pages
from envs.report import main as report_command
from marssim.base.dataset.drive_file import MAP_CODES, depth_codes, encode_drive, picture_name, read_drive
from marssim.base.files.json_file import DatasetError
from marssim.base.files.png import encode_png


def data_of(page):
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page.decode(), re.DOTALL)
    return json.loads(data)


def codes_of(picture):
    """The codes of a picture of a page, as pictures.js reads them; None if there is none."""
    if picture is None:
        return None
    codes = np.frombuffer(zlib.decompress(b64decode(picture["deflated"])), np.uint8)
    return np.cumsum(codes.reshape(picture["height"], picture["width"]), axis=0, dtype=np.uint8)


def test_a_page_holds_the_drive_its_pictures_and_how_it_ended(crash):
    drive, record = crash
    page = drive_page([drive])
    (shown,) = data_of(page)["drives"]
    assert shown["outcome"] == "collision" and shown["steps"] == drive.steps
    assert shown["summary"].startswith(f"It hit an obstacle after {record.path_length:.1f} m and ")
    assert shown["decided"]["step"] < len(drive.steps) - 1
    assert all(uri.startswith("data:image/jpeg;base64,") for uri in shown["pictures"]["left"])
    for layer in ("map", "error", "confidence"):
        for n, picture in enumerate(shown["pictures"][layer]):
            np.testing.assert_array_equal(codes_of(picture), drive.codes(layer, n))
    assert "height" not in shown["pictures"] and len(page) < 3e6


def test_a_page_says_why_a_drive_of_the_navigator_failed(blind_crash):
    (shown,) = data_of(drive_page([blind_crash[0]]))["drives"]
    assert ": it hit, or tilted on, an obstacle that its map lacks and that of true depth shows. " in shown["summary"]


def test_a_page_asks_for_nothing_outside_itself(crash):
    text = drive_page([crash[0]]).decode()
    assert "default-src 'none'; img-src data:" in text
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:)|url\(|@import|https?://""", text)


@pytest.mark.parametrize("words", ["</script><script>alert(1)</script>", "<img src=x onerror=alert(1)>", "%%script%%"])
def test_words_of_a_record_are_no_markup(tmp_path, words):
    drive = drive_of(tmp_path / "a.zip", [step(reason=words), step(outcome=words)], outcome=words)
    drive.content["episode"]["driver"] = words
    page = drive_page([drive])
    plain = drive_page([drive_of(tmp_path / "b.zip", [step(), step()])])
    assert page.lower().count(b"<script") == plain.lower().count(b"<script") and b"<img" not in page
    assert data_of(page)["drives"][0]["driver"] == words


@pytest.mark.parametrize("outcome", ["collision", "elsewhere"])
def test_any_changed_value_of_a_record_is_shown_or_refused_in_one_line(tmp_path, outcome):
    """Each number and word of drive.json in turn becomes something else."""
    motions = candidates((0.2, 0, 4, 9), (0.5, 0.1, 0.2, None))
    text = json.dumps(content([step(candidates=motions, chosen=0), step(x=9.0)], outcome=outcome))
    places = list(re.finditer(r'(?<=[ \[])(-?\d+\.?\d*|"[^"]*"|true|false|null)(?=[,}\]])', text))
    assert len(places) > 100
    refused = 0
    for n, place in enumerate(places):
        value = ("null", "1e299", "-1", '"x"', "[]", "0")[n % 6]
        changed = json.loads(text[: place.start()] + value + text[place.end() :])
        (tmp_path / "a.zip").write_bytes(encode_drive(changed, {}))
        try:
            drive_page([read_drive(tmp_path / "a.zip")])
        except DatasetError as error:
            assert str(error).startswith(str(tmp_path / "a.zip")) and "\n" not in str(error)
            refused += 1
    assert 0 < refused < len(places)


def test_data_cannot_end_its_element():
    assert page_script({"a": "</script>", "b": float("inf")}) == '{"a": "\\u003c/script>", "b": null}'


def test_pages_are_written_once_and_again_where_the_drive_is_newer(tmp_path, monkeypatch):
    (tmp_path / "drives").mkdir()
    path = tmp_path / "drives" / "a.zip"
    drive_of(path, [step(), step(x=9.0)])
    ((page,), _) = write_drive_pages(tmp_path / "drives")
    assert page == path.with_suffix(".html") and b"It reached the goal" in page.read_bytes()
    page.write_text("kept")
    write_drive_pages(tmp_path / "drives")
    assert page.read_text() == "kept"
    os.utime(path, (time.time() + 5, time.time() + 5))
    write_drive_pages(tmp_path / "drives")
    assert b"It reached the goal" in page.read_bytes()


def test_a_broken_drive_costs_only_its_own_page(tmp_path, capsys):
    (tmp_path / "drives").mkdir()
    first, second = (tmp_path / "drives" / f"{name}.zip" for name in "ab")
    for path in (first, second):
        drive_of(path, [step(), step(x=9.0)])
    write_drive_pages(tmp_path / "drives")
    first.write_bytes(b"half a drive")
    os.utime(first, (time.time() + 9, time.time() + 9))
    pages, (broken,) = write_drive_pages(tmp_path / "drives")
    assert pages == [second.with_suffix(".html")] and not first.with_suffix(".html").exists()
    assert re.search(r"a\.zip: is not .*; delete the file, and envs.evaluate --record all records the drive ag", broken)
    second.with_suffix(".html").unlink()
    assert report_command([str(tmp_path)]) == 2
    assert second.with_suffix(".html").is_file() and not first.with_suffix(".html").exists()
    assert capsys.readouterr().err.endswith(" records the drive again (1 broken drive; 1 page written)\n")


def test_a_page_that_still_shows_its_drive_outlives_it(tmp_path):
    """results.html leads to it."""
    drive = tmp_path / "drives/a.zip"
    drive.parent.mkdir()
    drive_of(drive, [step(), step(x=9.0)])
    write_drive_pages(drive.parent)
    drive.write_bytes(b"half a drive")
    os.utime(drive, (time.time() - 9, time.time() - 9))
    pages, broken = write_drive_pages(drive.parent, again=True)
    assert pages == [] and len(broken) == 1 and drive.with_suffix(".html").is_file()


def test_half_a_pair_of_utf16_stops_no_page(tmp_path):
    drive = drive_of(tmp_path / "a.zip", [step(), step(x=9.0)])
    drive.content["episode"]["driver"] = "nav\ud800"
    assert rb"<title>nav\ud800, " in drive_page([drive])


@pytest.fixture(scope="module")
def browser(chromium):
    window = chromium("--disable-gpu", "--window-size=1400,1000")
    yield window
    window.quit()


def requests_of(browser):
    """Addresses that the page asked for, but those within it."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    return [url for url in sent if not url.startswith("data:")]


def test_the_page_opens_from_the_disk_and_its_time_line_moves_through_the_drive(browser, arrival, crash, tmp_path):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    drive, record = arrival
    page = tmp_path / "drive.html"
    page.write_bytes(drive_page([drive]))
    browser.get(page.as_uri())
    body, now = browser.find_element(By.TAG_NAME, "body"), browser.find_element(By.ID, "now")

    def shown():
        time.sleep(0.15)  # pictures are decoded first
        eye = browser.find_element(By.CSS_SELECTOR, "img").get_attribute("src")
        canvases = "return [...document.querySelectorAll('canvas')].map(c => c.toDataURL())"
        return [now.text, eye, *browser.execute_script(canvases)]

    first = shown()
    assert first[0] == "step 0, 0 s, 0.0 m driven"
    assert "chosen" in browser.find_element(By.CSS_SELECTOR, "tr.chosen").text
    for _ in range(5):
        body.send_keys(Keys.ARROW_RIGHT)
    later = shown()
    assert later[0].startswith("step 5, 10 s, ")
    different = [a != b for a, b in zip(first, later)]
    assert different[0] and different[1] and sum(different[2:]) >= 3  # strip, depth and map at least
    body.send_keys(Keys.END, Keys.ENTER)
    assert now.text == first[0]  # from there on, each step brought the rover nearer to the goal
    position, play = browser.find_element(By.ID, "position"), browser.find_element(By.ID, "play")
    position.send_keys(Keys.END, "d", "D", Keys.ENTER)  # letters do nothing: speech input would trigger them
    assert now.text == first[0]
    position.send_keys(Keys.ARROW_RIGHT)
    play.send_keys(Keys.ENTER)
    assert play.text == "pause" and now.text != first[0]  # it presses the button
    play.send_keys(Keys.ENTER)
    position.send_keys(" ")  # where it has the focus, after a drag
    assert play.text == "pause"
    position.send_keys(" ")
    assert play.text == "play"
    body.send_keys(Keys.END)
    assert shown()[0].startswith(f"step {record.steps}, ")
    assert "the drive ended here" in browser.find_element(By.CSS_SELECTOR, ".reason").text
    browser.execute_script(
        "const p = document.getElementById('position'); p.value = 2; p.dispatchEvent(new Event('input'))"
    )
    assert shown()[0].startswith("step 2, ")

    pair = tmp_path / "pair.html"
    pair.write_bytes(drive_page([drive, crash[0]]))
    browser.get(pair.as_uri())
    heads = [h.text for h in browser.find_elements(By.CSS_SELECTOR, "article .panel h2") if h.text.startswith("step")]
    assert heads == ["step 0, 0 s, 0.0 m driven"] * 2
    browser.execute_script("document.querySelector('input[value=way]').click(); goTo(1.2)")
    ways = [moment.text for moment in browser.find_elements(By.CSS_SELECTOR, "article .panel h2")
            if moment.text.startswith("step")]  # fmt: skip
    assert all(abs(float(re.search(r"s, ([\d.]+) m", way)[1]) - 1.2) <= 0.41 for way in ways) and len(ways) == 2

    assert requests_of(browser) == [page.as_uri(), pair.as_uri()]
    assert browser.get_log("browser") == []


def test_by_the_way_driven_each_step_of_a_rover_that_stands_can_be_shown(browser, tmp_path):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    turning = [step(x=x, yaw=yaw) for x, yaw in ((0, 0), (1, 0), (1, 0.5), (1, 1.0), (2, 1.0))]
    drives = [drive_of(tmp_path / f"{len(s)}.zip", s, outcome="time") for s in (turning, turning[::4])]
    page = tmp_path / "pair.html"
    page.write_bytes(drive_page(drives))
    browser.get(page.as_uri())
    browser.execute_script("columns[0].drive.decided.step = 2; document.querySelector('input[value=way]').click()")
    body = browser.find_element(By.TAG_NAME, "body")

    def shown():
        return browser.execute_script("return columns.map((column) => stepAt(column.drive, stops[index]))")

    walked = [shown()]
    for _ in range(4):
        body.send_keys(Keys.ARROW_RIGHT)
        walked.append(shown())
    assert walked == [[0, 0], [1, 0], [2, 0], [3, 0], [4, 1]]
    body.send_keys(Keys.ENTER)
    assert shown() == [2, 0]
    browser.execute_script("document.querySelector('input[value=time]').click()")
    assert shown() == [2, 1]
    browser.execute_script("document.querySelector('input[value=way]').click()")
    assert shown() == [2, 0]
    assert browser.get_log("browser") == []


def test_a_page_is_used_with_the_keyboard_alone_and_in_a_narrow_window(browser, tmp_path):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    drive = drive_of(tmp_path / "a.zip", [step(), step(x=4.0), step(x=9.0)])
    for name, drives in (("one", [drive]), ("pair", [drive, drive])):
        (tmp_path / f"{name}.html").write_bytes(drive_page(drives))
    browser.get((tmp_path / "pair.html").as_uri())
    browser.find_element(By.CSS_SELECTOR, "input[value=time]").send_keys(Keys.ARROW_RIGHT)
    assert browser.execute_script("return [by, index]") == ["way", 0]
    size = browser.get_window_size()
    browser.set_window_size(700, 800)
    left, right = browser.find_elements(By.TAG_NAME, "article")
    assert left.rect["x"] == right.rect["x"] and right.rect["y"] >= left.rect["y"] + left.rect["height"]
    browser.set_window_size(size["width"], size["height"])
    browser.get((tmp_path / "one.html").as_uri())
    focused = []
    for _ in range(8):
        ActionChains(browser).send_keys(Keys.TAB).perform()
        focused.append(browser.execute_script("return document.activeElement.id"))
    assert {"back", "play", "on", "position", "other"} <= set(focused)


def test_the_motions_of_the_table_are_shown_on_the_map_by_keyboard_too(browser, tmp_path):
    motions = candidates((0.2, 0, 4, 9), (0.5, 0.1, 3, 10))
    drive = drive_of(tmp_path / "a.zip", [step(candidates=motions, chosen=0), step(x=9.0)])
    (tmp_path / "a.html").write_bytes(drive_page([drive]))
    browser.get((tmp_path / "a.html").as_uri())
    browser.execute_script("columns[0].map.emphasise(null)")  # so that all that the map needs is decoded
    picture = "const c = document.querySelector('.map canvas'); return c.toDataURL()"
    time.sleep(0.2)
    before = browser.execute_script(picture)
    browser.execute_script("document.querySelectorAll('tr.row')[1].focus()")
    time.sleep(0.2)
    assert browser.execute_script("return document.activeElement.className") == "row"
    assert browser.execute_script(picture) != before
    position = "return document.getElementById('position').getAttribute('aria-valuetext')"
    assert browser.execute_script(position) == "step 0, 0 s, 0.0 m driven: drives"
    unnamed = "return [...document.querySelectorAll('figure canvas, .map canvas')].filter(c => !c.ariaLabel).length"
    assert browser.execute_script(unnamed) == 0


def two_depths(tmp_path):
    """The page of a drive whose first look sees 2 m, and its second one 20 m, on the left half of the picture."""
    pictures = {}
    for n, depth in enumerate((2.0, 20.0)):
        halves = np.where(np.arange(8) < 4, depth, np.nan) * np.ones((8, 1))
        pictures[picture_name("depth", n)] = encode_png(depth_codes(halves))
    motions = candidates((0.2, 0, 4, 9), (0.5, 0.1, 3, 10))
    steps = [step(x=4.0 * n, looked=True, candidates=motions, chosen=n) for n in (0, 1)] + [step(x=8.0)]
    page = tmp_path / "depths.html"
    page.write_bytes(drive_page([drive_of(tmp_path / "depths.zip", steps, pictures, outcome="time")]))
    return page


def test_the_value_that_is_read_is_that_of_the_step_shown(browser, tmp_path):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    browser.get(two_depths(tmp_path).as_uri())
    canvas = browser.find_element(By.CSS_SELECTOR, "canvas[data-layer=depth]")
    reading = browser.find_element(By.CSS_SELECTOR, "figcaption .reading")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    ActionChains(browser).move_to_element_with_offset(canvas, -canvas.size["width"] // 4, 0).click().perform()
    time.sleep(0.2)
    read = [reading.text]
    ActionChains(browser).send_keys(Keys.ARROW_RIGHT).perform()  # a click on the picture leaves them to the time line
    time.sleep(0.2)
    assert browser.execute_script("return index") == 1
    read.append(reading.text)
    browser.execute_script("columns[0].drive.pictures.depth[1] = null; moveTo(1)")
    assert [*read, reading.text] == ["2.0 m", "20.0 m", ""]


def test_values_are_read_by_keyboard_too(browser, tmp_path):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    browser.get(two_depths(tmp_path).as_uri())
    canvas = browser.find_element(By.CSS_SELECTOR, "canvas[data-layer=depth]")
    reading = browser.find_element(By.CSS_SELECTOR, "figcaption .reading")
    cross = browser.find_element(By.CSS_SELECTOR, ".cross")
    assert not cross.is_displayed()
    canvas.send_keys(Keys.ARROW_LEFT)
    assert reading.text == "2.0 m" and cross.is_displayed()
    canvas.send_keys(*[Keys.ARROW_RIGHT] * 3, Keys.ARROW_UP)
    assert reading.text == "unknown" and browser.execute_script("return index") == 0
    ActionChains(browser).move_to_element_with_offset(canvas, -canvas.size["width"] // 4, 0).perform()
    assert reading.text == "2.0 m"
    ActionChains(browser).move_to_element(browser.find_element(By.ID, "now")).perform()
    assert reading.text == "unknown" and reading.get_attribute("aria-live") == "polite"  # the point of the keys stays
    browser.execute_script("document.activeElement.blur()")
    assert reading.text == "" and not cross.is_displayed()


def test_the_row_in_focus_stays_so_at_the_next_step(browser, tmp_path):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.keys import Keys

    browser.get(two_depths(tmp_path).as_uri())
    browser.execute_script("document.querySelectorAll('tr.row')[1].focus()")
    focused = "return [...document.querySelectorAll('tr.row')].indexOf(document.activeElement)"
    for key, index, row in ((Keys.ARROW_RIGHT, 1, 1), (Keys.ARROW_RIGHT, 2, -1), (Keys.ARROW_LEFT, 1, 1)):
        ActionChains(browser).send_keys(key).perform()  # no motions are compared at the last step
        assert browser.execute_script("return index") == index and browser.execute_script(focused) == row
    browser.execute_script("document.activeElement.blur()")
    ActionChains(browser).send_keys(Keys.ARROW_LEFT).perform()
    assert browser.execute_script("return index") == 0 and browser.execute_script(focused) == -1


def test_a_browser_that_falsifies_pixels_shows_the_codes_of_the_record(browser, tmp_path):
    """Firefox and Brave do so to hinder fingerprinting: free ground and unseen ground are neighbouring codes."""
    page = two_depths(tmp_path)
    lie = "for (const c of [CanvasRenderingContext2D]) c.prototype.getImageData = () => { throw new Error('read'); };"
    page.write_text(page.read_text(encoding="utf-8").replace('"use strict";', f'"use strict"; {lie}', 1), "utf-8")
    browser.get(page.as_uri())
    read = "codesOf(columns[0].drive.pictures.depth[1]).then((p) => arguments[0]([p.width, p.height, ...p.codes]))"
    width, height, *codes = browser.execute_async_script(read)
    far = round(1 + 253 * np.log(20 / NEAR) / np.log(FAR / NEAR))
    assert (width, height) == (8, 8) and codes == [*[far] * 4, *[0] * 4] * 8
    assert browser.get_log("browser") == []


def test_a_printed_page_keeps_the_colours_of_its_legends():
    (rule,) = (line for line in asset("page.css").splitlines() if "print-color-adjust: exact" in line)
    assert {".legend i", ".scale", ".chip", ".badge"} <= set(rule.partition("{")[0].strip().split(", "))


def test_a_reload_keeps_no_choice_that_the_page_does_not_show():
    """Firefox restores the states of controls, of which the script reads none at the start."""
    radios = re.findall("<input [^>]*radio[^>]*>", asset("drive.html"))
    assert len(radios) == 2 and all('autocomplete="off"' in radio for radio in radios)


def test_the_time_line_scrolls_away_in_a_low_window(browser, tmp_path):
    drive = drive_of(tmp_path / "a.zip", [step(), step(x=9.0)])
    (tmp_path / "a.html").write_bytes(drive_page([drive]))
    size = browser.get_window_size()
    tops = []
    for height in (1000, 400):
        browser.set_window_size(900, height)
        browser.get((tmp_path / "a.html").as_uri())
        browser.execute_script("window.scrollTo(0, 300)")
        tops.append(browser.execute_script("return document.getElementById('scrubber').getBoundingClientRect().top"))
    browser.set_window_size(size["width"], size["height"])
    assert tops[0] == 0 and tops[1] < -100


def test_a_page_that_was_refused_can_be_chosen_again_once_it_is_mended(browser, tmp_path):
    from selenium.webdriver.common.by import By

    drive = drive_of(tmp_path / "a.zip", [step(), step(x=9.0)])
    page, other = tmp_path / "a.html", tmp_path / "b.html"
    page.write_bytes(drive_page([drive]))
    other.write_text("no page")
    browser.get(page.as_uri())
    browser.find_element(By.ID, "other").send_keys(str(other))
    time.sleep(0.5)
    browser.switch_to.alert.accept()
    other.write_bytes(drive_page([drive]))
    browser.find_element(By.ID, "other").send_keys(str(other))
    time.sleep(0.5)
    assert len(browser.find_elements(By.TAG_NAME, "article")) == 2
    browser.execute_script("document.getElementById('other').dispatchEvent(new Event('change'))")  # it was cancelled
    time.sleep(0.2)
    assert browser.get_log("browser") == []


def test_a_page_of_another_version_is_refused(browser, tmp_path):
    from selenium.webdriver.common.by import By

    page = two_depths(tmp_path)
    old = tmp_path / "old.html"
    old.write_text(page.read_text(encoding="utf-8").replace('"format": 2', '"format": 1', 1), "utf-8")
    assert old.read_bytes() != page.read_bytes()
    browser.get(page.as_uri())
    browser.find_element(By.ID, "other").send_keys(str(old))
    time.sleep(0.5)
    alert = browser.switch_to.alert
    assert "of another version. Run envs.report" in alert.text
    alert.accept()
    assert len(browser.find_elements(By.TAG_NAME, "article")) == 1


def test_the_map_shows_where_the_odometry_takes_the_goal_to_be(browser, tmp_path):
    from selenium.webdriver.common.by import By

    legends = []
    for error in (0.0, 1.0):
        drive = drive_of(tmp_path / "a.zip", [step(), step(x=8.0, believed_pose=pose_rows(8.0 + error, 0, 0))])
        (tmp_path / "a.html").write_bytes(drive_page([drive]))
        browser.get((tmp_path / "a.html").as_uri())
        legends.append(browser.find_element(By.CSS_SELECTOR, ".map .legend").text)
    assert "goal by odometry" not in legends[0] and "goal by odometry" in legends[1]
    assert browser.find_element(By.ID, "statuses").text == "drives"


def test_the_legend_of_the_map_names_what_the_record_holds(browser, crash, blind_crash, tmp_path):
    from selenium.webdriver.common.by import By

    planned = {"free", "not seen", "chosen motion, planned path (dashed), rover", "least cost", "not free"}
    for name, (drive, _) in (("straight", crash), ("navigator", blind_crash)):
        (tmp_path / f"{name}.html").write_bytes(drive_page([drive]))
        browser.get((tmp_path / f"{name}.html").as_uri())
        words = {entry.text for entry in browser.find_elements(By.CSS_SELECTOR, ".map .legend span")}
        title = browser.find_element(By.CSS_SELECTOR, ".map h2").text
        if name == "navigator":
            assert planned < words and title == "map of the navigator, north up"
        else:
            assert not planned & words and {"rover", "driven", "rocks (rings)"} < words and title == "map, north up"
            facts = browser.find_element(By.CSS_SELECTOR, ".facts").text
            assert "%" not in facts.partition("mast")[0] and "m/s" in facts


def test_the_end_of_a_drive_shows_the_last_map_with_a_note(browser, tmp_path):
    from selenium.webdriver.common.by import By

    place = {"west": -8.0, "south": -8.0, "cell": 1.0, "cells": 16}
    ground = np.full((16, 16), MAP_CODES["free"], np.uint8)
    ground[:, :8] = MAP_CODES["blocked"]  # west of the start
    steps = [step(), step(map=place), step(x=1.0, outcome="collision")]
    drive = drive_of(tmp_path / "a.zip", steps, {picture_name("map", 1): encode_png(ground)}, outcome="collision")
    (tmp_path / "a.html").write_bytes(drive_page([drive]))
    browser.get((tmp_path / "a.html").as_uri())
    notes, colours = [], []
    for n in range(3):
        browser.execute_script(f"moveTo({n})")
        time.sleep(0.3)
        notes.append(browser.find_element(By.CSS_SELECTOR, ".map .tools span").text)
        uri = browser.execute_script("return document.querySelector('.map canvas').toDataURL()")
        picture = cv2.imdecode(np.frombuffer(b64decode(uri.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR_RGB)
        colours.append([picture[40, round(share * len(picture))].tolist() for share in (0.4, 0.6)])  # 1.8 m aside
    assert notes == ["no map yet", "", "No map at this step: it is that of step 1."]
    blocked, free = (code_colours()["map"][MAP_CODES[name]].tolist() for name in ("blocked", "free"))
    assert colours == [[list(UNKNOWN)] * 2, [blocked, free], [blocked, free]]
    assert browser.get_log("browser") == []


def test_a_chosen_motion_without_a_cost_stops_no_page(browser, tmp_path):
    """read_drive refuses such a file, but the page of a drive may come from elsewhere too."""
    from selenium.webdriver.common.by import By

    motions = candidates((0.2, 0, 4, 9), (0.5, 0.1, 0.2, None))
    drive = drive_of(tmp_path / "a.zip", [step(candidates=motions, chosen=0), step(x=9.0)])
    steps = [{**drive.steps[0], "chosen": 1}, drive.steps[1]]
    page = tmp_path / "a.html"
    page.write_bytes(drive_page([replace(drive, content={**drive.content, "steps": steps})]))
    browser.get(page.as_uri())
    assert browser.find_element(By.ID, "now").text == "step 0, 0 s, 0.0 m driven"
    assert browser.find_element(By.CSS_SELECTOR, "tr.chosen").text.split()[-2:] == ["-", "chosen"]
    assert "+" not in browser.find_element(By.CSS_SELECTOR, "tbody").text
    assert browser.get_log("browser") == []


def test_a_banner_tells_drives_of_different_courses(browser, tmp_path):
    from selenium.webdriver.common.by import By

    plain = drive_of(tmp_path / "a.zip", [step(), step(x=9.0)])
    changes = ({}, {"goal": [9.0, 0.5]}, {"obstacles": []}, {"shortest_path": []}, {"shortest_path": [[0, 1], [9, 0]]})
    shown = []
    for change in (*changes, {"shortest_path": [[0, 0], [4, 3], [9, 0]]}):
        other = replace(plain, content={**plain.content, "episode": {**plain.content["episode"], **change}})
        for name, drives in (("one", [other]), ("pair", [plain, other])):
            (tmp_path / f"{name}.html").write_bytes(drive_page(drives))
            browser.get((tmp_path / f"{name}.html").as_uri())
            shown.append(browser.find_element(By.ID, "apart").is_displayed())
    assert shown == [False, False, *[False, True] * 5]

    (tmp_path / "plain.html").write_bytes(drive_page([plain]))
    browser.get((tmp_path / "plain.html").as_uri())
    for name, banner in (("plain", False), ("one", True)):
        browser.find_element(By.ID, "other").send_keys(str(tmp_path / f"{name}.html"))
        time.sleep(0.5)
        assert browser.find_element(By.ID, "apart").is_displayed() == banner
    assert browser.get_log("browser") == []


def test_a_drive_without_map_and_looks_has_a_page_too(tmp_path):
    steps = [step(candidates=candidates((0, 0, 0.2, None)), status="look"), step(x=0.1, outcome="time")]
    (shown,) = data_of(drive_page([drive_of(tmp_path / "a.zip", steps, outcome="time")]))["drives"]
    assert shown["summary"].startswith("It ran out of time after 0.1 m and 2 s, 8.9 m from the goal.")
    assert shown["pictures"]["left"] == shown["pictures"]["map"] == [None, None]


def test_depth_beyond_the_scale_is_not_its_far_end():
    depth = np.array([[np.nan, NEAR / 2, NEAR, 0.999 * FAR, FAR, np.inf]])
    assert _depth_bytes(depth).tolist() == [[0, 1, 1, 254, 255, 255]]


@pytest.mark.parametrize(("outcome", "contact", "is_reported"), [("tilt", "chassis", True), ("tilt", "none", False)])
def test_a_contact_is_reported_however_the_drive_ended(tmp_path, outcome, contact, is_reported):
    drive = drive_of(tmp_path / "a.zip", [step(), step(x=1.0, contact=contact, outcome=outcome)], outcome=outcome)
    (shown,) = data_of(drive_page([drive]))["drives"]
    assert ("The rover touched it with" in shown["summary"]) == is_reported
