"""The page, without a browser and in headless Chromium."""

import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.pose import look_pose
from marssim.base.view.clouds import view_of_maps
from marssim.base.view.scene import Line, Shot, Surface

viser = pytest.importorskip("viser", reason="the extra `view` is not installed")
from marssim.base.view.page import Page  # noqa: E402

RIG = StereoRig(PinholeCamera.centred(40, 40, 40.0), 0.1)
RED, BLUE = (200, 30, 30), (30, 30, 200)
POLE = Line("Goal", np.array([[3.0, 0, 0], [3, 0, 1]]), (200, 30, 160))
PATCH = Surface(
    "Map", np.array([[2.0, 0, 0], [3, 0, 0], [3, 1, 0]]), np.array([[0, 1, 2]]), np.full((3, 3), 90, np.uint8)
)
SECONDS = 60.0  # that a browser on a busy machine may take


def shown_boxes(page):
    return {name for name, box in page._boxes.items() if box.visible}


def wall(colour, **parts):
    """A wall 2 m ahead, whose image has one colour."""
    image = np.full((40, 40, 3), colour, np.uint8)
    return replace(view_of_maps(RIG, np.full((40, 40), 2.0, np.float32), image)[0], **parts)


def shots(*views):
    poses = (look_pose(np.array([0.5 * number, 0, 1]), 0.0, 0.2) for number in range(len(views)))
    return [Shot(f"wall {n}", pose, lambda view=view: view) for n, (pose, view) in enumerate(zip(poses, views))]


def wait_until(condition, seconds=SECONDS):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.1)


def test_the_slider_shows_another_shot_with_its_own_choices_and_parts():
    second = wall(BLUE, lines=(POLE,), surfaces=(PATCH,), note="drive")
    second = replace(second, layers={"depth": second.layers["depth"]})
    broken = Shot("wall 2", np.eye(4), lambda: (_ for _ in ()).throw(ValueError("depth.npy: is broken")))
    with Page([*shots(wall(RED), second), broken], "walls", 0) as page:
        assert page.address.startswith("http://127.0.0.1:") and not page.address.endswith(":0")
        assert page._colour.options == ("image", "depth") and page._legend.content == "the left image"
        assert page._boxes.keys() == {"Cloud", "Cameras", "Path"}
        page._slider.value = 2
        wait_until(lambda: "Map" in page._boxes)
        assert page._colour.options == ("depth",) and page._colour.value == "depth"
        assert page._name.content == "**wall 1** 1600 points; drive"
        page._boxes["Map"].value = False
        wait_until(lambda: not page._drawing.group("Map").visible)
        page._slider.value = 3
        wait_until(lambda: page._name.content == r"**wall 2** cannot be shown: depth\.npy\: is broken")
        page._slider.value = 2
        wait_until(lambda: page._name.content == "**wall 1** 1600 points; drive")
        page._slider.value = 3
        wait_until(lambda: "cannot be shown" in page._name.content)


def test_a_shot_without_points_has_no_choice_of_colours():
    view = replace(wall(RED), points=np.zeros((0, 3), np.float32), layers={}, lines=(POLE,), note="goal", reach=9.0)
    with Page(shots(view, wall(RED)), "course", 0) as page:
        assert not page._colour.visible and not page._size.visible and page._name.content == "**wall 0** goal"
        assert page._boxes.keys() == {"Cameras", "Path", "Goal"}
        page._slider.value = 2
        wait_until(lambda: page._colour.visible and page._colour.value == "image")
        wait_until(lambda: shown_boxes(page) == {"Cloud", "Cameras", "Path"})


def test_boxes_are_those_of_the_present_shot_and_remember_what_was_hidden():
    with_map, other = wall(RED, surfaces=(PATCH,)), wall(BLUE, lines=(POLE,))
    alone = [Shot("alone", np.eye(4), lambda: other, "another world")]
    with Page([*shots(with_map, with_map), *alone], "walls", 0) as page:
        assert shown_boxes(page) == {"Cloud", "Cameras", "Path", "Map"}
        page._boxes["Map"].value = False
        page._slider.value = 3
        wait_until(lambda: shown_boxes(page) == {"Cloud", "Cameras", "Goal"})
        page._slider.value = 1
        wait_until(lambda: shown_boxes(page) == {"Cloud", "Cameras", "Path", "Map"})
        assert not page._boxes["Map"].value and not page._drawing.group("Map").visible


def test_words_of_a_shot_are_no_markup(browser_3d):
    """viser renders HTML in Markdown, scripts too, and reads the files that images name."""
    words = "<img src=x onerror=alert(1)> ![x](/etc/hostname) pkg.__main__:Net"
    view = replace(wall(RED), note=words)
    with Page([Shot(words, np.eye(4), lambda: view)], "wall", 0) as page:
        browser_3d.get(page.address)
        text = "return document.body.innerText"
        wait_until(lambda: browser_3d.execute_script(text).count(words) == 2)
        assert not browser_3d.find_elements("css selector", "img[src=x], img[alt=x]")


def test_the_first_points_set_the_size_of_points_and_then_the_user():
    course = replace(wall(RED), points=np.zeros((0, 3), np.float32), layers={}, reach=9.0)
    with Page(shots(course, wall(RED), course, wall(BLUE)), "course", 0) as page:
        assert page._drawing._cloud is None and not page._size.visible  # Chromium warns of a cloud without points
        page._slider.value = 2
        wait_until(lambda: page._size.visible)
        assert page._size.value == 50.0 and page._drawing._cloud.point_size == 0.05  # 40 px of 40 px at 2 m
        page._size.value = 20.0
        wait_until(lambda: page._drawing._cloud.point_size == 0.02)
        page._slider.value = 3
        wait_until(lambda: page._drawing._cloud is None)
        page._slider.value = 4
        wait_until(lambda: page._size.visible)
        assert page._size.value == 20.0 and page._drawing._cloud.point_size == 0.02


def test_a_browser_draws_the_cloud_and_another_choice_of_colours_changes_it(browser_3d):
    def pixels_like(colour):
        picture = cv2.imdecode(np.frombuffer(browser_3d.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        return int((np.abs(picture.astype(int) - colour).max(axis=2) < 40).sum())

    view = wall(RED, image=None)  # without the picture in the frustum
    of_depth = view.layers["depth"].colours[0]
    with Page(shots(view), "wall", 0) as page:
        browser_3d.get(page.address)
        wait_until(lambda: pixels_like(RED) > 2000)
        assert pixels_like(of_depth) < 200
        browser_3d.find_element("css selector", "input[value=image]").click()
        wait_until(lambda: [o for o in browser_3d.find_elements("css selector", "[role=option]") if o.text == "depth"])
        (option,) = [o for o in browser_3d.find_elements("css selector", "[role=option]") if o.text == "depth"]
        option.click()
        wait_until(lambda: pixels_like(of_depth) > 2000)
        assert pixels_like(RED) < 200
