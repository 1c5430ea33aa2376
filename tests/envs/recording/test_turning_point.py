import numpy as np
import pytest
from recorded_drives import candidates, drive_of, pose_rows, step

from envs.recording.turning_point import turning_point


def towards(x, curvature=0.0, **changes):
    return step(x=x, candidates=candidates((curvature, 0, 4, 9)), chosen=0, **changes)


def test_a_collision_is_decided_where_the_chosen_motions_begin_to_lead_there(tmp_path):
    """The motions of the first two steps pass it by, and that of the third leads over it."""
    steps = [towards(0.0, 2.0), towards(0.4, 2.0), towards(0.8), towards(1.2), step(x=1.6, contact="chassis")]
    step_number, why = turning_point(drive_of(tmp_path / "a.zip", steps, outcome="collision"))
    assert step_number == 2 and "the chosen motion led over the place" in why


def test_of_another_driver_it_is_where_the_clearance_begins_to_fall_for_good(tmp_path):
    clearances = (1.0, 0.6, 0.9, 0.5, 0.0)
    steps = [step(x=0.4 * n, clearance=c) for n, c in enumerate(clearances)]
    assert turning_point(drive_of(tmp_path / "a.zip", steps, outcome="collision"))[0] == 2
    clearances = (3.0, 3.0, 3.0, 2.6, 1.0, 0.0)  # farther than 3 m is not measured
    steps = [step(x=0.4 * n, clearance=c) for n, c in enumerate(clearances)]
    assert turning_point(drive_of(tmp_path / "a.zip", steps, outcome="collision"))[0] == 2
    steps = [step(x=0.4 * n, tilt_deg=t) for n, t in enumerate((3.0, 9.0, 8.0, 15.0, 31.0))]
    assert turning_point(drive_of(tmp_path / "a.zip", steps, outcome="tilt"))[0] == 2


def test_an_arrival_is_decided_where_the_rover_turns_to_the_goal_for_good(tmp_path):
    steps = [step(x=x) for x in (0.0, 1.0, 0.5, 0.5, 2.0, 8.1)]
    assert turning_point(drive_of(tmp_path / "a.zip", steps))[0] == 2
    steps = [step(x=x) for x in (0.0, 1.0, 0.99, 4.0, 8.1)]  # it moves 1 cm away as it turns in place
    assert turning_point(drive_of(tmp_path / "a.zip", steps))[0] == 0


@pytest.mark.parametrize(("outcome", "number"), [("time", 2), ("stuck", 2), ("out_of_bounds", 2), ("no_path", 3)])
def test_any_other_end_is_decided_at_the_nearest_place_or_where_more_risk_is_taken(tmp_path, outcome, number):
    risks = (1, 0, 0, 1, 2)
    steps = [step(x=x, risk_level=r) for x, r in zip((0.0, 3.0, 5.0, 4.0, 4.5), risks)]
    assert turning_point(drive_of(tmp_path / "a.zip", steps, outcome=outcome))[0] == number


def test_a_drive_ends_elsewhere_where_its_odometry_goes_astray(tmp_path):
    steps = [step(x=x, believed_pose=pose_rows(x + error, 0, 0)) for x, error in ((0, 0), (1, 0.4), (2, 0.6), (3, 1.1))]
    assert turning_point(drive_of(tmp_path / "a.zip", steps, outcome="elsewhere"))[0] == 2


@pytest.mark.parametrize("error", [0.0, 0.4])
def test_a_drive_that_ends_elsewhere_by_sound_odometry_is_decided_at_the_nearest_place(tmp_path, error):
    errors = zip((0.0, 3.0, 5.0, 4.0), (0.0, 0.6, 0.6, error))
    steps = [step(x=x, believed_pose=pose_rows(x + e, 0, 0)) for x, e in errors]
    number, why = turning_point(drive_of(tmp_path / "a.zip", steps, outcome="elsewhere"))
    assert number == 2 and "odometry" not in why


def test_a_collision_after_a_turn_on_the_spot_is_decided_where_the_turn_was_chosen(tmp_path):
    turn = candidates((0, np.pi, 4, 9))  # the rover faces away from what it hits
    steps = [
        step(x=0.0, candidates=candidates((0, 0, 4, 9)), chosen=0),
        step(x=1.0, candidates=turn, chosen=0),
        step(x=1.0, candidates=turn, chosen=0),
        step(x=-1.0, contact="chassis"),
    ]
    number, why = turning_point(drive_of(tmp_path / "a.zip", steps, outcome="collision"))
    assert number == 1 and "the chosen motion led over the place" in why
