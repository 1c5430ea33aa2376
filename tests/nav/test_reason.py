import numpy as np
import pytest
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.rover_spec import ZHURONG
from nav import ElevationConfig, Navigator, NavigatorConfig
from nav.command import Command
from nav.path.planner import Motion
from nav.reason import reason_of

SMALL = NavigatorConfig(elevation=ElevationConfig(size=24.0, recentre_at=8.0))


@pytest.mark.parametrize(("goal", "status", "words"), [
    ((9.0, 0.0), "drive", "straight on, 0."),
    ((0.2, 0.0), "arrived", "the goal is within 0.5 m by odometry"),
    ((-6.0, 2.0), "look", "looks first where it wants to turn: a turn in place of "),
])  # fmt: skip
def test_the_reason_names_the_motion_and_what_the_next_one_would_cost(goal, status, words):
    navigator, pose = Navigator(config=SMALL), body_pose(0.0, 0.0, 0.0)
    depth = RockWorld().depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    command = navigator.step(depth, None, SMALL_RIG, pose, np.array(goal))
    reason = reason_of(navigator, command)
    assert command.status == status and reason.startswith(words)


def test_without_ground_in_view_the_navigator_is_blind():
    navigator = Navigator(config=SMALL)
    sky = np.full((192, 192), np.inf, np.float32)
    command = navigator.step(sky, None, SMALL_RIG, body_pose(0, 0, 0), np.array([9.0, 0.0]))
    assert reason_of(navigator, command) == "the image showed no ground"
    assert navigator.motion is None and navigator.planner.considered is None


def test_a_look_between_two_looks_is_along_the_path(monkeypatch):
    navigator, goal = Navigator(config=SMALL), np.array([9.0, 0.0])
    here, farther = body_pose(0.0, 0.0, 0.0), body_pose(1.2, 0.0, 0.0)
    depth = RockWorld().depth(SMALL_RIG, here @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    navigator.step(depth, None, SMALL_RIG, here, goal)
    monkeypatch.setattr(navigator.planner, "plan", lambda *_: Motion(0.0, 0.4, 4.0, 0.0, np.zeros((2, 3))))
    command = navigator.step(None, None, SMALL_RIG, farther, goal, between_looks=True)
    assert command.status == "look"
    expected = "the map shows no long free path, so the mast looks along the planned one first"
    assert reason_of(navigator, command) == expected
    navigator.step(depth, None, SMALL_RIG, farther, goal)
    assert not navigator.looks_along


@pytest.mark.parametrize(("status", "speed", "words"), [
    ("recover", -0.15, "backs out along its track, 1.2 m left, recovery 1 of at most 6, at risk level 1"),
    ("recover", 0.0, "turns in place to look for another path, recovery 1 of at most 6, at risk level 1"),
    ("look", 0.0, "no motion, no way back and no turn is free, at risk level 1"),
    ("stuck", 0.0, "1 recoveries brought the rover no nearer to the goal"),
    ("no_path", 0.0, "no motion is free after 1 recoveries, and known obstacles close every path"),
])  # fmt: skip
def test_a_recovery_and_its_failure_are_explained(status, speed, words):
    navigator = Navigator(config=SMALL)
    navigator.recovery.start(np.zeros(3))
    navigator.risk.raise_level()
    assert reason_of(navigator, Command(speed, 0.0, None, status)).startswith(words)


def test_giving_up_says_for_how_long_every_way_was_closed():
    navigator = Navigator(config=SMALL)
    for _ in range(30):
        navigator.risk.update(closed=True, hemmed_in=False)
    reason = reason_of(navigator, Command(0.0, 0.0, None, "no_path"))
    assert navigator.risk.given_up and reason.startswith(
        "known obstacles have closed every path to the goal for 15 steps"
    )
