"""What the page says of steps: the script of its own, in Node, without a browser."""

import json
import shutil
import subprocess

import pytest
from recorded_drives import step

from envs.drives.colours import OUTCOME_COLOURS
from envs.recording.drive_page import asset
from envs.recording.page_colours import COLOURS

ROVER = {"length": 1.6, "width": 1.4, "max_speed": 0.2, "max_yaw_rate": 0.25, "pan_limit": 1.5708}


@pytest.fixture(scope="module")
def in_page():
    """Values of expressions of the script, with some values at hand."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node is not installed")

    def values(expression, **given):
        names = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in given.items())
        data = f"const DATA = {json.dumps({'outcomes': [*OUTCOME_COLOURS]})};\n"
        program = f"{data}{asset('steps.js')}\n{names}console.log(JSON.stringify({expression}))"
        done = subprocess.run([node, "-"], input=program, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return values


@pytest.mark.parametrize(("action", "words"), [
    ([1, 0, 0], "drives"), ([0.4, 0.9, 0], "drives"), ([0.03, 0], "drives"),
    ([-1, 0, 0], "drives backwards"), ([-0.4, 0.9, 0], "drives backwards"),
    ([0, 1, 0], "turns"), ([0.1, -0.8, 0], "turns"), ([-0.1, 0.5, 1], "turns"),
    ([0, 0, 0], "stands"), ([0, 0, 1], "stands"), ([0.01, -0.01, 0], "stands"),
])  # fmt: skip
def test_the_action_of_a_driver_without_a_status_says_what_it_does(in_page, action, words):
    assert in_page("statusOf(now)[1]", now={"status": None, "outcome": "driving", "action": action}) == words


def test_a_status_and_the_end_of_a_drive_come_before_the_action(in_page):
    steps = [step(status="turn", action=[1.0, 0.0, 0.0]), step(outcome="out_of_bounds"), step(status="dances")]
    assert in_page("steps.map((one) => statusOf(one)[1])", steps=steps) == ["turns in place", "out of bounds", "dances"]


def test_all_that_the_rover_does_has_a_colour(in_page):
    steps = [step(outcome=name) for name in ("sinks", *OUTCOME_COLOURS)] + [step(status="dances")]
    names = in_page("steps.map((one) => statusOf(one)[0])", steps=steps)
    assert names == ["other", *OUTCOME_COLOURS, "other"]
    assert set(in_page("Object.keys({...STATUS, ...MOTION})")) | set(names) == set(COLOURS)


@pytest.mark.parametrize(("action", "facts"), [
    ([-0.62, 0.55, -0.6], ["-0.12 m/s", "7.9°/s left", "54° right"]),
    ([0.001, -0.002, 0.0], ["0.00 m/s", "0°/s", "0°"]),
    ([-0.001, -1.0, 1.0], ["0.00 m/s", "14.3°/s right", "90° left"]),
])  # fmt: skip
def test_actions_have_the_units_of_commands(in_page, action, facts):
    shown = in_page("factsOf(now, now, null, rover)", now=step(action=action), rover=ROVER)
    assert shown[:3] == [[name, fact] for name, fact in zip(("speed", "turn", "next pan"), facts)]
    command = {"speed": action[0] * 0.2, "yaw_rate": action[1] * 0.25, "pan": None}
    assert in_page("factsOf(now, now, null, rover)", now=step(command=command), rover=ROVER)[:2] == shown[:2]


def test_actions_of_older_records_are_in_percent(in_page):
    older = {name: ROVER[name] for name in ("length", "width")}
    shown = in_page("actionFacts([-0.62, 0.55, -0.6, 1], rover)", rover=older)
    names = ("speed", "turn", "next pan", "3")
    assert shown == [[f"action: {n}", v] for n, v in zip(names, ("-62 %", "55 %", "-60 %", "100 %"))]
